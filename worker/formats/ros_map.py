"""ROS maps: `map.yaml` with its image beside it, or both in a ZIP, as `map_server` and Nav2 read them."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from service.domain.bounds import Bounds
from service.domain.errors import FileMalformed, NotFinite, NoWallsFound
from service.domain.findings import Finding
from service.domain.scale_hint import ScaleHint
from worker.formats.grey_map import decode_shades
from worker.formats.plain_yaml import parse_plain_yaml
from worker.formats.ros_map_files import map_files, parts_of
from worker.geometry.drawing.model.occupied import read_occupied
from worker.geometry.drawing.reading.reading import Reading, RemovedStroke
from worker.geometry.drawing.scale.decision import Scale, Witness, contradictions, decide

_MODES = ("trinary", "scale", "raw")
_EXTENT = (2.0, 5000.0)
_NUMBER = re.compile(r"[-+]?(\d+(\.\d*)?|\.\d+)([eE][-+]?\d+)?")
_CONFIDENCE = 0.6


@dataclass(frozen=True)
class MapHeader:
    """Hold what a ``map.yaml`` says.

    Parameters
    ----------
    image : str
        Name of the image, or a path to it, as the file has it.
    resolution : float
        Edge of a cell [m].
    origin : tuple of float
        Pose of the lower left corner in the robot's frame: x, y [m], yaw [rad].
    negate : bool
        Whether white is occupied.
    occupied_thresh, free_thresh : float
        Above and below which a cell is occupied and free, 0 to 1.
    mode : str
        ``trinary``, ``scale`` or ``raw``.
    """

    image: str
    resolution: float
    origin: tuple[float, float, float]
    negate: bool = False
    occupied_thresh: float = 0.65
    free_thresh: float = 0.25
    mode: str = "trinary"


def load_ros_map(
    path: Path,
    *,
    bounds: Bounds | None = None,
    hint: ScaleHint | None = None,
    progress: Callable[[str, float], None] | None = None,
) -> Reading:
    """Return the occupied cells of a robot's map as walls.

    Parameters
    ----------
    path : Path
        A ``map.yaml`` whose image lies in the same folder or one below it, or a ZIP that holds exactly these
        two. Only a file that is itself called ``.yaml`` or ``.yml`` has a neighbour: an upload, which lies
        among others under the name of its hash, has none.
    bounds : Bounds, optional
        The most that is read.
    hint : ScaleHint, optional
        A person's word on the scale; it wins over the map's resolution.
    progress : callable, optional
        Told the stage and the share done; what it raises ends the work.

    Returns
    -------
    Reading
        In frame `drawing`: origin at the image's lower left corner. The finding ``robot-map`` says what it
        is, and where that corner lies in the robot's frame.

    Raises
    ------
    FileMalformed
        If the YAML or the ZIP breaks its rules, or the image's path leads out of the folder.
    NotFinite, HeaderMismatch
        If a number is not finite; if the image is missing.
    DrawingTooComplex, ImageTooLarge
        If it is larger than is read.
    FileTruncated, FileEmpty, UnsupportedMedia
        If the image is cut short, empty, or of no kind that a map has.
    NoWallsFound
        If no cell is occupied.
    """
    bounds = bounds or Bounds()
    tell = progress or (lambda _stage, _share: None)
    files = map_files(path, bounds)
    header = parse_header(files.text, files.name, bounds=bounds)
    image = files.image(header.image)
    tell("load", 0.2)
    occupied, unknown = _cells(image, header, bounds)
    tell("walls", 0.4)
    try:
        found = read_occupied(occupied, header.resolution)
    except shapely.errors.ShapelyError as error:
        raise FileMalformed(f"The occupied cells of {header.image} make no outlines: {error}.") from error
    if not found.solids.walls and not found.solids.columns:
        raise NoWallsFound(
            f"Of the {occupied.size} cells of {header.image} {int(occupied.sum())} are occupied, and they "
            "make no wall. Look at negate and occupied_thresh in the map's YAML."
        )
    size = (occupied.shape[1] * header.resolution, occupied.shape[0] * header.resolution)
    scale = _scale(header, size, hint)
    edge = np.array([header.resolution, 0.0])
    specks = tuple(np.stack([p - edge / 2, p + edge / 2]) for p in found.specks[:5_000])
    removed = (RemovedStroke(specks, "speck", "fewer than three occupied cells"),) if specks else ()
    reading = Reading(
        found.solids.walls,
        found.solids.columns,
        removed,
        size,
        scale,
        "filled",
        findings=(_robot_map(header), *contradictions(scale)),
        counts={"occupied_cells": int(occupied.sum()), "unknown_cells": unknown, "specks": len(found.specks)},
        confidence=_CONFIDENCE,
    )
    return _in_scale(reading, header, scale)


def parse_header(text: bytes, name: str, *, bounds: Bounds) -> MapHeader:
    """Return what a ``map.yaml`` says.

    Raises
    ------
    FileMalformed
        If a value is missing, of a wrong kind, or outside its range.
    NotFinite
        If a number is not finite.
    """
    said = parse_plain_yaml(text, name, bounds=bounds)
    image = said.get("image")
    parts_of(image, name)
    resolution = _number(said, "resolution", name)
    if not 0.0 < resolution <= 10.0:
        raise FileMalformed(f"The resolution in {name} is {resolution:g} m a cell; it lies between 0 and 10.")
    origin = said.get("origin", [0.0, 0.0, 0.0])
    if not isinstance(origin, list) or len(origin) not in (2, 3):
        raise FileMalformed(f"The origin in {name} is no list of x, y and yaw.")
    x, y, yaw = (_finite(v, "origin", name) for v in [*origin, 0.0][:3])
    mode = said.get("mode", "trinary")
    if mode not in _MODES:
        raise FileMalformed(f"The mode in {name} is {str(mode)[:40]!r}; it is one of {', '.join(_MODES)}.")
    occupied, free = (
        _number(said, k, name, d) for k, d in (("occupied_thresh", 0.65), ("free_thresh", 0.25))
    )
    if not 0.0 <= free < occupied <= 1.0:
        raise FileMalformed(
            f"The thresholds in {name} are {free:g} (free) and {occupied:g} (occupied); "
            "0 <= free < occupied <= 1."
        )
    negate = bool(_number(said, "negate", name, 0.0))
    return MapHeader(str(image), resolution, (x, y, yaw), negate, occupied, free, str(mode))


def _number(said: dict[str, Any], key: str, name: str, default: float | None = None) -> float:
    value = said.get(key, default)
    if value is None:
        raise FileMalformed(f"{name} has no {key}.")
    return _finite(value, key, name)


def _finite(value: Any, key: str, name: str) -> float:
    if isinstance(value, str) and _NUMBER.fullmatch(value):  # 5e-2 has no point, and is text in YAML 1.1
        value = float(value)
    if not isinstance(value, int | float):
        raise FileMalformed(f"The {key} in {name} is no number: {str(value)[:40]!r}.")
    if not math.isfinite(value):
        raise NotFinite(f"The {key} in {name} is not a finite number.")
    return float(value)


def _cells(image: bytes, header: MapHeader, bounds: Bounds) -> tuple[NDArray[np.bool_], int]:
    """Return which cells are occupied, (H, W), row 0 at the top, and how many are unknown."""
    shade, clear = decode_shades(image, f"The image {header.image}", bounds=bounds)
    if header.mode == "raw":
        value = shade * 255.0
        known = value <= 100.0
        occupied = known & (value >= 100.0 * header.occupied_thresh)
        return occupied, int((~known).sum())
    probability = shade if header.negate else 1.0 - shade
    occupied = ~clear & (probability > header.occupied_thresh)
    unknown = clear | ~occupied & (probability >= header.free_thresh)
    return occupied, int(unknown.sum())


def _scale(header: MapHeader, size: tuple[float, float], hint: ScaleHint | None) -> Scale:
    cell, extent = header.resolution, max(size)
    witnesses = [
        Witness("file-unit", cell, cell, f"The map's YAML states {cell:g} m a cell."),
        Witness(
            "extent",
            _EXTENT[0] / (extent / cell),
            _EXTENT[1] / (extent / cell),
            f"The map is {extent / cell:.0f} cells long; {extent:.0f} m is a size that buildings have.",
        ),
    ]
    return decide(witnesses, hint=hint, units=(cell,))


def _robot_map(header: MapHeader) -> Finding:
    x, y, yaw = header.origin
    return Finding(
        "robot-map",
        "warning",
        "This is a robot's scan map and not a design drawing: it shows what stood there when the robot "
        "passed, furniture and noise included, and nothing that it did not see. Its lower left corner lies "
        f"at ({x:g}, {y:g}) m, turned by {math.degrees(yaw):g} degrees, in the robot's frame: give these as "
        "map-from-drawing to keep that frame.",
        {"x_m": x, "y_m": y, "yaw_rad": yaw, "resolution_m": header.resolution},
    )


def _in_scale(reading: Reading, header: MapHeader, scale: Scale) -> Reading:
    """Return the reading at the scale that was decided; in cells where there is none."""
    if scale.metres_per_unit is None:
        unknown = Finding(
            "scale-unknown",
            "serious",
            f"{header.resolution:g} m a cell makes no building of a usual size: coordinates are cells.",
        )
        return replace(reading.scaled(1.0 / header.resolution), findings=(*reading.findings, unknown))
    factor = scale.metres_per_unit / header.resolution
    return reading if factor == 1.0 else reading.scaled(factor)
