"""Whether a sheet of pixels is a drawing at all: a photo and a robot's own map are not."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from service.domain.errors import NotADrawing
from service.domain.findings import Finding

_SIDE = 1000
_WINDOW_SHARE = 20
_PAPER, _MIDDLE = 0.88, (0.25, 0.82)
_PATCH = 7
_FLAT = 1.5
_LEAST_SIDE = 48
_REFUSED_PAPER, _REFUSED_TONES = 0.5, 0.05
_DOUBTED_PAPER, _DOUBTED_TONES = 0.65, 0.03


@dataclass(frozen=True)
class Tones:
    """Hold how the brightness of a sheet is spread, in shares of its pixels.

    Parameters
    ----------
    paper : float
        As bright as the brightest nearby, within 12 %: bare paper.
    tones : float
        In the midst of middle tones (25 to 82 % of the paper) that are not flat: what a photo is made of and
        no drawing. Edges of lines, flat fills and grey paper do not count.
    """

    paper: float
    tones: float


def check_sheet(grey: NDArray[np.uint8]) -> tuple[Finding, ...]:
    """Return remarks on a sheet that may be no drawing.

    Parameters
    ----------
    grey : ndarray of shape (H, W), uint8
        255 is bare paper.

    Raises
    ------
    NotADrawing
        If it is a photo or another picture of continuous tones.

    Notes
    -----
    Looked at with at most about 1000 pixels a side; about 30 ms for any sheet.
    """
    robot_map = robot_map_finding(grey)
    if robot_map is not None:
        return (robot_map,)
    if min(grey.shape) < _LEAST_SIDE:
        return ()
    found = tones_of(grey)
    told = {"paper": round(found.paper, 3), "tones": round(found.tones, 3)}
    if found.paper < _REFUSED_PAPER and found.tones > _REFUSED_TONES:
        raise NotADrawing(
            f"The picture has continuous tones, as a photo has: only {found.paper:.0%} of it is as bright as "
            "bare paper. Scan the drawing, or photograph it so that the sheet fills the picture.",
            **told,
        )
    if found.paper < _DOUBTED_PAPER and found.tones > _DOUBTED_TONES:
        message = (
            "Much of the picture has continuous tones, as a photo has: what was found there may be no wall."
        )
        shares = {"paper_share": told["paper"], "tones_share": told["tones"]}
        return (Finding("photo-like", "serious", message, shares),)
    return ()


def tones_of(grey: NDArray[np.uint8]) -> Tones:
    """Return how the brightness of a (H, W) sheet is spread, against its local paper."""
    small = _reduced(grey)
    window = max(9, max(small.shape) // _WINDOW_SHARE) | 1
    paper = cv2.blur(cv2.dilate(small, np.ones((window, window), np.uint8)), (window, window))
    against = small.astype(np.float32) / np.maximum(paper, 1)
    middle = ((against > _MIDDLE[0]) & (against < _MIDDLE[1])).astype(np.uint8)
    within = cv2.erode(middle, np.ones((_PATCH, _PATCH), np.uint8)) > 0
    value = small.astype(np.float32)
    variance = cv2.blur(value * value, (5, 5)) - cv2.blur(value, (5, 5)) ** 2
    return Tones(float((against > _PAPER).mean()), float((within & (variance > _FLAT**2)).mean()))


def robot_map_finding(grey: NDArray[np.uint8]) -> Finding | None:
    """Return the finding ``robot-map`` for an occupancy grid saved as an image, else None.

    Such a map has three shades (occupied, free, and a middle one for the unknown) and lies within the
    unknown, which reaches its edges; a drawing lies on bare paper.
    """
    step = max(1, max(grey.shape) // (2 * _SIDE))
    seen = grey[::step, ::step]
    share = np.bincount(seen.ravel(), minlength=256) / seen.size
    unknown = 90 + int(share[90:226].argmax())
    near = slice(unknown - 3, unknown + 4)
    border = np.concatenate([grey[0], grey[-1], grey[:, 0], grey[:, -1]]).astype(np.int64)
    lies_in_it = float((np.abs(border - unknown) <= 3).mean())
    known = float(share[near].sum() + share[240:].sum() + share[:16].sum())
    free = float(share[unknown + 4 :].sum())
    if share[near].sum() < 0.1 or lies_in_it < 0.5 or known < 0.9 or free < 0.03:
        return None
    return Finding(
        "robot-map",
        "serious",
        "This looks like a map that a robot made with its own scanner, not like a design drawing: "
        f"{share[near].sum():.0%} of it is the grey of unknown space. Its walls are thick and broken, and "
        "what stood in the way of the robot is among them.",
        {"unknown_share": round(float(share[near].sum()), 3), "unknown_level": unknown},
    )


def _reduced(grey: NDArray[np.uint8]) -> NDArray[np.uint8]:
    k = max(1, max(grey.shape) // _SIDE)
    size = (max(1, grey.shape[1] // k), max(1, grey.shape[0] // k))
    return np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
