"""What was read from a tablet scan, as the API tells it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from service.domain.extent import Extent
from service.domain.findings import Finding
from service.domain.measured import Measured
from service.domain.transform import Transform

Source = Literal["given", "stated", "found", "assumed"]
"""Given by a person, stated by the file, found from the points, or assumed for want of all of these."""


@dataclass(frozen=True)
class AxisChoice(Measured):
    """Hold which of the file's axes is up, who says so, and the sentences that speak for it."""

    value: str
    source: Source
    evidence: tuple[str, ...]


@dataclass(frozen=True)
class UnitChoice(Measured):
    """Hold how many metres one unit of the file counts, who says so, and what speaks for it."""

    value: float
    source: Source
    evidence: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class ScanFrameReading(Measured):
    """Hold how a file's coordinates become metres with z up, and why.

    Parameters
    ----------
    kind : str
        The file's format.
    up : AxisChoice
        The file's axis that is up.
    metres_per_unit : UnitChoice
        What its numbers count.
    origin_m : tuple of 3 float
        What was taken off, in the file's axes; zero unless the file lies far off its origin.
    T_upright_scan : Transform
        The turn that makes the scan upright, and levels it if it was tilted.
    tilt_deg : float
        Of floor and ceiling against the level, before they were levelled.
    levelled : bool
        Whether they were.
    floor_height_m, ceiling_height_m : float or None
        In frame `upright`.
    """

    kind: str
    up: AxisChoice
    metres_per_unit: UnitChoice
    origin_m: tuple[float, float, float]
    T_upright_scan: Transform
    tilt_deg: float
    levelled: bool
    floor_height_m: float | None
    ceiling_height_m: float | None


@dataclass(frozen=True)
class ViewerCloud(Measured):
    """Hold how the points for viewers are thinned: how many there are, one a voxel of this edge."""

    points: int
    voxel_size_m: float


@dataclass(frozen=True, eq=False)
class ScanReading(Measured):
    """Hold what was read from a scan.

    Parameters
    ----------
    frame : str
        ``scan``: the file's own axes, in metres.
    points : int
        All of them.
    extent_m : Extent
        In frame `scan`.
    viewer : ViewerCloud
        The points that viewers get.
    outliers : int
        Points that stand alone.
    scan_frame : ScanFrameReading
        How the file's coordinates become metres with z up.
    findings : tuple of Finding
        Remarks for the person who looks at it.
    """

    frame: Literal["scan"]
    points: int
    extent_m: Extent
    viewer: ViewerCloud
    outliers: int
    scan_frame: ScanFrameReading
    findings: tuple[Finding, ...]
