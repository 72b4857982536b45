"""Lengths of an SVG that count in letters or in the sheet, as a browser counts them."""

from __future__ import annotations

import pytest

from worker.formats.svg_lengths import pixels, with_plain_lengths

VIEW = (800.0, 600.0)


def made_plain(body: str, *, root: str = "") -> str:
    return with_plain_lengths(f"<svg {root}>{body}</svg>".encode(), view=VIEW).decode()


@pytest.mark.parametrize(
    ("length", "plain"),
    [
        ("0.5em", "8"), ("2EM", "32"), ("1ex", "8"), ("2rem", "32"), ("1vw", "8"), ("1vh", "6"),
        ("1vmin", "6"), ("1vmax", "8"), ("-.5em", "-8"), ("1e1ch", "80"),
    ],
)  # fmt: skip
def test_a_pen_in_a_relative_unit_is_one_in_pixels(length: str, plain: str) -> None:
    assert f'stroke-width="{plain}"' in made_plain(f'<path stroke-width="{length}" />')


def test_letters_count_in_the_nearest_size_and_a_size_in_those_around_it() -> None:
    out = made_plain('<g font-size="10"><text font-size="2em" dx="1em" /><path x="1em" /></g>')
    assert '<text font-size="20" dx="20" />' in out
    assert '<path x="10" />' in out


def test_a_style_counts_as_its_attributes_and_rem_in_the_root_s_letters() -> None:
    out = made_plain('<path style="stroke-width:0.5em;font-size:2rem" />', root='font-size="10"')
    assert 'style="stroke-width:10;font-size:20px"' in out


def test_names_and_paths_that_look_like_lengths_are_left_alone() -> None:
    body = '<path id="a1em" class="w-1em" d="M0 0l1em" fill="#1e1ec1" stroke-width="1em" />'
    out = made_plain(body)
    for kept in ('id="a1em"', 'class="w-1em"', 'd="M0 0l1em"', 'fill="#1e1ec1"'):
        assert kept in out


def test_a_document_without_such_lengths_keeps_its_bytes() -> None:
    content = b'<svg><path stroke-width="2px" fill="#1e1ec1" /></svg>'
    assert with_plain_lengths(content, view=VIEW) is content


@pytest.mark.parametrize(
    ("value", "length"),
    [("2", 2.0), ("1in", 96.0), ("72pt", 96.0), ("2.54cm", 96.0), ("2em", 0.0), ("thick", 0.0), (None, 0.0)],
)
def test_a_length_is_read_in_pixels_and_nonsense_as_none(value: object, length: float) -> None:
    assert pixels(value) == pytest.approx(length)
