"""The table of formats: each has its reader, is told by its bytes, and nothing else keeps a list."""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Iterator
from dataclasses import fields

import pytest

from service.domain.bounds import Bounds
from service.domain.errors import UnsupportedMedia
from service.domain.formats import DWG, FORMATS, Media, Purpose, listed
from service.domain.media import HEAD_BYTES, accept, recognise
from tests.architecture.sources import ROOT, trees
from tests.formats import formats_page
from tests.hostile import drawings, scans
from worker.cli import main
from worker.formats import drawing, scan

SPECIMENS: dict[str, Callable[[], bytes]] = {
    **drawings.MAKERS,
    **scans.MAKERS,
    "dwg": lambda: b"AC1032" + bytes(200),  # nothing that is free writes one
}
MOST_IN_PASSING = 4
"""More formats than this in one text are a list, which would miss the next format."""
WORDS = {word for one in FORMATS for word in one.called if " " not in word}
OWN_LISTS = {"service/domain/formats.py", "docs/formats.md", "CHANGELOG.md"}


def test_each_format_has_one_reader_and_each_reader_a_format() -> None:
    assert set(drawing.LOADERS) == {one for one in FORMATS if one.fits is Purpose.DRAWING}
    assert set(scan.LOADERS) == {one for one in FORMATS if one.fits is Purpose.SCAN}
    assert len(set(FORMATS)) == len(FORMATS) == len(drawing.LOADERS) + len(scan.LOADERS)


def test_each_format_is_told_by_the_bytes_of_a_specimen() -> None:
    told = {kind: recognise(make()[:HEAD_BYTES]) for kind, make in SPECIMENS.items()}
    assert set(told.values()) == set(FORMATS)
    assert told["dwg"] is DWG


@pytest.mark.parametrize("one", FORMATS, ids=lambda one: one.called[0])
def test_a_row_says_all_that_others_take_from_it(one: Media) -> None:
    assert one.name.split()[0] in {"a", "an"}
    assert one.called
    assert one.groups
    assert one.extensions
    assert all(re.fullmatch(r"\.[a-z0-9]+", ending) for ending in one.extensions)
    assert one.memory_bound is None or one.memory_bound in {field.name for field in fields(Bounds)}
    tells_its_cost = one.least_point_bytes or one.most_pixels_per_byte or one.is_cad or one.needs_others
    assert tells_its_cost, "service.domain.reading_cost takes from the row what reading such a file may cost"


def test_no_two_formats_are_told_or_called_alike() -> None:
    begins = [magic for one in FORMATS for magic in one.begins]
    assert [(a, b) for a in begins for b in begins if a is not b and b.startswith(a)] == []
    called = [word for one in FORMATS for word in one.called]
    assert len(set(called)) == len(called)
    assert len({one.media_type for one in FORMATS}) == len(FORMATS)


@pytest.mark.parametrize(("purpose", "command"), [(Purpose.DRAWING, "read"), (Purpose.SCAN, "align")])
def test_refusals_the_api_and_the_command_line_tell_the_list(
    purpose: Purpose, command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [w for one in FORMATS if one.fits is purpose and not one.needs_others for w in one.called]
    assert [word for word in words if word not in listed(purpose)] == []
    with pytest.raises(UnsupportedMedia) as refused:
        accept(bytes(200), purpose)
    assert listed(purpose) in refused.value.detail
    assert listed(purpose) in (ROOT / "tests/service/openapi.json").read_text()
    with pytest.raises(SystemExit):
        main([command, "--help"])
    assert listed(purpose, with_others=True) in " ".join(capsys.readouterr().out.split())


def test_the_page_is_that_of_the_table() -> None:
    assert formats_page.PAGE.read_text() == formats_page.text(), "a format changed: run `poe formats`"


def test_nothing_else_keeps_a_list_of_formats() -> None:
    lists = {place for place, text in _texts() if len(_named(text)) > MOST_IN_PASSING}
    assert lists == set()
    assert len(_named("PNG, JPEG, TIFF or BMP images, and PDF")) > MOST_IN_PASSING


def _named(text: str) -> set[str]:
    return WORDS & set(re.findall(r"\w+", text))


def _texts() -> Iterator[tuple[str, str]]:
    """Give every text of the product that people may read, with its place: a string, a row, a message."""
    for path, tree in trees().items():
        for node in ast.walk(tree):
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and path not in OWN_LISTS:
                yield f"{path}:{node.lineno}", node.value
    pages = [
        ROOT / "README.md",
        *(ROOT / "docs").rglob("*.md"),
        *(ROOT / "service/web/app/src").rglob("*.ts*"),
    ]
    for page in pages:
        if page.relative_to(ROOT).as_posix() in OWN_LISTS:
            continue
        for number, line in enumerate(page.read_text().splitlines(), start=1):
            yield f"{page.relative_to(ROOT)}:{number}", line
