"""A scan made upright: metres, z up, levelled, its floor and ceiling found and its outliers told.

Three frames, all right-handed: the *file*'s own (its unit, its axes); `scan`, which is the file's axes in
metres, less `origin` if the file lies far off; and `upright`, which is `scan` turned about its origin so that
z is up. A placement says where `scan` is: ``T_map_scan = T_map_upright @ T_upright_scan``. For a file that is
in metres, z up and level, all three are the same.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from service.domain.errors import CoordinatesTooLarge
from service.domain.findings import Finding
from service.domain.scan_options import ScanOptions
from service.domain.scan_reading import AxisChoice, ScanFrameReading, UnitChoice
from service.domain.transform import Transform
from worker.geometry.cloud.point_cloud import PointCloud
from worker.geometry.scan.choice import Choice
from worker.geometry.scan.file_scan import FileScan
from worker.geometry.scan.levels import Levels, find_levels
from worker.geometry.scan.mesh_sampling import Mesh
from worker.geometry.scan.outliers import find_outliers
from worker.geometry.scan.surface_sample import sample_surfaces
from worker.geometry.scan.units import find_unit
from worker.geometry.scan.up_axis import find_up_axis, turn_upright

_FAR_OFF = 10_000.0
_FARTHEST = 8_192.0
"""How far a scan reaches at most from its middle [m]: up to here float32 tells half a millimetre apart."""

_LEAST_TILT, _MOST_TILT = np.deg2rad(2.0), np.deg2rad(12.0)
_LARGEST, _SMALLEST = 500.0, 0.3


@dataclass(frozen=True, eq=False)
class ScanFrame:
    """Hold how a file's coordinates become metres with z up, and why.

    Parameters
    ----------
    kind : str
        The file's format.
    up : Choice of str
        The file's axis that is up.
    unit : Choice of float
        Metres that one unit of the file counts.
    origin : tuple of float
        Where the file's axes, in metres, have the origin of frame `scan`; zero unless the file lies far off.
    T_upright_scan : Transform
        The turn that makes it upright, and levels it if it was tilted.
    tilt : float
        Angle of floor and ceiling against the level before they were levelled [rad].
    floor, ceiling : float or None
        Their heights in frame `upright` [m].
    """

    kind: str
    up: Choice[str]
    unit: Choice[float]
    origin: tuple[float, float, float]
    T_upright_scan: Transform
    tilt: float
    floor: float | None
    ceiling: float | None

    @property
    def levelled(self) -> bool:
        """Whether the tilt was large enough to be taken out, and small enough to be one."""
        return bool(_LEAST_TILT <= self.tilt <= _MOST_TILT)

    def told(self) -> ScanFrameReading:
        """Return the frame as a reading tells it."""
        return ScanFrameReading(
            kind=self.kind,
            up=AxisChoice(self.up.value, self.up.source, self.up.evidence),
            metres_per_unit=UnitChoice(self.unit.value, self.unit.source, self.unit.evidence),
            origin_m=self.origin,
            T_upright_scan=self.T_upright_scan,
            tilt_deg=round(float(np.rad2deg(self.tilt)), 3),
            levelled=self.levelled,
            floor_height_m=None if self.floor is None else round(self.floor, 3),
            ceiling_height_m=None if self.ceiling is None else round(self.ceiling, 3),
        )

    @classmethod
    def from_json(cls, value: Mapping[str, Any]) -> ScanFrame:
        """Return the frame that `told` is about; tilt and heights have the digits that it kept."""
        x, y, z = value["origin_m"]
        return cls(
            kind=value["kind"],
            up=Choice.from_json(value["up"]),
            unit=Choice.from_json(value["metres_per_unit"]),
            origin=(x, y, z),
            T_upright_scan=Transform.of(value["T_upright_scan"]),
            tilt=float(np.deg2rad(value["tilt_deg"])),
            floor=value["floor_height_m"],
            ceiling=value["ceiling_height_m"],
        )


@dataclass(frozen=True, eq=False)
class UprightScan:
    """Hold a scan's points and how to see them upright.

    Parameters
    ----------
    scan : PointCloud
        All N points in frame `scan` [m], in the file's order.
    frame : ScanFrame
        How it becomes upright.
    outliers : ndarray of shape (N,), bool
        Which of the points stand alone.
    """

    scan: PointCloud
    frame: ScanFrame
    outliers: NDArray[np.bool_]

    @cached_property
    def cloud(self) -> PointCloud:
        """Return the N points in frame `upright` [m]; `scan` itself where nothing has to be turned."""
        if np.array_equal(self.frame.T_upright_scan.matrix, np.eye(4)):
            return self.scan
        return PointCloud(self.frame.T_upright_scan.apply(self.scan.points), self.scan.labels)

    @property
    def without_outliers(self) -> PointCloud:
        """Return the points in frame `upright` [m] that do not stand alone."""
        kept = ~self.outliers
        return PointCloud(self.cloud.points[kept], self.cloud.labels[kept])

    def findings(self) -> tuple[Finding, ...]:
        """Return remarks on what was chosen and on what is doubtful."""
        return _findings(self)


def make_upright(file: FileScan, options: ScanOptions | None = None) -> UprightScan:
    """Return a scan in metres with the turn that makes it upright.

    Parameters
    ----------
    file : FileScan
        As it was read.
    options : ScanOptions, optional
        What a person gave; the rest is found.

    Raises
    ------
    CoordinatesTooLarge
        If it reaches farther, in the unit that was given or found, than any site does.
    ValueError
        If the file holds no point.
    """
    options = options or ScanOptions()
    coarse = file.coarse()
    if not len(coarse):
        msg = "a scan has one point or more"
        raise ValueError(msg)
    sample = sample_surfaces(coarse)
    said = file.statement
    up = (
        Choice(options.up, "given", ("Given with the scan.",))
        if options.up is not None
        else find_up_axis(sample, stated=said.up, stated_by=said.said_by)
    )
    turn = turn_upright(up.value)
    levels = find_levels(sample, turn)
    unit = (
        Choice(options.metres_per_unit, "given", ("Given with the scan.",))
        if options.metres_per_unit is not None
        else find_unit(sample.points @ turn.T, levels, stated=said.metres_per_unit, stated_by=said.said_by)
    )
    if isinstance(file.surface, Mesh):
        _check_reach(0.5 * np.ptp(file.surface.vertices, axis=0) * unit.value, unit)
    cloud, origin = _near(file.cloud(unit.value))
    if _LEAST_TILT <= levels.tilt_angle <= _MOST_TILT:
        turn = _levelling(np.array(levels.tilt)) @ turn
        levels_now = find_levels(sample, turn)
        levels = Levels(levels_now.floor, levels_now.ceiling, levels.tilt)
    frame = _frame(file, up, unit, origin, turn, levels)
    outliers = find_outliers(cloud.points)
    _check_reach(np.abs(cloud.points[~outliers]).max(axis=0), unit)
    return UprightScan(cloud, frame, outliers)


def _check_reach(reach: NDArray[np.float64], unit: Choice[float]) -> None:
    """Refuse a scan that reaches over (3,) half extents [m] that float32 and voxels cannot hold."""
    if float(reach.max()) > _FARTHEST:
        raise CoordinatesTooLarge(
            f"The scan reaches {reach.max():.4g} m from its middle, one unit of the file being "
            f"{unit.value:g} m; at most {_FARTHEST:g} m are read. Give the file's unit, or cut off what lies "
            "far away.",
            reach_m=round(float(reach.max()), 3),
        )


def _frame(
    file: FileScan,
    up: Choice[str],
    unit: Choice[float],
    origin: NDArray[np.float64],
    turn: NDArray[np.float64],
    levels: Levels,
) -> ScanFrame:
    matrix = np.eye(4)
    matrix[:3, :3] = turn
    lower = float(turn[2] @ origin)
    floor, ceiling = (None if h is None else h * unit.value - lower for h in (levels.floor, levels.ceiling))
    x, y, z = (float(v) for v in origin)
    return ScanFrame(file.kind, up, unit, (x, y, z), Transform(matrix), levels.tilt_angle, floor, ceiling)


def _near(cloud: PointCloud) -> tuple[PointCloud, NDArray[np.float64]]:
    """Return the cloud, moved near by whole hundreds of metres if float32 could not hold it, and the move."""
    middle = 0.5 * (cloud.points.min(axis=0) + cloud.points.max(axis=0))
    if float(np.abs(middle).max()) < _FAR_OFF:
        return cloud, np.zeros(3)
    origin = np.round(middle, -2)
    return PointCloud(cloud.points - origin, cloud.labels), origin


def _levelling(normal: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (3, 3) smallest rotation that takes a unit vector to z (Rodrigues)."""
    axis = np.cross(normal, [0.0, 0.0, 1.0])
    cross = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    turn = np.eye(3) + cross + cross @ cross / (1.0 + float(normal[2]))
    u, _, vt = np.linalg.svd(turn)
    return np.asarray(u @ vt, dtype=np.float64)


def _findings(upright: UprightScan) -> tuple[Finding, ...]:
    frame = upright.frame
    points = upright.scan.points
    largest = float((points.max(axis=0) - points.min(axis=0)).max())
    tilt_deg = float(np.rad2deg(frame.tilt))
    unit = {"metres_per_unit": frame.unit.value}
    found = []
    if frame.up.source != "given" and frame.up.value != "z":
        message = f"The scan's {frame.up.value} axis is up; it was turned so that z is."
        found.append(Finding("scan-turned-upright", "info", message, {"up": frame.up.value}))
    if frame.up.source == "assumed" and len(frame.up.evidence) > 1:
        message = f"The scan's up axis is doubtful: {frame.up.evidence[0]}"
        found.append(Finding("scan-up-axis-doubtful", "warning", message, {"up": frame.up.value}))
    if frame.unit.source == "assumed" and frame.unit.evidence[-1].endswith("as well as m."):
        found.append(Finding("scan-units-doubtful", "warning", frame.unit.evidence[-1], unit))
    if frame.unit.source == "found" and frame.unit.value != 1.0:
        message = f"One unit of the scan was found to be {frame.unit.value:g} m: {frame.unit.evidence[0]}"
        found.append(Finding("scan-unit-found", "warning", message, unit))
    if frame.levelled:
        message = f"The scan's floor and ceiling were tilted by {tilt_deg:.1f} degrees; they were levelled."
        found.append(Finding("scan-levelled", "info", message, {"tilt_rad": frame.tilt}))
    elif frame.tilt > _MOST_TILT:
        message = f"The scan's level surfaces are tilted by {tilt_deg:.0f} degrees; it was left as it is."
        found.append(Finding("scan-tilt-doubtful", "warning", message, {"tilt_rad": frame.tilt}))
    if any(frame.origin):
        x, y, z = frame.origin
        message = f"The scan lies far off its origin; it is read relative to ({x:.0f}, {y:.0f}, {z:.0f}) m."
        found.append(Finding("scan-moved-near", "info", message, {"origin_m": frame.origin}))
    if not _SMALLEST <= largest <= _LARGEST:
        message = (
            f"The scan reaches over {largest:.3g} m: its unit is probably another than "
            f"{frame.unit.value:g} m."
        )
        found.append(Finding("scan-units-doubtful", "warning", message, {**unit, "extent_m": largest}))
    if (alone := int(upright.outliers.sum())) > 0:
        message = f"{alone} points of the scan stand alone and are not used."
        found.append(Finding("scan-outliers", "info", message, {"points": alone}))
    return tuple(found)
