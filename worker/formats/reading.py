"""Readings of drawings as files: walls.geojson, removed.geojson, reading.json and a preview."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Sequence
from itertools import islice, pairwise
from pathlib import Path
from typing import Any

import numpy as np
import orjson
from numpy.typing import NDArray

from service.domain.bounds import Bounds
from service.domain.drawing_reading import DrawingCounts, DrawingReading
from service.domain.errors import FileEmpty, FileMalformed, NotFinite, UnsupportedMedia
from service.domain.plain import plain_text
from worker.formats import preview
from worker.geometry.drawing.reading.file_frame import StrokeIds, boxes_around, stroke_ids
from worker.geometry.drawing.reading.reading import Column, Reading, RemovedStroke, Unit, Wall

_DECIMALS = 4
_FARTHEST = 1e7
_THICKEST = 10.0
_ORJSON = orjson.OPT_SORT_KEYS | orjson.OPT_SERIALIZE_NUMPY
_AT_ONCE = 10_000
_REASONS = {
    "wall": "two faces, or one filled bar, as far apart as a wall is thick",
    "partition": "a single line that stands where walls stand",
    "column": "a solid outline that is too short for a wall",
}


def write_reading(reading: Reading, directory: Path) -> list[Path]:
    """Write ``walls.geojson``, ``removed.geojson``, ``preview.png`` and ``reading.json``; return their paths.

    Parameters
    ----------
    reading : Reading
        In frame `drawing`.
    directory : Path
        Exists; files of the same names are overwritten.
    """
    walls, removed = directory / "walls.geojson", directory / "removed.geojson"
    picture, summary = directory / "preview.png", directory / "reading.json"
    ids = stroke_ids(reading)
    write_walls(walls, reading.walls, reading.columns, frame="drawing", unit=reading.unit, ids=ids)
    lines = iter(_rounded([line for stroke in reading.removed for line in stroke.lines]))
    strokes = (_removed(r, name, lines) for r, name in zip(reading.removed, ids.removed, strict=True))
    _write_features(removed, strokes, "drawing", reading.unit)
    _picture(picture, reading)
    write_json(summary, _summary(reading).to_json(), indent=2)
    return [walls, removed, picture, summary]


def write_walls(
    path: Path,
    walls: Sequence[Wall],
    columns: Sequence[Column] = (),
    *,
    frame: str,
    unit: Unit = "m",
    ids: StrokeIds | None = None,
) -> None:
    """Write walls as ``LineString`` with `thickness_m` and `faces`, columns as ``Polygon``.

    Coordinates are rounded to 0.1 mm. While the scale is unknown they are pixels and the thickness is
    `thickness_px`: such a file is for looking at, and no map can be made from it. With `ids` each feature
    has its name, by which edits call it.
    """
    lines = iter(_rounded([line for w in walls for line in (w.centre, *w.faces)]))
    rings = _rounded([np.vstack([c.outline, c.outline[:1]]) for c in columns])
    features = [_wall(w, unit, lines) for w in walls]
    features += [_column(c, ring) for c, ring in zip(columns, rings, strict=True)]
    names = (*ids.walls, *ids.columns) if ids is not None else ()
    for feature, name in zip(features, names, strict=ids is not None):
        feature["properties"]["id"] = name
    _write_features(path, features, frame, unit)


def load_walls_and_columns(
    path: Path, *, bounds: Bounds | None = None
) -> tuple[tuple[Wall, ...], tuple[Column, ...]]:
    """Return walls and columns of a ``walls.geojson``, in the file's frame.

    The file may come from outside: it is checked as any upload.

    Raises
    ------
    FileEmpty
        If the file has no bytes.
    UnsupportedMedia
        If it is not a GeoJSON FeatureCollection, or its unit is not metres.
    FileMalformed
        If a feature breaks the format; the sentence names it.
    NotFinite
        If a coordinate or a thickness is not a finite number.
    """
    bounds = bounds or Bounds()
    features = _features(path, bounds)
    walls: list[Wall] = []
    columns: list[Column] = []
    for number, feature in enumerate(features):
        where = f"feature {number} of {path.name}"
        geometry, properties = _parts(feature, where)
        if geometry.get("type") == "LineString":
            walls.append(_to_wall(geometry, properties, where))
        elif geometry.get("type") == "Polygon":
            rings = geometry.get("coordinates")
            if not isinstance(rings, list) or not rings:
                raise FileMalformed(f"The polygon in {where} has no ring.")
            ring = _line(rings[0], where, least=4)
            columns.append(Column(ring[:-1], str(properties.get("kind", "column"))))
        else:
            raise FileMalformed(f"The geometry in {where} is neither a LineString nor a Polygon.")
    return tuple(walls), tuple(columns)


def write_json(path: Path, value: dict[str, Any], *, indent: int | None = None) -> None:
    """Write JSON of plain text, with sorted keys and no clock: the same value gives the same bytes."""
    text = json.dumps(value, indent=indent, sort_keys=True, ensure_ascii=False, allow_nan=False)
    path.write_text(plain_text(text) + "\n", encoding="utf-8")


def _write_features(path: Path, features: Iterable[dict[str, Any]], frame: str, unit: Unit) -> None:
    """Write a FeatureCollection whose coordinates are arrays: as `write_json`, in a tenth of the time."""
    rest, begun = iter(features), False
    with path.open("wb") as file:
        file.write(b'{"features":[')
        while some := [_plain(feature) for feature in islice(rest, _AT_ONCE)]:
            file.write((b"," if begun else b"") + orjson.dumps(some, option=_ORJSON)[1:-1])
            begun = True
        told = {"type": "FeatureCollection", "frame": frame, "unit": unit}
        file.write(b"]," + orjson.dumps(told, option=_ORJSON)[1:] + b"\n")


def _plain(feature: dict[str, Any]) -> dict[str, Any]:
    told = feature["properties"]
    told.update((k, plain_text(v)) for k, v in told.items() if isinstance(v, str))
    return feature


def _features(path: Path, bounds: Bounds) -> list[Any]:
    text = path.read_bytes()
    if not text:
        raise FileEmpty(f"{path.name} has no bytes.")
    try:
        value = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise UnsupportedMedia(f"{path.name} is not JSON: {error}.") from error
    if not isinstance(value, dict) or not isinstance(value.get("features"), list):
        raise UnsupportedMedia(f"{path.name} is no GeoJSON FeatureCollection.")
    if value.get("unit", "m") != "m":
        raise UnsupportedMedia(f"{path.name} is in {value['unit']!r}, not in metres: its scale is unknown.")
    features = value["features"]
    if len(features) > bounds.max_walls:
        raise FileMalformed(f"{path.name} has {len(features)} walls; at most {bounds.max_walls} are read.")
    return list(features)


def _parts(feature: Any, where: str) -> tuple[dict[str, Any], dict[str, Any]]:
    if not isinstance(feature, dict) or not isinstance(feature.get("geometry"), dict):
        raise FileMalformed(f"The {where} has no geometry.")
    properties = feature.get("properties") or {}
    if not isinstance(properties, dict):
        raise FileMalformed(f"The properties of {where} are no object.")
    return feature["geometry"], properties


def _to_wall(geometry: dict[str, Any], properties: dict[str, Any], where: str) -> Wall:
    centre = _line(geometry.get("coordinates"), where, least=2)
    thickness = properties.get("thickness_m", 0.0)
    if isinstance(thickness, bool) or not isinstance(thickness, int | float):
        raise FileMalformed(f"The thickness_m in {where} is no number.")
    if not math.isfinite(thickness):
        raise NotFinite(f"The thickness_m in {where} is not finite.")
    if not 0.0 <= thickness <= _THICKEST:
        raise FileMalformed(
            f"The thickness_m in {where} is {thickness}; it lies between 0 and {_THICKEST:g}."
        )
    kind = str(properties.get("kind", "wall"))
    faces = properties.get("faces")
    if faces is None:
        return Wall.of(centre, thickness=float(thickness), kind=kind)
    if not isinstance(faces, list) or len(faces) != 2:
        raise FileMalformed(f"The faces in {where} are not two polylines.")
    left, right = (_line(face, where, least=2) for face in faces)
    return Wall(centre, float(thickness), (left, right), kind)


def _line(value: Any, where: str, *, least: int) -> NDArray[np.float64]:
    if not isinstance(value, list) or len(value) < least:
        raise FileMalformed(f"A line in {where} has fewer than {least} points.")
    try:
        line = np.array([[float(p[0]), float(p[1])] for p in value], dtype=np.float64)
    except (TypeError, ValueError, IndexError, KeyError, OverflowError) as error:
        raise FileMalformed(f"A point in {where} is not a pair of numbers.") from error
    if not np.isfinite(line).all():
        raise NotFinite(f"A coordinate in {where} is not finite.")
    if np.abs(line).max() > _FARTHEST:
        raise FileMalformed(f"A coordinate in {where} is beyond {_FARTHEST:g} m.")
    return line


def _rounded(lines: Sequence[NDArray[np.float64]]) -> list[NDArray[np.float64]]:
    """Return lines as they are written, all rounded at once.

    Raises
    ------
    ValueError
        If a coordinate is not finite: JSON has no word for it.
    """
    if not lines:
        return []
    points = np.asarray(np.round(np.concatenate(lines), _DECIMALS) + 0.0, dtype=np.float64)
    if not np.isfinite(points).all():
        msg = "a line of the reading has a coordinate that is not finite"
        raise ValueError(msg)
    end = np.cumsum([len(line) for line in lines]).tolist()
    return [points[a:b] for a, b in pairwise([0, *end])]


def _wall(wall: Wall, unit: Unit, lines: Iterator[NDArray[np.float64]]) -> dict[str, Any]:
    """Return a wall's feature; the next three of the lines are its centre and its faces."""
    if not math.isfinite(wall.thickness + wall.confidence):
        msg = "a wall of the reading has a thickness or a confidence that is not finite"
        raise ValueError(msg)
    return {
        "type": "Feature",
        "geometry": {"type": "LineString", "coordinates": next(lines)},
        "properties": {
            "kind": wall.kind,
            "layer": "wall",
            "reason": wall.reason or _REASONS.get(wall.kind, ""),
            f"thickness_{unit}": round(wall.thickness, _DECIMALS),
            "faces": [next(lines), next(lines)],
            "confidence": round(wall.confidence, 3),
        },
    }


def _column(column: Column, ring: NDArray[np.float64]) -> dict[str, Any]:
    geometry = {"type": "Polygon", "coordinates": [ring]}
    properties = {"kind": column.kind, "layer": "column", "reason": _REASONS["column"]}
    return {"type": "Feature", "geometry": geometry, "properties": properties}


def _removed(stroke: RemovedStroke, name: str, lines: Iterator[NDArray[np.float64]]) -> dict[str, Any]:
    """Return a removed stroke's feature; the next of the lines are its own."""
    geometry = {"type": "MultiLineString", "coordinates": [next(lines) for _ in stroke.lines]}
    properties = {"id": name, "layer": stroke.layer, "reason": stroke.reason}
    return {"type": "Feature", "geometry": geometry, "properties": properties}


def _picture(path: Path, reading: Reading) -> None:
    boxes = boxes_around([*reading.walls, *reading.columns, *reading.removed])
    low, high = np.zeros(2), np.array(reading.sheet)
    if len(boxes):
        low, high = np.minimum(low, boxes[:, :2].min(axis=0)), np.maximum(high, boxes[:, 2:].max(axis=0))
    preview.write_preview(
        path,
        [*_drawn_removed(reading.removed), *_drawn_walls(reading.walls, reading.columns)],
        low=(float(low[0]), float(low[1])),
        high=(float(high[0]), float(high[1])),
        unit=reading.unit,
    )


def _drawn_removed(removed: Sequence[RemovedStroke]) -> list[preview.Drawn]:
    lines: dict[str, list[NDArray[np.float64]]] = {}
    for stroke in removed:
        lines.setdefault(stroke.layer, []).extend(stroke.lines)
    return [
        preview.Drawn(preview.colour_of(layer), lines=tuple(lines[layer]), label=f"{layer} (set aside)")
        for layer in sorted(lines)
    ]


def _drawn_walls(walls: Sequence[Wall], columns: Sequence[Column]) -> list[preview.Drawn]:
    solid = tuple(f for w in walls if w.kind == "wall" for f in w.faces)
    bodies = tuple(np.vstack([w.faces[0], w.faces[1][::-1]]) for w in walls if w.kind == "wall")
    thin = tuple(w.centre for w in walls if w.kind != "wall")
    outlines = tuple(np.vstack([c.outline, c.outline[:1]]) for c in columns)
    return [
        preview.Drawn(preview.BODY, areas=bodies),
        preview.Drawn(preview.PARTITION, lines=thin, width=3, label="partition" if thin else ""),
        preview.Drawn(preview.COLUMN, lines=outlines, width=3, label="column" if outlines else ""),
        preview.Drawn(preview.WALL, lines=solid, width=3, label="wall" if solid else ""),
    ]


def _summary(reading: Reading) -> DrawingReading:
    removed: dict[str, int] = {}
    strokes: dict[str, int] = {}
    for stroke in reading.removed:
        removed[stroke.layer] = removed.get(stroke.layer, 0) + 1
        strokes[stroke.layer] = strokes.get(stroke.layer, 0) + len(stroke.lines)
    length = round(sum(w.length for w in reading.walls), 2)
    width, height = (round(v, _DECIMALS) for v in reading.sheet)
    x, y = (round(v, _DECIMALS) for v in reading.origin)
    return DrawingReading(
        frame="drawing",
        unit=reading.unit,
        scale=reading.scale.told(),
        sheet=(width, height),
        drawing_origin=(x, y),
        drawing_top=None if reading.top is None else round(reading.top, _DECIMALS),
        confidence=round(reading.confidence, 3),
        layers=reading.layers,
        style=reading.style,
        counts=DrawingCounts(
            walls=len(reading.walls),
            columns=len(reading.columns),
            removed=removed,
            removed_strokes=strokes,
            wall_length_m=length if reading.unit == "m" else None,
            wall_length_px=length if reading.unit == "px" else None,
            **reading.counts,
        ),
        findings=reading.findings,
    )
