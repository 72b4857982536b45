"""The layers of a USD file before they are a scene: nothing from outside, and no more parts than are read."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import PurePosixPath
from typing import Any

from pxr import Sdf

from service.domain.errors import FileMalformed

MOST_PARTS = 100_000
"""Of a scene, each as often as it is referred to."""

_DEEPEST = 200
_MOST_LAYERS = 1_000
_ARCS = ("referenceList", "payloadList", "inheritPathList", "specializesList")

Place = tuple[Any, Any]
"""A layer and the path of a part in it."""


def own_layers(name: str) -> list[Any]:
    """Return the first layer of a file and those of its own package, cut off from all others.

    USD would follow paths to any file of this machine.

    Parameters
    ----------
    name : str
        Path of the file, whose ending tells its kind.

    Raises
    ------
    FileMalformed
        If it has no layer, or too many.
    """
    first = Sdf.Layer.FindOrOpen(name)
    if first is None:
        raise FileMalformed("The USD file has no layer that can be read.")
    found, seen = [first], {first.identifier}
    for layer in found:
        layer.SetPermissionToEdit(True)  # in memory; nothing is saved
        for asset in layer.GetCompositionAssetDependencies():
            inner = _in_package(layer, asset) if name.endswith(".usdz") else None
            if inner is None:
                layer.UpdateCompositionAssetDependency(asset, "")
            elif inner.identifier not in seen:
                seen.add(inner.identifier)
                found.append(inner)
        if len(found) > _MOST_LAYERS:
            raise FileMalformed(f"The USD package has more than the {_MOST_LAYERS} layers that are read.")
    return found


def _in_package(layer: Any, asset: str) -> Any:
    """Return the layer of the same package that a path leads to; None where it leads out of it."""
    path = PurePosixPath(asset)
    if path.is_absolute() or ".." in path.parts or ":" in asset or "[" in asset:
        return None
    return Sdf.Layer.FindOrOpenRelativeToLayer(layer, asset)


def check_parts(layers: list[Any]) -> None:
    """Refuse layers that come to more parts than are read: of 20 each may refer to the next twice.

    Raises
    ------
    FileMalformed
        If there are more than `MOST_PARTS`, or parts lie more than 200 deep in each other.
    """
    known: dict[Place, int] = {}
    _weigh_all([(layers[0], Sdf.Path.absoluteRootPath)], known)


def _weigh_all(pending: list[Place], known: dict[Place, int]) -> None:
    """Weigh parts, those within and those referred to first; USD cuts what refers to itself."""
    open_ = set[Place]()
    while pending:
        place = pending[-1]
        inner = list(_inner(place))
        left = [p for p in inner if p not in known and p not in open_]
        if left and place not in open_:
            open_.add(place)
            if len(open_) > MOST_PARTS or place[1].pathElementCount > _DEEPEST:
                raise _too_many()
            pending += left
            continue
        pending.pop()
        open_.discard(place)
        known[place] = 1 + sum(known.get(p, 0) for p in inner)
        if known[place] > MOST_PARTS:
            raise _too_many()


def _too_many() -> FileMalformed:
    return FileMalformed(
        f"The USD scene has more than the {MOST_PARTS} parts that are read, or parts more than {_DEEPEST} "
        "deep in each other."
    )


def _inner(place: Place) -> Iterator[Place]:
    """Yield the parts within a part, in its variants, and those that it is made of by reference."""
    layer, path = place
    spec = layer.pseudoRoot if path == Sdf.Path.absoluteRootPath else layer.GetPrimAtPath(path)
    if spec is None:
        return
    for child in spec.nameChildren:
        yield layer, child.path
    if path == Sdf.Path.absoluteRootPath:
        for name in layer.subLayerPaths:
            yield from _root_of(layer, name)
        return
    for variants in spec.variantSets.values():
        for variant in variants.variants.values():
            for child in variant.primSpec.nameChildren:
                yield layer, child.path
    for arc in _ARCS:
        for item in getattr(spec, arc).GetAddedOrExplicitItems():
            yield from _meant(layer, item)


def _meant(layer: Any, item: Any) -> Iterator[Place]:
    if isinstance(item, Sdf.Path):
        yield layer, item
        return
    target = Sdf.Layer.FindOrOpenRelativeToLayer(layer, item.assetPath) if item.assetPath else layer
    if target is not None:
        yield target, item.primPath or Sdf.Path(f"/{target.defaultPrim}")


def _root_of(layer: Any, name: str) -> Iterator[Place]:
    target = Sdf.Layer.FindOrOpenRelativeToLayer(layer, name)
    if target is not None:
        yield target, Sdf.Path.absoluteRootPath
