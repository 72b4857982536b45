"""What was read from a drawing, as `reading.json` and the API tell it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from service.domain.findings import Finding
from service.domain.measured import Measured, as_json

ScaleState = Literal["given", "found", "unknown"]


@dataclass(frozen=True)
class ScaleWitness(Measured):
    """Hold one independent hint at the scale.

    Parameters
    ----------
    kind : str
        What spoke: ``given-length``, ``title-block``, ``scale-bar``, ``file-unit`` and others.
    metres_per_unit : float or two of them
        Metres a pixel or drawing unit; or the lowest and the highest that the witness allows.
    detail : str
        What was seen, as a sentence.
    count : int
        How many observations it rests on.
    """

    kind: str
    metres_per_unit: float | tuple[float, float]
    detail: str
    count: int


@dataclass(frozen=True)
class ScaleCandidate(Measured):
    """Hold a scale that some witness names, and the kinds of those that allow it."""

    metres_per_unit: float
    witnesses: tuple[str, ...]


@dataclass(frozen=True)
class DrawingScale(Measured):
    """Hold what is known of a drawing's scale, and from whom.

    Parameters
    ----------
    state : {"given", "found", "unknown"}
        Said by a person; found by witnesses that agree; or neither.
    metres_per_unit : float or None
        Metres a pixel or drawing unit; None while it is unknown.
    witnesses : tuple of ScaleWitness
        Everybody who was heard, those who disagree too.
    candidates : tuple of ScaleCandidate
        For a person to choose from, the best supported first.
    """

    state: ScaleState
    metres_per_unit: float | None
    witnesses: tuple[ScaleWitness, ...] = ()
    candidates: tuple[ScaleCandidate, ...] = ()

    @classmethod
    def upgraded(cls, value: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return a stored scale with the member that it had when every drawing was pixels."""
        return {"metres_per_unit": value.get("metres_per_px"), **value}


@dataclass(frozen=True)
class SourceLayer(Measured):
    """Hold a layer of a vector file: its name as the file spells it, and as what it was taken.

    Parameters
    ----------
    name : str
        As in the file.
    role : str
        ``wall``, ``column``, ``door``, ``window``, ``text``, ``dimension``, ``hatch``, ``furniture``,
        ``stair``, ``frame``, ``grid`` or ``other``.
    reason : str
        What decided: a name rule, the geometry, or a person.
    length : float
        Length of its lines, in the reading's `unit`.
    """

    name: str
    role: str
    reason: str
    length: float


@dataclass(frozen=True)
class DrawingCounts(Measured):
    """Hold how much was found; what was not counted is left out.

    Parameters
    ----------
    walls, columns : int
        What a map is made of.
    removed, removed_strokes : mapping of str to int
        What was set aside, by layer: things, and strokes.
    wall_length_m, wall_length_px : float, optional
        Of all walls together; the latter while the scale is unknown.
    edits, edits_applied : int, optional
        A person's corrections, and those of them that fit.
    dust, specks : int, optional
        Ink too small to be anything.
    occupied_cells, unknown_cells : int, optional
        Of a map that a robot made.
    """

    walls: int
    columns: int
    removed: Mapping[str, int]
    removed_strokes: Mapping[str, int]
    wall_length_m: float | None = None
    wall_length_px: float | None = None
    edits: int | None = None
    edits_applied: int | None = None
    dust: int | None = None
    specks: int | None = None
    occupied_cells: int | None = None
    unknown_cells: int | None = None

    def to_json(self) -> dict[str, Any]:
        """Return the counts as a JSON object, with those that were made."""
        return {name: as_json(count) for name, count in vars(self).items() if count is not None}


@dataclass(frozen=True)
class DrawingReading(Measured):
    """Hold what was read from a drawing.

    Parameters
    ----------
    frame : str
        ``drawing``: x right, y up, origin at the sheet's lower left corner.
    unit : {"m", "px"}
        Of every coordinate and length; ``px`` (pixels, or drawing units) while the scale is unknown.
    scale : DrawingScale
        With its evidence.
    sheet : tuple of 2 float
        Width and height, in `unit`.
    drawing_origin : tuple of 2 float
        Where the origin of frame `drawing` lies in the file's own coordinates, in `unit`.
    drawing_top : float or None
        Where y = 0 of the file lies, in `unit`, if its y runs downwards; None where it runs up.
    confidence : float
        How sure the reading is of itself, 0 to 1.
    layers : tuple of SourceLayer
        Of a vector file, as what each was taken.
    style : str
        How walls are drawn: ``filled``, ``outlined`` or ``single-line``.
    counts : DrawingCounts
        How much was found.
    findings : tuple of Finding
        Remarks for the person who looks at it.
    """

    frame: Literal["drawing"]
    unit: Literal["m", "px"]
    scale: DrawingScale
    sheet: tuple[float, float]
    drawing_origin: tuple[float, float]
    drawing_top: float | None
    confidence: float
    layers: tuple[SourceLayer, ...]
    style: str
    counts: DrawingCounts
    findings: tuple[Finding, ...]
