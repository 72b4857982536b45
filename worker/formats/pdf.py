"""PDF pages: a scanned one to a sheet of pixels, a drawn one to linework (millimetres of paper)."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pypdfium2
import pypdfium2.raw as pdfium

from service.domain.bounds import Bounds
from service.domain.errors import (
    FileEmpty,
    FileEncrypted,
    FileMalformed,
    FileTruncated,
    PageNeeded,
    PageNotFound,
)
from service.domain.findings import Finding
from worker.formats.linework_draft import Box, LineworkDraft
from worker.formats.pdf_dictionary import PageFacts, read_page_facts
from worker.formats.pdf_images import check_image, is_coloured
from worker.formats.pdf_objects import Affine, PageObjects, PageWalk, compose
from worker.formats.pdf_render import render_sheet
from worker.formats.pdf_texts import page_texts
from worker.geometry.drawing.linework.linework import Linework
from worker.geometry.drawing.raster.sheet import Sheet
from worker.geometry.drawing.scale.decision import Witness

_MM_PER_POINT = 25.4 / 72
_TAIL = 4096
_LISTED = 50
_LARGEST_SIDE_MM = 50_000.0
_SCANNED_COVER = 0.45
_DRAWN_STROKES = 2_000
_PASSWORD_ERROR = 4
_MOST_OF_VIEWPORTS = 0.6

Tell = Callable[[str, float], None]


def load_pdf(
    path: Path, *, bounds: Bounds | None = None, page: int | None = None, tell: Tell | None = None
) -> Sheet | Linework:
    """Return a page of a PDF: its pixels where it is a scan, else its strokes and texts.

    Parameters
    ----------
    path : Path
        The document.
    bounds : Bounds, optional
        `max_pixels` of a scan, `max_page_objects`, `max_strokes`, `max_texts`, `max_page_bytes` of a page.
    page : int, optional
        Page, counted from 1; may be left out where the document has one.
    tell : callable, optional
        Told the stage and the share done; what it raises ends the work.

    Returns
    -------
    Sheet or Linework
        As displayed: cropped, turned, in UserUnit. A sheet at the resolution of its image; linework in
        millimetres of paper, x right, y up, origin at the lower left corner of the page.

    Raises
    ------
    FileEmpty, FileTruncated, FileMalformed
        If the document is damaged, or a scan's image holds fewer pixels than it says.
    FileEncrypted
        If it opens only with a password.
    PageNeeded
        If it has several pages and none was chosen.
    PageNotFound
        If it has no such page.
    DrawingTooComplex
        If the page holds more than is read.

    Notes
    -----
    Strokes and texts are pdfium's, dictionaries pypdf's. A page is a scan where images cover nearly half
    of it and few strokes are drawn.
    """
    bounds = bounds or Bounds()
    tell = tell or (lambda _stage, _share: None)
    _check_ends(path)
    with _opened(path) as document:
        index = _chosen(document, page, path)
        facts = _facts(document, path, index, bounds)
        with _page(document, index) as opened:
            view = _view(opened, facts, path)
            return _load(opened, view, facts, bounds=bounds, tell=tell)


@dataclass(frozen=True)
class View:
    """Hold how a page is displayed: its size [mm] and the map from its user space to that frame [mm]."""

    width: float
    height: float
    T_mm_user: Affine

    @property
    def box(self) -> Box:
        """Return the page as a box in its own frame."""
        return (0.0, 0.0, self.width, self.height)


def _check_ends(path: Path) -> None:
    """Refuse what has no beginning or no end of a PDF, before any library sees it."""
    with path.open("rb") as file:
        head = file.read(1024)
        size = file.seek(0, io.SEEK_END)
        file.seek(max(0, size - _TAIL))
        tail = file.read(_TAIL)
    if not head:
        raise FileEmpty(f"{path.name} has no bytes; upload the drawing again.")
    if b"%PDF-" not in head:
        raise FileMalformed(f"{path.name} does not begin as a PDF; export the drawing anew.")
    if b"%%EOF" not in tail:
        raise FileTruncated(
            f"{path.name} has no end mark: it was cut short at {size} bytes. Upload it again.", bytes=size
        )


@contextmanager
def _opened(path: Path) -> Iterator[pypdfium2.PdfDocument]:
    try:
        document = pypdfium2.PdfDocument(path)
    except pypdfium2.PdfiumError as error:
        if getattr(error, "err_code", None) == _PASSWORD_ERROR or "password" in str(error).lower():
            raise FileEncrypted(
                f"{path.name} opens only with a password: save it without one (print it to a new PDF) "
                "and upload that."
            ) from error
        raise FileMalformed(f"{path.name} cannot be opened: {error}. Export it anew.") from error
    try:
        yield document
    finally:
        document.close()


def _chosen(document: pypdfium2.PdfDocument, page: int | None, path: Path) -> int:
    """Return the index of the page that was asked for, or of the only one."""
    count = len(document)
    if count < 1:
        raise FileMalformed(f"{path.name} has no page that can be read; export it anew.")
    if page is None and count > 1:
        pages = [{"page": i + 1, **_size_of(document, i)} for i in range(min(count, _LISTED))]
        listed = ", ".join(f"{p['page']}: {p['width_mm']:g} x {p['height_mm']:g} mm" for p in pages[:8])
        more = f", and {count - 8} more" if count > 8 else ""
        raise PageNeeded(
            f"{path.name} has {count} pages ({listed}{more}); say which one shows the floor plan, from 1.",
            pages=pages,
            page_count=count,
        )
    if page is not None and not 1 <= page <= count:
        raise PageNotFound(f"{path.name} has {count} page(s); page {page} was asked for.", pages=count)
    return (page or 1) - 1


def _size_of(document: pypdfium2.PdfDocument, index: int) -> dict[str, float]:
    size = pdfium.FS_SIZEF()
    pdfium.FPDF_GetPageSizeByIndexF(document, index, size)
    return {
        "width_mm": round(size.width * _MM_PER_POINT, 1),
        "height_mm": round(size.height * _MM_PER_POINT, 1),
    }


def _facts(document: pypdfium2.PdfDocument, path: Path, index: int, bounds: Bounds) -> PageFacts:
    """Return what the dictionaries say; a file that pypdf cannot follow is first put in order by pdfium."""
    locked = pdfium.FPDF_GetSecurityHandlerRevision(document) >= 0
    if not locked:
        try:
            return read_page_facts(path, index, bounds=bounds)
        except FileMalformed:
            pass
    ordered = io.BytesIO()
    document.save(ordered, flags=pdfium.FPDF_REMOVE_SECURITY)
    return read_page_facts(ordered.getvalue(), index, bounds=bounds)


@contextmanager
def _page(document: pypdfium2.PdfDocument, index: int) -> Iterator[pypdfium2.PdfPage]:
    try:
        page = document[index]
    except pypdfium2.PdfiumError as error:
        raise FileMalformed(f"Page {index + 1} cannot be read: {error}. Export it anew.") from error
    try:
        yield page
    finally:
        page.close()


def _view(page: pypdfium2.PdfPage, facts: PageFacts, path: Path) -> View:
    """Return the page as it is displayed: crop box, rotation and UserUnit applied."""
    left, bottom, right, top = page.get_bbox()
    unit = facts.user_unit * _MM_PER_POINT
    wide, high = (right - left) * unit, (top - bottom) * unit
    if not (0 < wide <= _LARGEST_SIDE_MM and 0 < high <= _LARGEST_SIDE_MM):
        raise FileMalformed(
            f"The page of {path.name} would be {wide / 1000:.4g} x {high / 1000:.4g} m of paper; "
            f"at most {_LARGEST_SIDE_MM / 1000:g} m are read. Export it on a real sheet.",
            width_mm=wide,
            height_mm=high,
        )
    upright = (unit, 0.0, 0.0, unit, -left * unit, -bottom * unit)
    turns: dict[int, Affine] = {
        90: (0.0, -1.0, 1.0, 0.0, 0.0, wide),
        180: (-1.0, 0.0, 0.0, -1.0, wide, high),
        270: (0.0, 1.0, -1.0, 0.0, high, 0.0),
    }
    turn = page.get_rotation() % 360
    if turn not in turns:
        return View(wide, high, upright)
    shown = (wide, high) if turn == 180 else (high, wide)
    return View(*shown, compose(upright, turns[turn]))


def _load(
    page: pypdfium2.PdfPage, view: View, facts: PageFacts, *, bounds: Bounds, tell: Tell
) -> Sheet | Linework:
    draft = LineworkDraft(view.box, most=bounds.max_strokes)
    count = max(1, pdfium.FPDFPage_CountObjects(page))
    walk = PageWalk(
        draft,
        hidden_layers=facts.hidden_layers,
        most=bounds.max_page_objects,
        tell=lambda seen: tell("load", min(0.9, 0.1 + 0.8 * seen / count)),
    )
    walk.page(page, view.T_mm_user)
    texts = page_texts(page, view.T_mm_user, layers=walk.found.text_layers, most=bounds.max_texts)
    texts = tuple(
        t
        for t in texts
        if t.layer not in facts.hidden_layers and 0 <= t.x <= view.width and 0 <= t.y <= view.height
    )
    findings = tuple(_findings(walk.found))
    witnesses = tuple(_witnesses(facts, view))
    cover = walk.found.image_cover(view.box)
    tell("load", 0.9)
    if cover >= _SCANNED_COVER and len(draft) < _DRAWN_STROKES:
        large = [i for i in walk.found.images if _is_large(i.box, view)]
        findings += tuple(f for i in large for f in check_image(i.item, page))
        dpi = max((i.dpi for i in large), default=300.0)
        coloured = len(draft) > 0 or any(is_coloured(i.item, page) for i in large)
        sheet = render_sheet(
            page, size_mm=(view.width, view.height), dpi=dpi, is_coloured=coloured, bounds=bounds, tell=tell
        )
        return _with_texts(sheet, texts=texts, witnesses=witnesses, findings=findings)
    linework = draft.finish(page_mm_per_unit=1.0)
    return replace(linework, texts=texts, witnesses=witnesses, findings=(*linework.findings, *findings))


def _is_large(box: Box, view: View) -> bool:
    return (box[2] - box[0]) * (box[3] - box[1]) >= 0.02 * view.width * view.height


def _with_texts(sheet: Sheet, *, texts: Any, witnesses: tuple[Witness, ...], findings: Any) -> Sheet:
    """Return the sheet with the page's texts and witnesses turned from millimetres to pixels."""
    assert sheet.dpi is not None
    px = sheet.dpi / 25.4
    rows = sheet.grey.shape[0]
    turned = tuple(replace(t, x=t.x * px, y=rows - t.y * px, height=t.height * px) for t in texts)
    seen = tuple(replace(w, low=w.low / px, high=w.high / px) for w in witnesses)
    return replace(sheet, texts=turned, witnesses=seen, findings=(*sheet.findings, *findings))


def _findings(found: PageObjects) -> Iterator[Finding]:
    for name, count in sorted(found.hidden.items()):
        yield Finding(
            "layer-hidden",
            "info",
            f"Layer {name!r} is switched off in the document: {count} objects on it were passed over.",
            {"layer": name, "objects": count},
        )


def _witnesses(facts: PageFacts, view: View) -> Iterator[Witness]:
    """Yield what the viewports state of the scale; the largest alone where it has most of the area."""
    unit = math.hypot(view.T_mm_user[0], view.T_mm_user[1])
    by_scale: dict[float, list[float]] = {}
    name = {}
    for v in facts.viewports:
        key = float(f"{v.metres_per_point / unit:.4g}")
        by_scale.setdefault(key, []).append(v.area)
        name[key] = (v.metres_per_point / unit, v.ratio)
    areas = {key: sum(a) for key, a in by_scale.items()}
    whole = sum(areas.values())
    for key, area in sorted(areas.items(), key=lambda x: -x[1]):
        if area >= _MOST_OF_VIEWPORTS * whole or max(areas.values()) < _MOST_OF_VIEWPORTS * whole:
            value, ratio = name[key]
            said = f"The page's measuring viewport says {ratio or f'1:{value * 1000:g}'}."
            yield Witness("page-measure", value, value, said, len(by_scale[key]))
