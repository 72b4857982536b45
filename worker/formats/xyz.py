"""Points as text (XYZ, PTS, CSV): a point a line; the separator, the header and the columns are found."""

from __future__ import annotations

import io
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from service.domain.bounds import Bounds
from service.domain.errors import FileEmpty, FileMalformed, FileTruncated, HeaderMismatch
from worker.formats.scan_checks import check_count, cloud_of
from worker.geometry.scan.file_scan import FileScan, Statement

_HEAD_BYTES = 65_536
_MOST_HEADER_LINES = 20
_MOST_COLUMNS = 64
_SEPARATORS = (";", "\t", ",", " ")
_NAMES = {
    "x": ("x", "//x", "#x", "x_m", "pos_x", "posx", "position_x", "easting", "east", "coord. x"),
    "y": ("y", "y_m", "pos_y", "posy", "position_y", "northing", "north", "coord. y"),
    "z": ("z", "z_m", "pos_z", "posz", "position_z", "height", "elevation", "altitude", "coord. z"),
}
_UNIT = re.compile(r"^(.*?)\s*[\[(](m|cm|mm|ft)[\])]$")
_METRES = {"m": 1.0, "cm": 0.01, "mm": 0.001, "ft": 0.3048}


@dataclass(frozen=True)
class _Layout:
    """Hold how the lines are to be read."""

    separator: str
    decimal_comma: bool
    skip: int
    columns: tuple[int, int, int]
    width: int
    promised: int | None
    unit: str | None


def load_xyz(path: Path, *, bounds: Bounds) -> FileScan:
    """Return the points of a text file of numbers.

    Lines end anyhow; ``#`` and ``//`` begin a remark. Columns are separated by semicolons, tabs, commas or
    spaces, and numbers with a decimal comma are read where the separator is another. A header may name the
    columns (``x``, ``y``, ``z``, also with a unit: ``x [mm]``); else the first three are taken. A first line
    of one whole number is a PTS file's number of points.

    Raises
    ------
    FileEmpty
        If there is no line of numbers.
    FileTruncated
        If the last line is cut, or a PTS file holds fewer points than it promises.
    HeaderMismatch
        If a PTS file holds more points than it promises.
    FileMalformed
        If a line is no row of the table.
    TooManyPoints
        If there are more points than `bounds` allows.
    NotFinite
        If a coordinate is NaN or infinite.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(_HEAD_BYTES)
        lines = head.decode("utf-8-sig", errors="replace").splitlines()
        layout = _layout(lines[:-1] if size > len(head) else lines)
        if layout.promised is not None:
            check_count(layout.promised, bounds=bounds)
            if size < (needed := 6 * layout.promised):
                raise FileTruncated(
                    f"The file's first line promises {layout.promised} points, which need {needed} bytes or"
                    f" more; the file has {size}."
                )
        file.seek(0)
        points = _table(file, layout, bounds=bounds, ends_in_newline=_ends_in_newline(path, size))
    if layout.promised is not None and len(points) != layout.promised:
        leaf = FileTruncated if len(points) < layout.promised else HeaderMismatch
        raise leaf(f"The file's first line promises {layout.promised} points; it holds {len(points)}.")
    unit = None if layout.unit is None else _METRES[layout.unit]
    said = "" if unit is None else f"The file's header names the unit {layout.unit}."
    return FileScan(cloud_of(points), "XYZ", Statement(metres_per_unit=unit, said_by=said))


def _layout(lines: list[str]) -> _Layout:
    """Return the layout by the first lines: what stands above the first row of three numbers is header."""
    for skip, line in enumerate(lines[: _MOST_HEADER_LINES + 1]):
        plain = _without_remark(line)
        for separator in _SEPARATORS:
            for comma in (False, True) if separator != "," else (False,):
                numbers = _numbers(plain, separator, decimal_comma=comma)
                if numbers is not None and 3 <= len(numbers) <= _MOST_COLUMNS:
                    header = [_remarked(text) for text in lines[:skip]]
                    return _with_header(separator, header, decimal_comma=comma, width=len(numbers))
    raise FileEmpty(
        f"No row of three numbers was found in the first {_MOST_HEADER_LINES} lines of the text file."
    )


def _with_header(separator: str, header: list[str], *, decimal_comma: bool, width: int) -> _Layout:
    words = [text for text in header if text]
    promised = int(words[-1]) if len(words) == 1 and words[0].isdigit() else None
    columns, unit = (0, 1, 2), None
    for text in reversed(words):
        named = _named_columns(text, separator)
        if named is not None:
            columns, unit = named
            break
    if max(columns) >= width:
        raise HeaderMismatch(f"The header names more columns than the {width} that the first row has.")
    return _Layout(separator, decimal_comma, len(header), columns, width, promised, unit)


def _named_columns(text: str, separator: str) -> tuple[tuple[int, int, int], str | None] | None:
    """Return where a header says that x, y and z stand, and their unit; None if it does not say."""
    parts = text.split() if separator == " " else text.split(separator)
    names, units = [], []
    for part in parts:
        name = part.strip().strip('"').lower()
        match = _UNIT.match(name)
        names.append(match.group(1).strip() if match else name)
        units.append(match.group(2) if match else None)
    found = [next((i for i, name in enumerate(names) if name in _NAMES[axis]), None) for axis in "xyz"]
    x, y, z = found
    if x is None or y is None or z is None:
        return None
    return (x, y, z), units[x] if units[x] == units[y] == units[z] else None


def _without_remark(line: str) -> str:
    for mark in ("#", "//"):
        line = line.split(mark, 1)[0]
    return line.strip()


def _remarked(line: str) -> str:
    """Return a header line without the marks of a remark: CloudCompare writes its header as one."""
    return line.strip().lstrip("#/").strip()


def _numbers(line: str, separator: str, *, decimal_comma: bool) -> list[float] | None:
    parts = line.split() if separator == " " else [part.strip() for part in line.split(separator)]
    if parts and not parts[-1]:
        parts = parts[:-1]
    try:
        return [float(part.replace(",", ".") if decimal_comma else part) for part in parts]
    except ValueError:
        return None


def _ends_in_newline(path: Path, size: int) -> bool:
    with path.open("rb") as file:
        file.seek(max(0, size - 1))
        return file.read(1) in {b"\n", b"\r"}


def _table(
    file: io.BufferedReader, layout: _Layout, *, bounds: Bounds, ends_in_newline: bool
) -> NDArray[np.float64]:
    """Return (N, 3) of the rows below the header."""
    source: io.BufferedReader | io.BytesIO = file
    if layout.decimal_comma:
        source = io.BytesIO(file.read().replace(b",", b"."))
    try:
        table = np.loadtxt(
            source, skiprows=layout.skip, usecols=layout.columns, ndmin=2, comments=("#", "//"),
            max_rows=bounds.max_points + 1, encoding="utf-8",
            delimiter=None if layout.separator == " " else layout.separator,
        )  # fmt: skip
    except (ValueError, UnicodeDecodeError) as error:
        if not ends_in_newline and _fails_at_the_end(file, error):
            raise FileTruncated(
                "The last line of the text file is cut: it has fewer numbers than others."
            ) from error
        raise FileMalformed(f"The text file is no table of numbers: {str(error)[:200]}.") from error
    check_count(len(table), bounds=bounds)
    return np.asarray(table, dtype=np.float64).reshape(-1, 3)


def _fails_at_the_end(file: io.BufferedReader, error: Exception) -> bool:
    """Whether the row that an error names is the file's last line of numbers."""
    match = re.search(r"(?:row|at line) (\d+)", str(error))
    if match is None:
        return False
    file.seek(0)
    rows = sum(1 for line in file if _without_remark(line.decode("utf-8", errors="replace")))
    return rows - int(match.group(1)) <= _MOST_HEADER_LINES
