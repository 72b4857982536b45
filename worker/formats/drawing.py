"""Any drawing file to its reading: the one way that the command line and the jobs take."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from service.domain.bounds import Bounds
from service.domain.drawing_options import DrawingOptions
from service.domain.edits import LAYERS
from service.domain.errors import NoWallsFound
from service.domain.formats import (
    BMP,
    BUILDING_YAML,
    DWG,
    DXF,
    IFC,
    JPEG,
    PDF,
    PGM,
    PNG,
    ROS_MAP,
    ROS_MAP_ZIP,
    SVG,
    TIFF,
    WEBP,
    Media,
    Purpose,
)
from service.domain.media import HEAD_BYTES, accept
from worker.formats.ocr import load_recogniser
from worker.geometry.drawing.linework.linework import Linework
from worker.geometry.drawing.linework.read import read_linework
from worker.geometry.drawing.linework.units import find_unit
from worker.geometry.drawing.page.page_scale import find_page_scale
from worker.geometry.drawing.page.read import read_page
from worker.geometry.drawing.raster.read import read_raster
from worker.geometry.drawing.raster.sheet import Sheet
from worker.geometry.drawing.raster.sheet_kind import check_sheet
from worker.geometry.drawing.raster.sheet_scale import find_sheet_scale
from worker.geometry.drawing.reading.confidence import judge
from worker.geometry.drawing.reading.edits import apply_edits
from worker.geometry.drawing.reading.plans import several_plans
from worker.geometry.drawing.reading.reading import Reading

Progress = Callable[[str, float], None]


def read_drawing_file(
    path: Path,
    *,
    options: DrawingOptions,
    bounds: Bounds | None = None,
    progress: Progress | None = None,
    seen: Callable[[Sheet], None] | None = None,
) -> Reading:
    """Return the reading of a drawing file; what kind it is, its own bytes tell.

    Parameters
    ----------
    path : Path
        The file as it was uploaded.
    options : DrawingOptions
        What a person said of it: scale, page, storey, layers, corrections.
    bounds : Bounds, optional
        The most that is read.
    progress : callable, optional
        Told the stage and the share done; what it raises ends the work.
    seen : callable, optional
        Given the pixels, if it is a sheet of pixels, before they are read.

    Returns
    -------
    Reading
        In frame `drawing`; corrected by the edits, and with its confidence.

    Raises
    ------
    Rejected
        If the file cannot be read; the leaf tells why.
    NoWallsFound
        If nothing is drawn in it. Where something is, but nothing looks like a wall, the reading has no
        walls, and the finding ``no-walls`` unless edits add some.
    NotADrawing
        If it is a photo.
    """
    tell = progress or (lambda _stage, _share: None)
    tell("load", 0.0)
    file = _File(path, options, bounds or Bounds(), _part(tell, 0.0, 0.9))
    loaded = _load(file)
    if seen is not None and isinstance(loaded, Sheet):
        seen(loaded)
    reading = _in_known_layers(_read(loaded, file))
    reading = _settled(apply_edits(reading, options.edits, progress=_part(tell, 0.9, 0.98)))
    tell("judge", 0.98)
    return reading if isinstance(loaded, Reading) else _judged(reading)


def _part(tell: Progress, low: float, high: float) -> Progress:
    """Return a progress whose 0 to 1 is `low` to `high` of another."""
    return lambda stage, share: tell(stage, low + (high - low) * min(max(share, 0.0), 1.0))


@dataclass(frozen=True)
class _File:
    """Hold a file that is being read, and how."""

    path: Path
    options: DrawingOptions
    bounds: Bounds
    tell: Progress


def _load(file: _File) -> Sheet | Linework | Reading:
    """Return what the file holds, by the loader of its kind."""
    with file.path.open("rb") as opened:
        found = accept(opened.read(HEAD_BYTES), Purpose.DRAWING)
    return LOADERS[found](file)


def _read(loaded: Sheet | Linework | Reading, file: _File) -> Reading:
    """Return the reading of pixels or linework; a building model tells its walls itself."""
    if isinstance(loaded, Sheet):
        return _read_sheet(loaded, file)
    if isinstance(loaded, Linework):
        return _read_linework(loaded, file)
    return loaded


def _in_known_layers(reading: Reading) -> Reading:
    """Return a reading in which every layer that no edit could name is called ``other``; reasons stay."""
    removed = tuple(r if r.layer in LAYERS else replace(r, layer="other") for r in reading.removed)
    return replace(reading, removed=removed)


def _settled(reading: Reading) -> Reading:
    """Return a reading that does not say that it has no walls, where a person gave it some."""
    if not reading.walls:
        return reading
    return replace(reading, findings=tuple(f for f in reading.findings if f.code != "no-walls"))


def _judged(reading: Reading) -> Reading:
    """Return a reading with its confidence; a building model that tells its walls itself needs none."""
    plans = several_plans(reading)
    return judge(reading if plans is None else replace(reading, findings=(*reading.findings, plans)))


def _read_sheet(sheet: Sheet, file: _File) -> Reading:
    told = {finding.code for finding in sheet.findings}
    doubts = [finding for finding in check_sheet(sheet.grey) if finding.code not in told]
    found = find_sheet_scale(
        sheet,
        recognise=load_recogniser(threads=2),
        hint=file.options.scale,
        progress=_part(file.tell, 0.1, 0.4),
    )
    try:
        reading = read_raster(sheet.grey, scale=found.scale, progress=_part(file.tell, 0.4, 1.0))
    except NoWallsFound as refusal:
        said = " ".join([refusal.detail, *(doubt.message for doubt in doubts)])
        raise NoWallsFound(said, **refusal.members) from refusal
    findings = (*sheet.findings, *doubts, *found.findings, *reading.findings)
    return replace(reading, findings=findings, top=reading.sheet[1])


def _read_linework(linework: Linework, file: _File) -> Reading:
    is_page = linework.sheet is not None
    found = (find_page_scale if is_page else find_unit)(linework, hint=file.options.scale)
    reading = (read_page if is_page else read_linework)(
        linework,
        scale=found.scale,
        wall_layers=file.options.wall_layers,
        progress=_part(file.tell, 0.2, 1.0),
    )
    return replace(reading, findings=(*reading.findings, *found.findings))


# One function a kind; what a kind needs is imported when a file of it comes.


def _raster(file: _File) -> Sheet:
    from worker.formats.raster import load_sheet  # noqa: PLC0415

    return load_sheet(file.path, bounds=file.bounds, page=file.options.page)


def _pdf(file: _File) -> Sheet | Linework:
    from worker.formats.pdf import load_pdf  # noqa: PLC0415

    tell = _part(file.tell, 0.0, 0.1)
    return load_pdf(file.path, bounds=file.bounds, page=file.options.page, tell=tell)


def _dxf(file: _File) -> Linework:
    from worker.formats.dxf import load_dxf  # noqa: PLC0415

    return load_dxf(file.path, bounds=file.bounds, tell=_part(file.tell, 0.0, 0.2))


def _dwg(file: _File) -> Linework:
    from worker.formats.dwg import load_dwg  # noqa: PLC0415

    return load_dwg(file.path, bounds=file.bounds, tell=_part(file.tell, 0.0, 0.2))


def _svg(file: _File) -> Linework:
    from worker.formats.svg import load_svg  # noqa: PLC0415

    return load_svg(file.path, bounds=file.bounds)


def _ifc(file: _File) -> Reading:
    from worker.formats.ifc import load_ifc  # noqa: PLC0415

    said = file.options
    return load_ifc(
        file.path,
        bounds=file.bounds,
        storey=said.storey,
        page=said.page,
        cut_height_m=said.cut_height_m,
        hint=said.scale,
        progress=file.tell,
    )


def _ros_map(file: _File) -> Reading:
    from worker.formats.ros_map import load_ros_map  # noqa: PLC0415

    reading = load_ros_map(file.path, bounds=file.bounds, hint=file.options.scale, progress=file.tell)
    return replace(reading, top=reading.sheet[1])


def _pgm(file: _File) -> Sheet:
    from worker.formats.grey_map import load_pgm  # noqa: PLC0415

    return load_pgm(file.path, bounds=file.bounds)


def _building_yaml(file: _File) -> Reading:
    from worker.formats.building_yaml import load_building_yaml  # noqa: PLC0415

    said = file.options
    return load_building_yaml(
        file.path,
        bounds=file.bounds,
        storey=said.storey,
        page=said.page,
        hint=said.scale,
        progress=file.tell,
    )


LOADERS: Mapping[Media, Callable[[_File], Sheet | Linework | Reading]] = {
    PNG: _raster,
    JPEG: _raster,
    TIFF: _raster,
    BMP: _raster,
    WEBP: _raster,
    PDF: _pdf,
    DXF: _dxf,
    DWG: _dwg,
    SVG: _svg,
    IFC: _ifc,
    PGM: _pgm,
    ROS_MAP: _ros_map,
    ROS_MAP_ZIP: _ros_map,
    BUILDING_YAML: _building_yaml,
}
