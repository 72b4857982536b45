"""DXF drawings to linework: the model space, with its blocks placed, behind a count of what they come to."""

from __future__ import annotations

import io
import struct
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path

from ezdxf import filemanagement, recover
from ezdxf.document import Drawing
from ezdxf.entities.dxfgfx import DXFGraphic
from ezdxf.entities.insert import Insert
from ezdxf.lldxf.const import DXFError
from ezdxf.math import Matrix44

from service.domain.bounds import Bounds
from service.domain.errors import (
    DrawingTooComplex,
    FileEmpty,
    FileMalformed,
    FileTruncated,
    UploadTooLarge,
)
from service.domain.findings import Finding, Value
from worker.formats.dxf_entities import IGNORED, add_entity, dimension_of, style_of
from worker.formats.dxf_linework import linework_of
from worker.formats.dxf_parts import Part, PartBuilder, Reference, Style, places_of
from worker.formats.dxf_sheets import sheet_part, title_witness
from worker.geometry.drawing.linework.linework import Linework
from worker.geometry.drawing.scale.decision import Witness

Tell = Callable[[str, float], None]

BROKEN = (
    DXFError,
    ValueError,
    TypeError,
    ArithmeticError,
    LookupError,
    AttributeError,
    AssertionError,
    struct.error,
    RecursionError,
)
"""What ezdxf raises on entities and files that break the format's rules."""

_TAIL = 4096
_HEADER_UNITS = {
    1: (0.0254, "inches"),
    2: (0.3048, "feet"),
    4: (0.001, "millimetres"),
    5: (0.01, "centimetres"),
    6: (1.0, "metres"),
    14: (0.1, "decimetres"),
}
_DEEPEST = 60
_MOST_NAMES = 20
_TELL_EVERY = 5000


def load_dxf(path: Path, *, bounds: Bounds, tell: Tell | None = None) -> Linework:
    """Return the model space of a DXF drawing as linework.

    References to blocks are placed, after it was counted what that comes to; layers that are off or frozen
    are left out; a drawing that only exists on its sheets (paper space) is read from the one that holds most.

    Parameters
    ----------
    path : Path
        ASCII or binary DXF.
    bounds : Bounds
        The most that is read.
    tell : callable, optional
        Told the stage and the share done; what it raises ends the work.

    Returns
    -------
    Linework
        In drawing units; the header's unit is among its witnesses.

    Raises
    ------
    UploadTooLarge
        If the file is larger than is read.
    FileTruncated
        If the file does not come to its end marker.
    FileMalformed
        If it breaks the format's rules so that nothing can be recovered.
    DrawingTooComplex
        If its blocks come to more strokes than are read.
    FileEmpty
        If there is nothing drawn in it.
    """
    told = tell or (lambda _stage, _share: None)
    _check_ends(path, bounds)
    doc, findings = _opened(path)
    told("blocks", 0.3)
    return _Reader(doc, bounds, told, findings).read()


def _check_ends(path: Path, bounds: Bounds) -> None:
    size = path.stat().st_size
    if size > bounds.max_dxf_bytes:
        raise UploadTooLarge(
            f"{path.name} has {size >> 20} MiB; of a DXF file at most {bounds.max_dxf_bytes >> 20} MiB are "
            "read. Purge it, or save the one floor that is needed.",
            max_upload_bytes=bounds.max_dxf_bytes,
        )
    with path.open("rb") as opened:
        opened.seek(max(0, size - _TAIL))
        tail = opened.read()
    if b"EOF" not in tail:
        raise FileTruncated(
            f"{path.name} does not come to its end marker (EOF): the copy or the upload was cut short."
        )


def _opened(path: Path) -> tuple[Drawing, list[Finding]]:
    """Return the document, by the strict reader or the forgiving one."""
    try:
        return filemanagement.readfile(path), []
    except (*BROKEN, OSError) as error:
        reason = str(error)[:200]
    try:
        doc, auditor = recover.read(io.BytesIO(path.read_bytes()))
    except (*BROKEN, OSError) as error:
        raise FileMalformed(
            f"{path.name} breaks the rules of DXF and nothing could be recovered: {str(error)[:200]}. "
            "Open it in a CAD program, repair it (AUDIT, RECOVER) and save it again."
        ) from error
    message = f"The file breaks the rules of DXF ({reason}) and was recovered; parts may be missing."
    values = {"errors": len(auditor.errors), "fixes": len(auditor.fixes)}
    return doc, [Finding("file-recovered", "warning", message, values)]


@dataclass
class _Seen:
    """Hold what is told of a file in the end."""

    types: Counter[str] = field(default_factory=Counter)
    broken: int = 0
    hidden: Counter[str] = field(default_factory=Counter)
    references: dict[str, str] = field(default_factory=dict)
    missing: set[str] = field(default_factory=set)
    circles: set[str] = field(default_factory=set)


class _Reader:
    """Read one document."""

    def __init__(self, doc: Drawing, bounds: Bounds, tell: Tell, findings: list[Finding]) -> None:
        self._doc = doc
        self._bounds = bounds
        self._tell = tell
        self._findings = findings
        self._seen = _Seen()
        self._parts: dict[str, Part] = {}
        self._counts: dict[str, int] = {}
        self._off = {layer.dxf.name.casefold() for layer in doc.layers if layer.is_off() or layer.is_frozen()}

    def read(self) -> Linework:
        part = self._layout(self._doc.modelspace())
        witnesses = _header(self._doc)
        findings = self._told()
        if not len(part.ends):
            part, witnesses, more = self._from_sheets(witnesses)
            findings += more
        return linework_of(self._doc, part, witnesses=witnesses, findings=findings, bounds=self._bounds)

    def _from_sheets(self, witnesses: list[Witness]) -> tuple[Part, list[Witness], list[Finding]]:
        """Return what the drawing's sheets show, where its model space is empty."""
        only_references = bool(self._seen.references)
        sheet = sheet_part(self._doc, self._layout, to_model=only_references)
        if sheet is None and not only_references:
            broken = f"; {self._seen.broken} entities are malformed" if self._seen.broken else ""
            raise FileEmpty(
                f"The drawing holds no lines: neither its model space nor its sheets{broken}.",
                broken_entities=self._seen.broken,
            )
        names = ", ".join(sorted(self._seen.references.values())[:_MOST_NAMES])
        if only_references:
            finding = Finding(
                "only-references",
                "serious",
                f"The drawing itself holds no lines; it only refers to other files ({names}), which were "
                "not uploaded. Bind them (XREF, Bind) and upload the drawing again.",
                {"references": sorted(self._seen.references.values())[:_MOST_NAMES]},
            )
        else:
            finding = Finding(
                "paper-space-only",
                "warning",
                "The model space is empty; the drawing was read from a sheet of its paper space, which "
                "may be drawn to scale.",
            )
        if sheet is None:
            return PartBuilder(most=0).finish(), witnesses, [finding]
        return sheet, witnesses + title_witness(self._doc, sheet, to_model=only_references), [finding]

    def _layout(self, entities: Iterable[DXFGraphic]) -> Part:
        """Return the part of the model space or of a sheet, which comes to no more than is read."""
        listed = list(entities)
        self._budget(listed)
        return self._part(listed, in_block=False)

    def _budget(self, listed: Iterable[DXFGraphic]) -> None:
        """Refuse a drawing whose references, placed in each other, come to more entities than are read.

        What the file itself lists is bounded by its size: this is what a few bytes multiply.
        """
        most = self._bounds.max_page_objects
        total = sum(self._count_of(e, ()) - 1 for e in listed)
        if total > most:
            raise DrawingTooComplex(
                f"The drawing's blocks, placed in each other, come to {total} entities; at most {most} are "
                "read. Purge it, or save the one floor that is needed.",
                max_page_objects=most,
            )

    def _count_of(self, entity: DXFGraphic, above: tuple[str, ...]) -> int:
        if not isinstance(entity, Insert):
            return 1
        name = str(entity.dxf.get("name", "")).casefold()
        times = max(1, int(entity.mcount)) if hasattr(entity, "mcount") else 1
        if name in above or len(above) > _DEEPEST or name not in self._doc.blocks:
            return 1
        if name not in self._counts:
            block = self._doc.blocks.get(name)
            inside = (*above, name)
            self._counts[name] = sum(self._count_of(e, inside) for e in block) if block is not None else 0
        return times * self._counts[name] + 1

    def _part(self, entities: Iterable[DXFGraphic], *, in_block: bool, above: tuple[str, ...] = ()) -> Part:
        to = PartBuilder(most=self._bounds.max_strokes)
        for n, entity in enumerate(entities):
            if n % _TELL_EVERY == 0:
                self._tell("blocks", 0.5)
            try:
                self._take(entity, style_of(entity, in_block=in_block), to, above)
            except BROKEN:
                self._seen.broken += 1
        return to.finish()

    def _take(self, entity: DXFGraphic, style: Style, to: PartBuilder, above: tuple[str, ...]) -> None:
        """Add an entity that is shown."""
        if entity.dxf.get("invisible", 0):
            return
        if style.layer.casefold() in self._off:
            self._seen.hidden[style.layer] += 1
        else:
            self._add(entity, style, to, above)

    def _add(self, entity: DXFGraphic, style: Style, to: PartBuilder, above: tuple[str, ...]) -> None:
        kind = entity.dxftype()
        if isinstance(entity, Insert):
            self._place(entity, style, to, above)
        elif kind in {"DIMENSION", "ARC_DIMENSION", "LARGE_RADIAL_DIMENSION"}:
            self._dimension(entity, style, to, above)
        elif kind not in IGNORED and not add_entity(entity, style, to):
            self._seen.types[kind] += 1

    def _place(self, insert: Insert, style: Style, to: PartBuilder, above: tuple[str, ...]) -> None:
        name = str(insert.dxf.get("name", ""))
        part = self._block(name, above)
        if part is not None and (len(part.ends) or part.texts):
            at = places_of(insert) if insert.mcount > 1 else None
            to.add_reference(Reference.of(part, insert.matrix44(), style, at=at))
        for attribute in insert.attribs:
            if not attribute.is_invisible:
                add_entity(attribute, style_of(attribute, in_block=False), to)

    def _dimension(self, entity: DXFGraphic, style: Style, to: PartBuilder, above: tuple[str, ...]) -> None:
        part = self._block(str(entity.dxf.get("geometry", "")), above, dimension=True)
        if part is not None:
            to.add_reference(Reference.of(part, Matrix44(), style, kind="dimension"))
        measured = dimension_of(entity)
        if measured is not None:
            to.dimensions.append(measured)

    def _block(self, name: str, above: tuple[str, ...], *, dimension: bool = False) -> Part | None:
        """Return a block's part, flattened once; None where there is none."""
        key = name.casefold()
        block = self._doc.blocks.get(name) if name else None
        if block is None:
            if not dimension:
                self._seen.missing.add(name)
            return None
        if block.block is not None and block.block.is_xref:
            self._seen.references[key] = str(block.block.dxf.get("xref_path", "")) or name
            return None
        if key in above or len(above) > _DEEPEST:
            self._seen.circles.add(name)
            return None
        if key not in self._parts:
            self._parts[key] = self._part(block, in_block=True, above=(*above, key))
        return self._parts[key]

    def _told(self) -> list[Finding]:
        return [*self._findings, *self._told_of_references(), *self._told_of_entities()]

    def _told_of_references(self) -> list[Finding]:
        seen = self._seen
        out: list[Finding] = []
        if seen.references:
            names = sorted(seen.references.values())[:_MOST_NAMES]
            out.append(
                _finding(
                    "references-missing",
                    "warning",
                    f"The drawing refers to other files that were not uploaded: {', '.join(names)}.",
                    references=names,
                )
            )
        if seen.circles:
            names = sorted(seen.circles)[:_MOST_NAMES]
            out.append(
                _finding(
                    "block-in-itself", "warning", f"Blocks hold themselves: {', '.join(names)}.", blocks=names
                )
            )
        if seen.missing:
            names = sorted(seen.missing)[:_MOST_NAMES]
            out.append(
                _finding(
                    "block-missing",
                    "warning",
                    f"References to blocks that are not there: {', '.join(names)}.",
                    blocks=names,
                )
            )
        return out

    def _told_of_entities(self) -> list[Finding]:
        seen = self._seen
        out: list[Finding] = []
        if seen.hidden:
            names = [name for name, _ in seen.hidden.most_common(_MOST_NAMES)]
            out.append(
                _finding(
                    "layer-hidden",
                    "info",
                    f"{sum(seen.hidden.values())} entities on layers that are off or frozen were left out: "
                    f"{', '.join(names)}.",
                    layers=names,
                )
            )
        if seen.types:
            most = seen.types.most_common(_MOST_NAMES)
            names = [f"{n} {kind}" for kind, n in most]
            out.append(
                _finding(
                    "entities-not-read",
                    "warning",
                    f"Entities of kinds that are not read: {', '.join(names)}.",
                    kinds=[kind for kind, _ in most],
                    entities=[n for _, n in most],
                )
            )
        if seen.broken:
            out.append(
                _finding(
                    "entities-broken",
                    "warning",
                    f"{seen.broken} entities are malformed and were left out.",
                    entities=seen.broken,
                )
            )
        return out


def _finding(code: str, severity: str, message: str, **values: Value) -> Finding:
    return Finding(code, "info" if severity == "info" else "warning", message, values)


def _header(doc: Drawing) -> list[Witness]:
    """Return what the header says of the unit."""
    code = doc.header.get("$INSUNITS", 0)
    if code not in _HEADER_UNITS:
        return []
    metres, name = _HEADER_UNITS[code]
    return [Witness("file-unit", metres, metres, f"The file's header says {name}.")]
