"""A page's weight on either side of each limit: what a form calls counts as often as it is called."""

from __future__ import annotations

from pathlib import Path

import pytest

from service.domain.bounds import Bounds
from service.domain.errors import DrawingTooComplex
from tests.formats.pdf_writer import one_page, stream
from worker.formats.pdf import load_pdf

BOX = b"/Subtype/Form/BBox[0 0 400 200]"
FORM = stream(b"0 0 m 50 50 l S", BOX)


def read(tmp_path: Path, document: bytes, bounds: Bounds) -> None:
    path = tmp_path / "sheet.pdf"
    path.write_bytes(document)
    load_pdf(path, bounds=bounds)


def calling(times: int) -> bytes:
    return one_page(b"/X Do " * times, resources=b"/XObject<</X 6 0 R>>", more=[FORM])


def test_objects_count_as_often_as_they_are_drawn(tmp_path: Path) -> None:
    read(tmp_path, calling(50), Bounds(max_page_objects=100))  # each call is one, and draws one
    with pytest.raises(DrawingTooComplex, match="objects"):
        read(tmp_path, calling(51), Bounds(max_page_objects=100))


def test_bytes_count_as_long_as_they_unpack(tmp_path: Path) -> None:
    body = b"0 0 m 50 50 l S\n"
    page = one_page(body * 64, pack=True)
    read(tmp_path, page, Bounds(max_page_bytes=64 * len(body) + 1))
    with pytest.raises(DrawingTooComplex, match="unpacks"):
        read(tmp_path, page, Bounds(max_page_bytes=64 * len(body) - 1))


def test_letters_count(tmp_path: Path) -> None:
    line = b"10 20 m 110 20 l S BT /F 9 Tf "
    read(tmp_path, one_page(line + b"(%s) Tj ET" % (b"a" * 100)), Bounds(max_texts=5))
    with pytest.raises(DrawingTooComplex, match="letters"):
        read(tmp_path, one_page(line + b"(%s) Tj ET" % (b"a" * 101)), Bounds(max_texts=5))


def test_graphics_states_may_lie_in_each_other_to_a_depth(tmp_path: Path) -> None:
    line = b"10 20 m 110 20 l S "
    read(tmp_path, one_page(b"q " * 10_000 + line), Bounds())
    read(tmp_path, one_page(b"q Q " * 50_000 + line), Bounds())
    with pytest.raises(DrawingTooComplex, match="states"):
        read(tmp_path, one_page(b"q " * 10_001 + line), Bounds())


def test_words_of_a_text_are_no_commands(tmp_path: Path) -> None:
    text = b"10 20 m 110 20 l S BT /F 9 Tf (%s) Tj ET" % (b"Do gs BT sh " * 20)
    read(tmp_path, one_page(text), Bounds(max_page_objects=1_000, max_texts=100))


def test_a_name_is_looked_up_in_the_form_s_own_resources_first(tmp_path: Path) -> None:
    """The page's name means a bomb, the form's an innocent line: only the line is drawn."""
    names = b"/XObject<</A 6 0 R/X 7 0 R>>"
    outer = stream(b"/X Do", BOX + b"/Resources<</XObject<</X 8 0 R>>>>")
    bomb = stream(b"/X Do /X Do", BOX)
    page = one_page(b"/A Do", resources=names, more=[outer, bomb, FORM])
    read(tmp_path, page, Bounds())
    with pytest.raises(DrawingTooComplex):
        read(tmp_path, one_page(b"/X Do", resources=names, more=[outer, bomb, FORM]), Bounds())
