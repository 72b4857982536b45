"""What a revision was built from and what it holds, as `report.json` and the API tell it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from service.domain.acceptance_table import Verdict
from service.domain.drawing_options import DrawingOptions
from service.domain.drawing_reading import DrawingScale
from service.domain.evidence import PlacementEvidence
from service.domain.extent import Extent
from service.domain.findings import Finding
from service.domain.layer_part import LayerPart
from service.domain.map_state import ErasedRegion
from service.domain.measured import Measured
from service.domain.reasons import Reason
from service.domain.recipe import Recipe
from service.domain.scan_options import ScanOptions
from service.domain.transform import Transform


@dataclass(frozen=True)
class DrawingInput(Measured):
    """Hold the drawing that a map was built from.

    Parameters
    ----------
    sha256 : str
        Of the uploaded file.
    id, walls_sha256 : str, optional
        Of the drawing in the service, and of the walls that its reading found.
    name : str, optional
        Of a file on the command line.
    options : DrawingOptions, optional
        What was said of it there.
    """

    sha256: str
    id: str | None = None
    walls_sha256: str | None = None
    name: str | None = None
    options: DrawingOptions | None = None


@dataclass(frozen=True, eq=False)
class LayerInput(Measured):
    """Hold what a layer was made from.

    Parameters
    ----------
    layer_id, name : str
        The layer.
    scan_id, scan_sha256 : str
        Its scan, and the uploaded file.
    scan_options : ScanOptions
        What was said of the file.
    placed : Transform
        `T_map_scan` as the placement found it.
    T_map_scan : Transform
        Where the layer lies.
    labels_sha256 : str or None
        Which of the scan's points the map explained.
    part : LayerPart
        Which of them the layer holds.
    """

    layer_id: str
    name: str
    scan_id: str
    scan_sha256: str
    scan_options: ScanOptions
    placed: Transform
    T_map_scan: Transform
    labels_sha256: str | None
    part: LayerPart


@dataclass(frozen=True)
class BuildInputs(Measured):
    """Hold what a build started from: the drawing and its scale, layers, and erased regions."""

    drawing: DrawingInput
    scale: DrawingScale
    layers: Sequence[LayerInput] = ()
    erased: Sequence[ErasedRegion] = ()


@dataclass(frozen=True)
class MapCounts(Measured):
    """Hold how much a map holds: points in all and by label, walls and columns.

    Parameters
    ----------
    points : int
        Of the cloud.
    points_by_label : mapping of str to int
        ``wall``, ``ceiling``, ``floor`` and ``layer``.
    walls, columns : int
        What is left of them where regions are erased.
    wall_length_m : float
        Of all walls together.
    """

    points: int
    points_by_label: Mapping[str, int]
    walls: int
    columns: int
    wall_length_m: float


@dataclass(frozen=True)
class BuiltLayer(Measured):
    """Hold a layer of a built map, how it was judged, and who took it in.

    Parameters
    ----------
    name : str
        What people call it.
    points_given : int
        Points of its part of the scan, before they were filtered.
    layer_id, placement_id : str or None
        The layer, and the placement that it holds; None on the command line, as all that follows.
    verdict : {"accepted", "needs-review", "rejected"} or None
        On the placement.
    reasons : list of Reason or None
        For the verdict.
    evidence : PlacementEvidence or None
        What was measured of the placement.
    covariance : tuple of 6 tuples of 6 float, or None
        Of the placement's pose, as in the evidence.
    accepted_by : str or None
        The key that took the placement into the map.
    accepted_at : str or None
        When (RFC 3339, UTC).
    """

    name: str
    points_given: int
    layer_id: str | None
    placement_id: str | None
    verdict: Verdict | None
    reasons: Sequence[Reason] | None
    evidence: PlacementEvidence | None
    covariance: tuple[tuple[float, ...], ...] | None
    accepted_by: str | None
    accepted_at: str | None

    @classmethod
    def unjudged(cls, name: str) -> BuiltLayer:
        """Return a layer of which no more than its name is known."""
        return cls(name, 0, None, None, None, None, None, None, None, None)


@dataclass(frozen=True, eq=False)
class BuildReport(Measured):
    """Hold what a map was built from, and what it holds.

    Parameters
    ----------
    frame : str
        ``map``.
    inputs : BuildInputs
        What the build started from.
    recipe : Recipe
        How it was built.
    drawing_origin : tuple of 2 float, or None
        Where the origin of the reading's frame lies in the drawing file's own coordinates [m]; None where
        the reading that the revision was made from did not keep it.
    T_map_drawing : Transform or None
        4x4, row by row: takes the drawing file's own coordinates to frame `map`. A point of the file at
        (x, y), in its units or pixels, is (m x, m y, 0) for it, or (m x, -m y, 0) where the file's y runs
        downwards, with m the `metres_per_unit` of the scale. None where the origin is.
    counts : MapCounts
        How much it holds.
    layers : list of BuiltLayer
        The visible ones, in their order.
    extent_m : Extent
        Of the cloud, in frame `map`.
    findings : list of Finding
        Remarks of the build, and of the reading on the command line.
    """

    frame: Literal["map"]
    inputs: BuildInputs
    recipe: Recipe
    drawing_origin: tuple[float, float] | None
    T_map_drawing: Transform | None
    counts: MapCounts
    layers: Sequence[BuiltLayer]
    extent_m: Extent
    findings: Sequence[Finding]
