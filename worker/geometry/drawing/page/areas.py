"""Filled areas of a vector page that are walls: poche and solid hatches, less what white areas hide."""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from worker.geometry.drawing.linework.areas import entity_area
from worker.geometry.drawing.linework.linework import Linework

_THINNEST, _THICKEST = 0.05, 0.9
_LEAST_LENGTH, _LEAST_SHARE = 5.0, 0.5
_PIER_LOW, _PIER_HIGH = 0.15, 1.5
_LEAST_MASK = 0.02
_LARGEST_ARROW, _JOINT = 1.5, 0.003
_LARGEST_LETTER, _CONVEX, _LEAST_LETTERS, _LETTER_SHARE = 1.2, 0.8, 6, 0.4
_MOST_AREAS = 50_000
_DARKEST_ZONE = 0xD8


def wall_areas(linework: Linework, unit: float) -> tuple[list[Any], NDArray[np.bool_]]:
    """Return the filled areas that have the shape of walls [m], and which entities these are.

    A colour of fill counts where most of its area lies in strips 5 to 90 cm thick or in piers, and where
    these come to five metres; light greys fill zones, not walls. White areas drawn later (a window in a
    wall) are cut out.

    Parameters
    ----------
    linework : Linework
        A page in drawing order.
    unit : float
        Metres a drawing unit.

    Returns
    -------
    areas : list of shapely Polygon or MultiPolygon
        Material [m].
    kept : ndarray of shape (E,), bool
        Which entities they are of.
    """
    kept = np.zeros(len(linework.kind), dtype=np.bool_)
    numbers = np.flatnonzero(linework.filled & (linework.kind != "mask"))[:_MOST_AREAS]
    area_of = {int(e): a for e in numbers if (a := entity_area(linework, int(e), unit)) is not None}
    groups: dict[tuple[int, int], list[int]] = {}
    for e in area_of:
        groups.setdefault((int(linework.layer[e]), int(linework.colour[e])), []).append(e)
    for (_, colour), members in groups.items():
        like = _wall_like({e: area_of[e] for e in members})
        whole = sum(area_of[e].area for e in members)
        share = sum(area_of[e].area for e in like) / whole if whole > 0 else 0.0
        length = sum(area_of[e].length / 2 for e in like)
        light = min(colour >> 16 & 0xFF, colour >> 8 & 0xFF, colour & 0xFF) >= _DARKEST_ZONE
        if like and not light and share >= _LEAST_SHARE and length >= _LEAST_LENGTH:
            kept[like] = True
    return _unmasked(linework, {int(e): area_of[int(e)] for e in np.flatnonzero(kept)}, unit), kept


def _wall_like(areas: dict[int, Any]) -> list[int]:
    """Return which areas of one colour belong to bodies of a wall's shape, which may come in triangles."""
    pieces = {e: a for e, a in areas.items() if 2.0 * a.area / max(a.length, 1e-9) <= _THICKEST}
    if not pieces:
        return []
    whole = shapely.union_all(
        shapely.buffer(list(pieces.values()), _JOINT, join_style="mitre", mitre_limit=1.5)
    )
    bodies = shapely.get_parts(whole)
    good = np.array([_is_wall_like(body) for body in bodies], dtype=np.bool_)
    small = np.array([_side(body) < _LARGEST_LETTER for body in bodies], dtype=np.bool_)
    letters = small & np.array(
        [body.area < _CONVEX * body.convex_hull.area for body in bodies], dtype=np.bool_
    )
    if letters.sum() >= _LEAST_LETTERS and letters.sum() >= _LETTER_SHARE * small.sum():
        letters = small  # text drawn as areas: the upright strokes of an i or l look like piers
    good &= ~letters
    tree = shapely.STRtree(bodies)
    middles = [a.representative_point() for a in pieces.values()]
    piece, body = tree.query(middles, predicate="intersects")
    numbers = list(pieces)
    return [numbers[i] for i in np.unique(piece[good[body]])]


def _side(area: Any) -> float:
    """Return the longer side of the box around an area."""
    left, bottom, right, top = area.bounds
    return float(max(right - left, top - bottom))


def _is_wall_like(area: Any) -> bool:
    """Return whether a body is a strip, a net of strips or a pier, and no arrowhead."""
    thickness = 2.0 * area.area / max(area.length, 1e-9)
    box = area.bounds
    side = _side(area)
    if side < _LARGEST_ARROW and len(_corners(area)) <= 3:
        return False
    long = area.length / 2 >= 3.0 * thickness and side >= 0.3
    pier = _PIER_LOW <= side <= _PIER_HIGH and area.area >= 0.6 * (box[2] - box[0]) * (box[3] - box[1])
    return _THINNEST <= thickness <= _THICKEST and (long or pier)


def _corners(area: Any) -> NDArray[np.float64]:
    """Return the (K, 2) corners of the hull of an area, those of a fine buffer joined."""
    hull = shapely.simplify(shapely.convex_hull(area), 4 * _JOINT)
    return np.asarray(shapely.get_coordinates(hull)[:-1], dtype=np.float64)


def _unmasked(linework: Linework, areas: dict[int, Any], unit: float) -> list[Any]:
    """Return areas less the white ones that were drawn after them."""
    masks = {
        int(e): a
        for e in np.flatnonzero(linework.kind == "mask")[:_MOST_AREAS]
        if (a := entity_area(linework, int(e), unit)) is not None and a.area >= _LEAST_MASK
    }
    if not masks or not areas:
        return list(areas.values())
    numbers = np.array(list(masks))
    tree = shapely.STRtree(list(masks.values()))
    out = []
    for e, area in areas.items():
        over = [int(k) for k in tree.query(area, predicate="intersects") if numbers[k] > e]
        if over:
            hidden = shapely.union_all([masks[int(numbers[k])] for k in over])
            left = shapely.difference(area, hidden)
            out += [p for p in shapely.get_parts(left) if p.geom_type == "Polygon" and p.area > 0]
        else:
            out.append(area)
    return out
