"""Two changes of one state of a map put together: what only one of them changed is as that one has it."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any

from service.domain.errors import InvalidRequest
from service.domain.map_state import (
    DRAWING,
    MAP_FROM_DRAWING,
    ORDER,
    ErasedRegion,
    LayerState,
    MapState,
    differences,
    subjects,
)
from service.domain.operations import MAX_LAYERS
from service.domain.recipe import Recipe
from service.domain.region import MAX_REGIONS

_WALLS = {DRAWING, MAP_FROM_DRAWING}


def overlap(base: MapState, yours: MapState, theirs: MapState) -> set[str]:
    """Return the subjects that two changes of one base leave in different states, so that neither can follow.

    What both changed to the same is agreed. A drawing and its place in the map are one subject: they decide
    together where walls stand.
    """
    mine, others = subjects(differences(base, yours)), subjects(differences(base, theirs))
    common = _ids(base) & _ids(yours) & _ids(theirs)
    shared = {
        one
        for one in mine & others
        if _are_three([_value(one, state, common) for state in (base, yours, theirs)])
    }
    if mine & _WALLS and others & _WALLS and _walls(yours) != _walls(theirs):
        shared |= (mine | others) & _WALLS
    return shared


def put_together(base: MapState, yours: MapState, theirs: MapState) -> MapState:
    """Return `theirs` with all that `yours` changed of the base; the two must not overlap.

    Compared are the states, not how they came about: what yours names as it is in the base is no change,
    and what theirs made of it stays. A region that yours erases is taken off the layers that yours has, and
    not off those that theirs added.

    Raises
    ------
    InvalidRequest
        If together there are too many layers or regions.
    """
    layers = _layers(base, yours, theirs)
    erased = _erased(base, yours, theirs, layers)
    for what, number, most in (("layers", len(layers), MAX_LAYERS), ("regions", len(erased), MAX_REGIONS)):
        if number > most:
            detail = (
                f"Together with what others added the map would have {number} {what}; it has at most {most}."
            )
            raise InvalidRequest(detail, errors=[{"pointer": "#", "detail": detail}])
    return MapState(
        reading=theirs.reading if yours.reading == base.reading else yours.reading,
        recipe=_recipe(base.recipe, yours.recipe, theirs.recipe),
        layers=layers,
        erased=erased,
    )


def _walls(state: MapState) -> tuple[Any, ...]:
    return state.reading, state.recipe.map_from_drawing


def _are_three(values: Sequence[object]) -> bool:
    """Return whether the base's value and both sides' differ, each from each."""
    base, yours, theirs = values
    return base not in (yours, theirs) and yours != theirs


def _value(subject: str, state: MapState, common: Collection[str]) -> Any:
    """Return what a state has of a subject; of the order that of the layers which all have in common."""
    kind, _, name = subject.partition(".")
    if kind == "recipe":
        return state.recipe.to_json()[name]
    if kind == "layer":
        return state.layer(name)
    if kind == "scan":
        return {layer.layer_id for layer in state.layers if layer.scan_id == name}
    if kind == "region":
        return next((one for one in state.erased if one.region_id == name), None)
    if subject == ORDER:
        return _order(state, common)
    return state.reading


def _recipe(base: Recipe, yours: Recipe, theirs: Recipe) -> Recipe:
    old = base.to_json()
    changed = {name: value for name, value in yours.to_json().items() if value != old[name]}
    return Recipe.from_json({**theirs.to_json(), **changed})


def _layers(base: MapState, yours: MapState, theirs: MapState) -> tuple[LayerState, ...]:
    kept = (_ids(theirs) - (_ids(base) - _ids(yours))) | (_ids(yours) - _ids(base))
    common = _ids(base) & _ids(yours) & _ids(theirs)
    is_ordered_anew = _order(base, common) != _order(yours, common)
    first, second = (yours, theirs) if is_ordered_anew else (theirs, yours)
    return tuple(
        _layer(layer_id, base, yours, theirs)
        for layer_id in _woven(_order(first, kept), _order(second, kept))
    )


def _layer(layer_id: str, base: MapState, yours: MapState, theirs: MapState) -> LayerState:
    mine, other = yours.layer(layer_id), theirs.layer(layer_id)
    if mine is None or (other is not None and mine == base.layer(layer_id)):
        assert other is not None, "a layer that is kept is one side's"
        return other
    return mine


def _woven(first: Sequence[str], second: Sequence[str]) -> list[str]:
    """Return the first order with what only the second has: behind what it follows there, or at the end."""
    woven, new = list(first), [one for one in second if one not in first]
    last = max((k for k, one in enumerate(second) if one in first), default=-1)
    for one in new:
        place = second.index(one)
        before = 0 if place == 0 else woven.index(second[place - 1]) + 1
        woven.insert(len(woven) if place > last else before, one)
    return woven


def _erased(
    base: MapState, yours: MapState, theirs: MapState, layers: Sequence[LayerState]
) -> tuple[ErasedRegion, ...]:
    old, mine = ({one.region_id for one in state.erased} for state in (base, yours))
    kept = [_still_of(one, theirs, layers) for one in theirs.erased if one.region_id not in old - mine]
    have = {one.region_id for one in theirs.erased}
    new = [one for one in yours.erased if one.region_id not in old | have]
    return (*kept, *(_still_of(one, yours, layers) for one in new))


def _still_of(region: ErasedRegion, state: MapState, layers: Sequence[LayerState]) -> ErasedRegion:
    """Return a region of a state with those of its layers that still hold the same scan."""
    placements: Mapping[str, str] = {layer.layer_id: layer.placement_id for layer in state.layers}
    same = {x.layer_id for x in layers if placements.get(x.layer_id) == x.placement_id}
    return replace(region, layers={key: pose for key, pose in region.layers.items() if key in same})


def _ids(state: MapState) -> set[str]:
    return {layer.layer_id for layer in state.layers}


def _order(state: MapState, wanted: Collection[str]) -> list[str]:
    return [layer.layer_id for layer in state.layers if layer.layer_id in wanted]
