"""A vector drawing as straight segments with what its file says of each: layer, pen, class."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from service.domain.findings import Finding
from worker.geometry.drawing.scale.decision import Witness
from worker.geometry.drawing.text import Text


@dataclass(frozen=True)
class Dimension:
    """Hold a dimension of a vector file: two measured points [drawing units], and what is written there.

    Parameters
    ----------
    start, end : tuple of float
        The measured points; the measured length is along the dimension's own direction.
    length : float
        Measured length [drawing units].
    shown : str
        The text on the sheet, empty where the file leaves it to the program.
    layer : str
        The file's layer.
    """

    start: tuple[float, float]
    end: tuple[float, float]
    length: float
    shown: str = ""
    layer: str = ""


@dataclass(frozen=True, eq=False)
class Linework:
    """Hold S segments that come from E entities (a line, a polyline, an arc, a hatch ...).

    Parameters
    ----------
    ends : ndarray of shape (S, 2, 2), float64
        Start and end [drawing units], x right, y up; curves are flattened by the loader.
    entity : ndarray of shape (S,), int64
        Index of the segment's entity; the segments of one entity are consecutive, in drawing order.
    kind : ndarray of shape (E,), str
        ``line``, ``polyline``, ``arc``, ``circle``, ``ellipse``, ``spline``, ``hatch``, ``solid``,
        ``dimension``, ``leader``, ``insert``, ``mask`` (a white area that hides what was drawn
        before); or the class that a building model gives: ``wall``, ``column``, ``door``, ``window``,
        ``stair``, ``slab``, ``space``, ``furniture``.
    layer : ndarray of shape (E,), int64
        Index into `layer_names`.
    width : ndarray of shape (E,), float64
        Width of the pen [mm on paper]; NaN where the file does not say.
    colour : ndarray of shape (E,), uint32
        0xRRGGBB.
    dashed, filled, closed : ndarray of shape (E,), bool
        Whether the line is dashed, the outline filled, the outline closed.
    layer_names : tuple of str
        The file's layers as it spells them.
    texts : tuple of Text
        In drawing units, y up.
    dimensions : tuple of Dimension
        What the file itself measures.
    arcs : ndarray of shape (A, 5), float64
        Circular arcs before they were flattened: centre x, y, radius [drawing units], start and sweep [rad].
        Door swings are among them: witnesses of the scale.
    sheet : tuple of float, optional
        Left, bottom, right, top of the page [drawing units], where the file has a page.
    page_mm_per_unit : float, optional
        Millimetres of paper in a drawing unit, where the file has a page.
    witnesses : tuple of Witness
        What the file states of its unit or scale [m a drawing unit].
    findings : tuple of Finding
        Remarks of the loader: recovered errors, missing references, skipped entities.
    """

    ends: NDArray[np.float64]
    entity: NDArray[np.int64]
    kind: NDArray[np.str_]
    layer: NDArray[np.int64]
    width: NDArray[np.float64]
    colour: NDArray[np.uint32]
    dashed: NDArray[np.bool_]
    filled: NDArray[np.bool_]
    closed: NDArray[np.bool_]
    layer_names: tuple[str, ...]
    texts: tuple[Text, ...] = ()
    dimensions: tuple[Dimension, ...] = ()
    arcs: NDArray[np.float64] | None = None
    sheet: tuple[float, float, float, float] | None = None
    page_mm_per_unit: float | None = None
    witnesses: tuple[Witness, ...] = ()
    findings: tuple[Finding, ...] = ()
