"""Lines of text on a sheet: where letters stand in a row, in any direction, before anybody reads them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

_WORK_PIXELS = 20_000_000
_LEAST_SIZE, _MOST_SIZE = 7, 150
_LEAST_CONTRAST = 30.0
_REACH, _BRIDGED, _SAME_SIZE, _ROW_GAP = 1.45, 2.6, 2.0, 0.55
_SLENDER, _THIN_STROKE = 3.5, 0.06
_MOST_LETTERS, _MOST_LINES, _MOST_MARKS = 12_000, 1_500, 50_000
_TWO_ROWS, _SPACE = 1.75, 1.3
_MARGIN = 0.22
_CROP_HEIGHT = 48


@dataclass(frozen=True, eq=False)
class InkMap:
    """Hold a sheet at working resolution: its ink, and the connected parts of the ink.

    Parameters
    ----------
    grey : ndarray of shape (H, W), uint8
        The sheet as it came.
    factor : int
        Pixels of the sheet in a working pixel, along one side.
    mask : ndarray of shape (h, w), uint8
        1 where there is ink.
    labels : ndarray of shape (h, w), int32
        The connected part of each pixel, 0 for paper.
    stats : ndarray of shape (P, 5), int32
        Left, top, width, height, area of each part; row 0 is the paper.
    """

    grey: NDArray[np.uint8]
    factor: int
    mask: NDArray[np.uint8]
    labels: NDArray[np.int32]
    stats: NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class TextLine:
    """Hold one row of letters in working pixels, y down.

    Parameters
    ----------
    x, y : float
        Its middle.
    width, height : float
        Along and across the direction of reading.
    angle : float
        Direction of reading [rad], clockwise as seen on the sheet, in (-pi/2, pi/2].
    parts : ndarray of int
        The connected parts that are its letters.
    """

    x: float
    y: float
    width: float
    height: float
    angle: float
    parts: NDArray[np.int64]

    @property
    def along(self) -> NDArray[np.float64]:
        """Return the unit vector of the direction of reading."""
        return np.array([math.cos(self.angle), math.sin(self.angle)])


def map_ink(grey: NDArray[np.uint8]) -> InkMap:
    """Return the ink of a sheet at a resolution where letters can still be read.

    Ink is what is clearly darker than the paper around it. At most some 20 million pixels are looked at:
    a larger sheet is averaged down by a whole factor.
    """
    factor = max(1, math.ceil(math.sqrt(grey.size / _WORK_PIXELS)))
    work: NDArray[np.uint8] = grey
    if factor > 1:
        size = (grey.shape[1] // factor, grey.shape[0] // factor)
        whole = grey[: size[1] * factor, : size[0] * factor]
        work = np.asarray(cv2.resize(whole, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    contrast = np.asarray(cv2.subtract(_paper(work), work), dtype=np.uint8)
    threshold = max(_LEAST_CONTRAST, 0.35 * _strongest(contrast))
    mask = (contrast > threshold).astype(np.uint8)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8, ltype=cv2.CV_32S)
    parts = np.asarray(labels, dtype=np.int32)
    return InkMap(grey, factor, mask, parts, np.asarray(stats, dtype=np.int32))


def find_text_lines(ink: InkMap) -> list[TextLine]:
    """Return the rows of letter-sized parts of the ink; at most 1,500, the most regular first.

    Letters that touch a line of the drawing are not found; symbols in a row may be taken for text.
    """
    letters = _letter_like(ink.stats)
    if len(letters) < 2:
        return []
    lines: list[TextLine] = []
    for group in _neighbours(ink.stats, letters):
        lines += _rows(ink, group)
    lines = lines[:_MOST_LINES]
    for _ in range(2):  # a quote and the dash behind it
        lines = _with_marks(ink.stats, lines)
    return _joined(ink, lines)


def crop_line(ink: InkMap, line: TextLine, *, flipped: bool = False) -> NDArray[np.uint8]:
    """Return the pixels of a line of text, upright and 48 pixels high, without ink of its surroundings."""
    f = float(ink.factor)
    margin = _MARGIN * line.height
    wide, high = (line.width + 2 * margin) * f, (line.height + 2 * margin) * f
    zoom = _CROP_HEIGHT / high
    angle = line.angle + (math.pi if flipped else 0.0)
    along = np.array([math.cos(angle), math.sin(angle)])
    across = np.array([-along[1], along[0]])
    centre = np.array([line.x, line.y]) * f + (f - 1) / 2
    corner = centre - along * wide / 2 - across * high / 2
    size = (max(8, round(wide * zoom)), _CROP_HEIGHT)
    matrix = np.column_stack([along / zoom, across / zoom, corner])
    reach = math.hypot(wide, high) / 2 + 2
    x0, y0 = (max(0, math.floor(v - reach)) for v in centre)
    x1, y1 = math.ceil(centre[0] + reach), math.ceil(centre[1] + reach)
    patch = _without_others(ink, line, (x0, y0, x1, y1))
    matrix[:, 2] -= (x0, y0)
    shrink = max(1, int(0.7 / zoom))
    if shrink > 1:
        patch = np.asarray(cv2.blur(patch, (shrink, shrink)), dtype=np.uint8)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    border = _paper_of(patch)
    out = cv2.warpAffine(patch, matrix, size, flags=flags, borderMode=cv2.BORDER_CONSTANT, borderValue=border)
    return np.asarray(out, dtype=np.uint8)


def _paper(work: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the local colour of the bare paper."""
    step = max(1, round(max(work.shape) / 400))
    small = cv2.resize(work[::step, ::step], None, fx=1, fy=1)
    small = cv2.medianBlur(cv2.dilate(small, np.ones((5, 5), np.uint8)), 21 if min(small.shape) > 42 else 3)
    paper = cv2.resize(small, (work.shape[1], work.shape[0]), interpolation=cv2.INTER_LINEAR)
    return np.asarray(paper, dtype=np.uint8)


def _strongest(contrast: NDArray[np.uint8]) -> float:
    """Return the contrast that the darkest part of the ink reaches."""
    counts = np.bincount(contrast[::3, ::3].ravel(), minlength=256)[int(_LEAST_CONTRAST) :]
    if not counts.sum():
        return 0.0
    return float(np.searchsorted(np.cumsum(counts), 0.9 * counts.sum()) + _LEAST_CONTRAST)


def _letter_like(stats: NDArray[np.int32]) -> NDArray[np.int64]:
    """Return the parts that have the size and the ink of a letter; if too many, none too small."""
    width, height, area = stats[:, 2], stats[:, 3], stats[:, 4]
    size = np.maximum(width, height)
    good = (size >= _LEAST_SIZE) & (size <= _MOST_SIZE) & (area >= size) & (area < 0.9 * width * height + 8)
    good |= (size >= _LEAST_SIZE) & (size <= _MOST_SIZE) & (size > 2.5 * np.minimum(width, height))
    good[0] = False
    found = np.flatnonzero(good)
    if len(found) > _MOST_LETTERS:
        found = found[np.argsort(-size[found], kind="stable")[:_MOST_LETTERS]]
    return found


def _neighbours(stats: NDArray[np.int32], letters: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """Return groups of letters that stand next to each other and are of one size."""
    box = stats[letters].astype(np.float64)
    centre = box[:, :2] + box[:, 2:4] / 2
    size = np.maximum(box[:, 2], box[:, 3])
    least = np.maximum(np.minimum(box[:, 2], box[:, 3]), 1)
    slender = (size / least > _SLENDER) | (box[:, 4] / (box[:, 2] ** 2 + box[:, 3] ** 2) < _THIN_STROKE)
    found = _pairs(centre, size)
    i, j = found.T
    larger, smaller = np.maximum(size[i], size[j]), np.minimum(size[i], size[j])
    apart = np.hypot(*(centre[i] - centre[j]).T)
    near = (apart <= _REACH * larger) & (larger <= _SAME_SIZE * smaller) & ~(slender[i] & slender[j])
    i, j = i[near], j[near]
    i, j = _bridged(stats, centre, size, found, np.column_stack([i, j]))
    graph = coo_matrix((np.ones(len(i)), (i, j)), shape=(len(letters), len(letters)))
    count, label = connected_components(graph, directed=False)
    order = np.argsort(label, kind="stable")
    groups = np.split(letters[order], np.cumsum(np.bincount(label, minlength=count))[:-1])
    return [g for g in groups if 2 <= len(g) <= 400]


def _pairs(centre: NDArray[np.float64], size: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the (K, 2) pairs of letters near enough to have one other letter or mark between them."""
    pairs = [np.zeros((0, 2), dtype=np.int64)]
    for low in _LEAST_SIZE * 1.5 ** np.arange(9):
        among = np.flatnonzero((size >= low) & (size < low * 1.5 * _SAME_SIZE))
        if len(among) > 1:
            tree = cKDTree(centre[among])
            pairs.append(among[tree.query_pairs(_BRIDGED * low * 1.5, output_type="ndarray")])
    return np.asarray(np.unique(np.concatenate(pairs), axis=0), dtype=np.int64)


def _bridged(
    stats: NDArray[np.int32],
    centre: NDArray[np.float64],
    size: NDArray[np.float64],
    pairs: NDArray[np.int64],
    near: NDArray[np.int64],
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the near pairs, and those a step farther with a point, dash or quote between them."""
    i, j = pairs.T
    larger, smaller = np.maximum(size[i], size[j]), np.minimum(size[i], size[j])
    apart = np.hypot(*(centre[i] - centre[j]).T)
    far = (apart > _REACH * larger) & (apart <= _BRIDGED * larger) & (larger <= 1.4 * smaller)
    pairs, larger = pairs[far], larger[far]
    marks = _marks(stats)
    if len(pairs) and len(marks):
        box = stats[marks].astype(np.float64)
        tree = cKDTree(box[:, :2] + box[:, 2:4] / 2)
        middle = (centre[pairs[:, 0]] + centre[pairs[:, 1]]) / 2
        distance, which = tree.query(middle)
        small = np.maximum(box[which, 2], box[which, 3]) <= 0.6 * larger
        near = np.concatenate([near, pairs[(distance <= 0.7 * larger) & small]])
    return near[:, 0], near[:, 1]


def _marks(stats: NDArray[np.int32]) -> NDArray[np.int64]:
    """Return the parts that are small enough for a point, a dash or a quote."""
    size = np.maximum(stats[:, 2], stats[:, 3])
    found = np.flatnonzero((size >= 2) & (size <= 0.6 * _MOST_SIZE) & (stats[:, 4] >= 3))
    return found[found > 0][:_MOST_MARKS]


def _rows(ink: InkMap, group: NDArray[np.int64]) -> list[TextLine]:
    """Return a group of letters as one line of text, or as its several rows."""
    line = _line(ink, group)
    box = ink.stats[group].astype(np.float64)
    letter = float(np.median(np.maximum(box[:, 2], box[:, 3])))
    if line is not None and line.height <= _TWO_ROWS * letter:
        return [line]
    if len(group) < 6:
        return []
    centre = box[:, :2] + box[:, 2:4] / 2
    best: list[NDArray[np.int64]] = []
    for across in (centre[:, 1], centre[:, 0]):
        order = np.argsort(across, kind="stable")
        breaks = np.flatnonzero(np.diff(across[order]) > _ROW_GAP * letter) + 1
        rows = [group[part] for part in np.split(order, breaks) if len(part) > 1]
        if len(rows) > 1 and (not best or len(rows) < len(best)):
            best = rows
    found = [_line(ink, row) for row in best]
    return [row for row in found if row is not None and row.height <= _TWO_ROWS * letter]


def _line(ink: InkMap, group: NDArray[np.int64]) -> TextLine | None:
    """Return the box around a row of letters, None where the letters form no row."""
    box = ink.stats[group]
    x0, y0 = box[:, 0].min(), box[:, 1].min()
    x1, y1 = (box[:, 0] + box[:, 2]).max(), (box[:, 1] + box[:, 3]).max()
    if (x1 - x0) * (y1 - y0) > 4_000_000:
        return None
    inside = np.isin(ink.labels[y0:y1, x0:x1], group)
    rows, columns = np.nonzero(inside)
    points = np.column_stack([columns, rows]).astype(np.float32)
    (cx, cy), (w, h), degrees = cv2.minAreaRect(points)
    angle = math.radians(degrees)
    ends = box[:, :2] + box[:, 2:4] / 2
    if len(group) == 2:
        d = ends[1] - ends[0]
        angle = _nearest_quarter(angle, math.atan2(d[1], d[0]))
        w, h = _extent(points, angle)
    elif w < h:
        w, h, angle = h, w, angle + math.pi / 2
    if abs(math.sin(2 * angle)) < 0.12 and len(group) > 2:
        angle = math.pi / 2 * round(angle / (math.pi / 2))
        middle = (points.min(axis=0) + points.max(axis=0)) / 2
        cx, cy = float(middle[0]), float(middle[1])
        w, h = _extent(points, angle)
    angle = -((-angle + math.pi / 2) % math.pi - math.pi / 2)
    if angle > math.radians(84):  # near the vertical one reads upwards
        angle -= math.pi
    return TextLine(float(cx + x0), float(cy + y0), float(w) + 1, float(h) + 1, angle, group)


def _joined(ink: InkMap, lines: list[TextLine]) -> list[TextLine]:
    """Return the lines of text with those that stand a word's space apart in one row as one line."""
    if len(lines) < 2:
        return lines
    place = np.array([(t.x, t.y, t.width, t.height, t.angle) for t in lines])
    i, j = np.triu_indices(len(lines), 1)
    near = (
        np.hypot(*(place[i, :2] - place[j, :2]).T) <= (place[i, 2] + place[j, 2]) / 2 + _SPACE * place[i, 3]
    )
    i, j = i[near], j[near]
    a, b = place[i], place[j]
    along = np.column_stack([np.cos(a[:, 4]), np.sin(a[:, 4])])
    offset = b[:, :2] - a[:, :2]
    high = np.maximum(a[:, 3], b[:, 3])
    gap = np.abs((offset * along).sum(axis=1)) - (a[:, 2] + b[:, 2]) / 2
    across = np.abs(offset[:, 1] * along[:, 0] - offset[:, 0] * along[:, 1])
    fits = (gap <= _SPACE * high) & (gap > -1.5 * high) & (across <= 0.3 * high)
    fits &= (np.abs(np.sin(a[:, 4] - b[:, 4])) <= 0.12) & (high <= 1.5 * np.minimum(a[:, 3], b[:, 3]))
    graph = coo_matrix((np.ones(int(fits.sum())), (i[fits], j[fits])), shape=(len(lines), len(lines)))
    count, label = connected_components(graph, directed=False)
    out = []
    for group in range(count):
        members = [lines[k] for k in np.flatnonzero(label == group)]
        whole = _line(ink, np.concatenate([m.parts for m in members])) if len(members) > 1 else members[0]
        tallest = max(m.height for m in members)
        out += [whole] if whole is not None and whole.height <= 1.4 * tallest else members
    return out


def _with_marks(stats: NDArray[np.int32], lines: list[TextLine]) -> list[TextLine]:
    """Return the lines of text, longer by the quotes and points that stand right before or after them."""
    marks = _marks(stats)
    if not len(marks) or not lines:
        return lines
    box = stats[marks].astype(np.float64)
    centre = box[:, :2] + box[:, 2:4] / 2
    tree = cKDTree(centre)
    out = []
    for line in lines:
        here = tree.query_ball_point((line.x, line.y), line.width / 2 + 0.8 * line.height)
        here = [k for k in here if max(box[k, 2:4]) <= 0.6 * line.height]
        offset = centre[here] - (line.x, line.y)
        along, across = offset @ line.along, offset @ np.array([-line.along[1], line.along[0]])
        inside = (np.abs(across) <= 0.5 * line.height) & (np.abs(along) <= line.width / 2 + 0.6 * line.height)
        if not inside.any():
            out.append(line)
            continue
        half = np.array([max(box[k, 2:4]) / 2 for k in here])
        low = min(-line.width / 2, float((along - half)[inside].min()))
        high = max(line.width / 2, float((along + half)[inside].max()))
        x, y = np.array([line.x, line.y]) + line.along * (low + high) / 2
        parts = np.union1d(line.parts, marks[np.array(here)[inside]])
        out.append(replace(line, x=float(x), y=float(y), width=high - low, parts=parts))
    return out


def _paper_of(patch: NDArray[np.uint8]) -> int:
    """Return the colour of the paper in a patch: nine tenths of it are at most as light."""
    return int(np.percentile(patch[::2, ::2], 90)) if patch.size else 255


def _nearest_quarter(angle: float, wanted: float) -> float:
    """Return the angle, turned by quarters until it is nearest to the one that is wanted."""
    return angle + math.pi / 2 * round((wanted - angle) / (math.pi / 2))


def _extent(points: NDArray[np.float32], angle: float) -> tuple[float, float]:
    along = points @ np.array([math.cos(angle), math.sin(angle)])
    across = points @ np.array([-math.sin(angle), math.cos(angle)])
    return float(np.ptp(along)), float(np.ptp(across))


def _without_others(ink: InkMap, line: TextLine, box: tuple[int, int, int, int]) -> NDArray[np.uint8]:
    """Return the sheet inside a box, with ink of parts that are larger than letters painted over."""
    x0, y0, x1, y1 = box
    f = ink.factor
    patch = ink.grey[y0:y1, x0:x1].copy()
    labels = ink.labels[y0 // f : -(-y1 // f), x0 // f : -(-x1 // f)]
    if not labels.size or not patch.size:
        return patch
    others = np.unique(labels)
    others = others[(others > 0) & (ink.stats[others, 2:4].max(axis=1) > 1.4 * line.height)]
    others = np.setdiff1d(others, line.parts)
    if len(others):
        foreign = cv2.dilate(np.isin(labels, others).astype(np.uint8), np.ones((3, 3), np.uint8))
        size_px = (foreign.shape[1] * f, foreign.shape[0] * f)
        large = cv2.resize(foreign, size_px, interpolation=cv2.INTER_NEAREST)
        dy, dx = y0 - y0 // f * f, x0 - x0 // f * f
        large = large[dy : dy + patch.shape[0], dx : dx + patch.shape[1]]
        seen = patch[: large.shape[0], : large.shape[1]]
        seen[large > 0] = _paper_of(patch)
    return patch
