"""Forms of two people who had the same revision in view: nothing of either is lost, or both are told.

The oracle knows nothing of how states are put together: it takes them apart into single members, and asks
of each who changed it.
"""

from __future__ import annotations

import random
from collections import Counter
from dataclasses import replace
from typing import Any

import pytest

from service.domain.errors import InvalidRequest
from service.domain.map_state import BaseReading, LayerState, MapState, differences, pose_of
from service.domain.operations import (
    MAX_LAYERS,
    AddLayer,
    EraseRegion,
    MoveLayer,
    Operation,
    RemoveLayer,
    RenameLayer,
    ReplaceLayer,
    RestoreRegion,
    SetLayers,
    SetRecipe,
    ShowLayer,
    apply_all,
)
from service.domain.recipe import MapFromDrawing, Recipe
from service.domain.region import MAX_REGIONS, Region
from service.domain.together import overlap, put_together
from service.domain.transform import Transform

PAIRS = 1_000
SQUARE = Region(((0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (0.0, 4.0)))
ABSENT = "absent"


def a_layer(name: str, *, scan: str | None = None) -> LayerState:
    pose = pose_of(Transform.identity().tolist())
    return LayerState(f"lyr_{name}", name, f"scn_{scan or name}", f"plc_{name}", {"points": "all"}, pose)


def a_base(draw: random.Random) -> MapState:
    layers = tuple(a_layer(str(k)) for k in range(draw.randint(0, 5)))
    state = MapState(BaseReading("drw_0", "0" * 64, {}), Recipe(), layers)
    for k in range(draw.randint(0, 3)):
        state = EraseRegion(f"ers_{k}", SQUARE).apply(state)
    return state


def _recipe(draw: random.Random, state: MapState, _who: str) -> MapState:
    recipe = state.recipe
    changes: list[dict[str, Any]] = [
        {"voxel_size_m": draw.choice([0.1, 0.2, 0.4])},
        {"wall_height_m": draw.choice([2.0, 2.5, 3.0])},
        {"floor": not recipe.floor},
        {"ceiling": not recipe.ceiling},
        {"layer_voxel_size_m": draw.choice([0.02, 0.05])},
        {"occupancy_resolution_m": draw.choice([0.05, 0.1])},
    ]
    return replace(state, recipe=replace(recipe, **draw.choice(changes)))


def _place_of_drawing(draw: random.Random, state: MapState, _who: str) -> MapState:
    place = MapFromDrawing(x_m=draw.choice([0.0, 1.0, 2.0]), yaw_rad=draw.choice([0.0, 0.5]))
    return replace(state, recipe=replace(state.recipe, map_from_drawing=place))


def _drawing(draw: random.Random, state: MapState, _who: str) -> MapState:
    n = draw.randint(0, 2)
    return replace(state, reading=BaseReading(f"drw_{n}", str(n) * 64, {}))


def _one_layer(draw: random.Random, state: MapState, who: str) -> MapState:
    if not state.layers:
        return state
    layer_id = draw.choice(state.layers).layer_id
    pose = pose_of(Transform.from_xyz_yaw(draw.choice([1.0, 2.0]), 0.0, 0.0, 0.0).tolist())
    placement = f"plc_{who}{draw.randint(0, 99)}"
    steps: list[Operation] = [
        MoveLayer(layer_id, pose),
        ShowLayer(layer_id, visible=draw.random() < 0.5),
        RenameLayer(layer_id, draw.choice(["press", "rack"])),
        RemoveLayer(layer_id),
        ReplaceLayer(layer_id, draw.choice(["scn_x", f"scn_{who}"]), placement, None, pose),
    ]
    return draw.choice(steps).apply(state)


def _add(draw: random.Random, state: MapState, who: str) -> MapState:
    name = f"{who}{len(state.layers)}-{draw.randint(0, 999)}"
    layer = a_layer(name, scan="shared" if draw.random() < 0.2 else None)
    layers = list(state.layers)
    layers.insert(draw.randint(0, len(layers)), layer)
    return SetLayers(tuple(layers)).apply(state)


def _reorder(draw: random.Random, state: MapState, _who: str) -> MapState:
    return SetLayers(tuple(draw.sample(state.layers, len(state.layers)))).apply(state)


def _regions(draw: random.Random, state: MapState, who: str) -> MapState:
    if state.erased and draw.random() < 0.5:
        return RestoreRegion(draw.choice(state.erased).region_id).apply(state)
    return EraseRegion(f"ers_{who}{draw.randint(0, 99_999)}", SQUARE).apply(state)


CHANGES = (_recipe, _place_of_drawing, _drawing, _one_layer, _one_layer, _add, _reorder, _regions)


def a_form(draw: random.Random, base: MapState, who: str) -> MapState:
    """Return a whole form: everything as in the base but for a few changes."""
    for change in draw.choices(CHANGES, k=draw.randint(1, 3)):
        base = change(draw, base, who)
    return base


def members(state: MapState, common: frozenset[str]) -> dict[str, Any]:
    """Return every single member of a state by its name; what is not there has none.

    Of the order that of the layers which all have in common; of a region the hole in each layer, by the
    placement that it was cut from.
    """
    found: dict[str, Any] = {"drawing": state.reading, **state.recipe.to_json()}
    found |= {f"layer {one.layer_id}": one for one in state.layers}
    found |= {f"region {one.region_id}": (one.region, one.drawing) for one in state.erased}
    found["order"] = [one.layer_id for one in state.layers if one.layer_id in common]
    placed = {one.layer_id: one.placement_id for one in state.layers}
    return found | {
        f"hole {one.region_id} {key} {placed[key]}": pose
        for one in state.erased
        for key, pose in one.layers.items()
    }


def compared(*states: MapState) -> list[dict[str, Any]]:
    """Return the members of base, yours and theirs, and of what was made of them if that is given."""
    common = frozenset.intersection(*(frozenset(x.layer_id for x in one.layers) for one in states[:3]))
    return [members(one, common) for one in states]


def changed_by_both(base: MapState, yours: MapState, theirs: MapState) -> list[str]:
    """Return the members of which each has another value."""
    old, mine, others = compared(base, yours, theirs)
    names = set(old) | set(mine) | set(others)
    triples = {name: [one.get(name, ABSENT) for one in (old, mine, others)] for name in names}
    return sorted(name for name, (a, b, c) in triples.items() if a not in (b, c) and b != c)


def lost(base: MapState, yours: MapState, theirs: MapState, made: MapState) -> list[str]:
    """Return the members that are not what whoever changed them made of them."""
    old, mine, others, result = compared(base, yours, theirs, made)
    wrong = []
    for name in set(old) | set(mine) | set(others) | set(result):
        a, b, c = (one.get(name, ABSENT) for one in (old, mine, others))
        if _can_be(name, made) and result.get(name, ABSENT) != (c if a == b else b):
            wrong.append(name)
    return sorted(wrong)


def _can_be(name: str, made: MapState) -> bool:
    """Return whether a member has its place in what was made: a hole needs its region and its scan."""
    kind, *rest = name.split(" ")
    if kind != "hole":
        return True
    region, layer_id, placement = rest
    layer = made.layer(layer_id)
    has_region = any(one.region_id == region for one in made.erased)
    return has_region and layer is not None and layer.placement_id == placement


def met_elsewhere(base: MapState, yours: MapState, theirs: MapState) -> bool:
    """Return whether both changed where walls stand, or took in the same scan, each in its own way."""
    walls: list[Any] = [(one.reading, one.recipe.map_from_drawing) for one in (base, yours, theirs)]
    scans = {x.scan_id for state in (base, yours, theirs) for x in state.layers}
    holders: list[list[Any]] = [
        [{x.layer_id for x in one.layers if x.scan_id == scan} for one in (base, yours, theirs)]
        for scan in scans
    ]
    return any(a not in (b, c) and b != c for a, b, c in [walls, *holders])


def pairs() -> list[tuple[MapState, MapState, MapState]]:
    found = []
    for seed in range(PAIRS):
        draw = random.Random(seed)
        base = a_base(draw)
        found.append((base, a_form(draw, base, "a"), a_form(draw, base, "b")))
    return found


def test_of_a_thousand_pairs_of_forms_no_update_is_lost() -> None:
    seen: Counter[str] = Counter()
    for seed, (base, yours, theirs) in enumerate(pairs()):
        if overlap(base, yours, theirs):
            seen["refused"] += 1
            assert changed_by_both(base, yours, theirs) or met_elsewhere(base, yours, theirs), seed
            continue
        assert not changed_by_both(base, yours, theirs), seed
        made = put_together(base, yours, theirs)
        assert lost(base, yours, theirs, made) == [], seed
        seen["put together"] += 1
        seen["lost as forms were taken"] += bool(lost(base, yours, theirs, yours))
    assert min(seen.values()) > PAIRS // 10, seen


def test_whose_form_came_first_decides_no_member() -> None:
    for seed, (base, yours, theirs) in enumerate(pairs()):
        assert overlap(base, yours, theirs) == overlap(base, theirs, yours), seed
        if not overlap(base, yours, theirs):
            one, other = put_together(base, yours, theirs), put_together(base, theirs, yours)
            assert {x.subject for x in differences(one, other)} <= {"order"}, seed


def test_a_form_that_changes_nothing_changes_nothing() -> None:
    for seed, (base, yours, theirs) in enumerate(pairs()):
        assert put_together(base, base, theirs) == theirs, seed
        assert put_together(base, yours, base) == yours, seed
        assert differences(theirs, put_together(base, theirs, theirs)) == [], seed


def test_layers_of_both_stand_where_each_put_them() -> None:
    base = MapState(None, Recipe(), (a_layer("0"), a_layer("1")))
    zero, one = base.layers
    mine = SetLayers((a_layer("m"), zero, one)).apply(base)
    theirs = apply_all(base, [AddLayer(a_layer("t"))])
    assert [x.name for x in put_together(base, mine, theirs).layers] == ["m", "0", "1", "t"]
    assert [x.name for x in put_together(base, theirs, mine).layers] == ["m", "0", "1", "t"]
    turned = SetLayers((one, zero)).apply(base)
    assert [x.name for x in put_together(base, turned, theirs).layers] == ["1", "0", "t"]
    assert [x.name for x in put_together(base, theirs, turned).layers] == ["1", "0", "t"]
    between = SetLayers((zero, a_layer("b"), one)).apply(base)
    assert [x.name for x in put_together(base, between, theirs).layers] == ["0", "b", "1", "t"]


def test_a_region_takes_nothing_off_a_layer_that_came_meanwhile() -> None:
    base = MapState(None, Recipe(), (a_layer("0"), a_layer("1")))
    mine = EraseRegion("ers_m", SQUARE).apply(base)
    pose = base.layers[0].T_map_scan
    steps: list[Operation] = [AddLayer(a_layer("t")), ReplaceLayer("lyr_1", "scn_n", "plc_n", None, pose)]
    (region,) = put_together(base, mine, apply_all(base, steps)).erased
    assert sorted(region.layers) == ["lyr_0"]
    (region,) = put_together(mine, RemoveLayer("lyr_0").apply(mine), mine).erased
    assert sorted(region.layers) == ["lyr_1"]


@pytest.mark.parametrize(("mine", "theirs", "fits"), [(1, 1, True), (2, 1, False)])
def test_together_there_may_be_so_many_layers_and_regions(mine: int, theirs: int, *, fits: bool) -> None:
    layers = tuple(a_layer(str(k)) for k in range(MAX_LAYERS - 2))
    base = MapState(None, Recipe(), layers)
    sides = [
        replace(base, layers=(*layers, *(a_layer(f"{who}{k}") for k in range(count))))
        for who, count in (("m", mine), ("t", theirs))
    ]
    bare = MapState(None, Recipe())
    for k in range(MAX_REGIONS - 2):
        bare = EraseRegion(f"ers_{k}", SQUARE).apply(bare)
    cut = []
    for who, count in (("m", mine), ("t", theirs)):
        state = bare
        for k in range(count):
            state = EraseRegion(f"ers_{who}{k}", SQUARE).apply(state)
        cut.append(state)
    for held, (yours, others) in ((base, sides), (bare, cut)):
        if fits:
            put_together(held, yours, others)
        else:
            with pytest.raises(InvalidRequest, match="Together"):
                put_together(held, yours, others)


def test_a_form_may_name_everything_and_change_one_field() -> None:
    base = MapState(None, Recipe())
    theirs = SetRecipe({"wall_height_m": 3.5}).apply(base)
    mine = SetRecipe({**Recipe().to_json(), "voxel_size_m": 0.1}).apply(base)
    assert put_together(base, mine, theirs).recipe == Recipe(wall_height_m=3.5, voxel_size_m=0.1)
