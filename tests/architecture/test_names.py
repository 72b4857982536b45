"""Names: what the glossary bans is not said, and a number that leaves Python carries its unit."""

from __future__ import annotations

import ast
import json
import re
from collections.abc import Iterator
from typing import Any

from service.settings import Settings
from tests.architecture.sources import ROOT, trees

MEANS_MORE = {
    "cell": "of a grid",
    "check": "what looks whether something holds",
    "edit": "of a drawing, as the glossary has it",
    "error": "a library's, an exception's, a part of a problem",
    "layout": "of a file's bytes; of a DXF",
    "lock": "of a row",
    "merge": "the command, and the paper's word",
    "patch": "the HTTP method; a piece of a surface",
    "plan": "how a roll-out proceeds; a storey cut level",
    "stats": "the service's own figures",
    "status": "of an answer, a revision, a process",
    "task": "asyncio's",
    "threshold": "a share of failures that stops a roll-out",
    "token": "an attempt's; a word of a text",
    "vehicle": "VDA 5050's word for a robot",
    "version": "of the software and of files, as the glossary has it",
}
"""Words that the glossary bans for one thing and that mean another: whether rightly is seen by review."""

_UNIT = re.compile(r"(?:^|_)(?:m|m2|s|ms|mm|px|rad|deg|bytes|share|dpi|seconds|metres_per_unit)$")
WITHOUT_UNIT = {
    "a count": (
        "attempt closed_directions columns count dust edits edits_applied failure_limit failures "
        "iterations keep_revisions limit looked_through max_pixels max_points "
        "max_requests_per_key_per_minute max_streams_per_key occupied_cells outliers points "
        "points_added points_compared points_given points_kept points_removed poses_compared robots specks "
        "starts starts_agreeing still_seen taken tiles_unchanged unchanged unknown_cells upright_surfaces "
        "walls"
    ),
    "the number of a thing": (
        "base base_n enabled enabled_revision from from_n from_revision generation metrics_port n "
        "number onto page parent_n port reported_revision revision revision_n since stage status to_n "
        "to_revision wanted_revision with worker_metrics_port"
    ),
    "a ratio": (
        "confidence explained_share_at_top fraction inlier_share_of_structure "
        "nearest_voxel_transformation_likelihood ratio slide_gain threshold "
        "transformation_probability"
    ),
    "an instant of Unix": ("expires"),
    "several units in one, told where it is described": (
        "T_map_drawing T_map_scan T_upright_scan covariance information_eigenvalues placed value"
    ),
    "pixels or drawing units, as the drawing has them": ("line within x1 x2 y1 y2"),
    "in the `unit` of its reading: metres, or pixels or drawing units while the scale is unknown": (
        "drawing_origin drawing_top length sheet"
    ),
    "metres in a frame, as GeoJSON has them without a unit": ("coordinates max min"),
}


def _banned() -> set[str]:
    rows = re.findall(
        r"^\|([^|]*)\|([^|]*)\|([^|]*)\|$", (ROOT / "docs/glossary.md").read_text(), re.MULTILINE
    )
    words = {word.strip() for *_, last in rows for word in re.sub(r"\(.*?\)", "", last).split(",")}
    return words - {"", "not", "---"}


def _names() -> Iterator[str]:
    for tree in trees().values():
        for node in ast.walk(tree):
            match node:
                case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name) | ast.ClassDef(name=name):
                    yield name
                case ast.arg(arg=name) | ast.AnnAssign(target=ast.Name(id=name)):
                    yield name
    yield from _described(json.loads((ROOT / "tests/service/openapi.json").read_text()))


def _described(part: Any) -> Iterator[str]:
    """Give the names of the API: members, parameters, schemas."""
    if isinstance(part, dict):
        yield from part.get("properties", {})
        yield from part.get("schemas", {})
        if isinstance(part.get("name"), str):
            yield part["name"]
    for inner in part.values() if isinstance(part, dict) else part if isinstance(part, list) else ():
        yield from _described(inner)


def _words(name: str) -> set[str]:
    words = {word.lower() for word in re.findall(r"[A-Z]?[a-z]+|[A-Z]+", name)}
    return words | {word.removesuffix("s") for word in words}


def test_what_the_glossary_bans_is_no_name() -> None:
    banned = _banned()
    assert {"blueprint", "params", "overlay"} <= banned
    never = {word for word in banned if " " not in word} - set(MEANS_MORE)
    assert {name for name in _names() if _words(name) & never} == set()
    assert set(MEANS_MORE) <= banned
    said = {word for name in _names() for word in _words(name)}
    assert set(MEANS_MORE) - said == set(), "nobody says it any more: it is banned now"


def _numbers(part: Any, name: str = "") -> Iterator[str]:
    """Give the names of all members and parameters of the API that are numbers."""
    if isinstance(part, list):
        for inner in part:
            yield from _numbers(inner, name)
    if not isinstance(part, dict):
        return
    if name and part.get("type") in {"number", "integer"}:
        yield name
    for inner_name, inner in part.get("properties", {}).items():
        yield from _numbers(inner, inner_name)
    for key, inner in part.items():
        if key == "schema":
            yield from _numbers(inner, str(part.get("name", "")))
        elif key in {"anyOf", "oneOf", "allOf", "items"}:
            yield from _numbers(inner, name)
        elif key != "properties":
            yield from _numbers(inner)


def _without_unit(names: set[str]) -> set[str]:
    """Return the names that tell no unit and have no reason for it."""
    reasoned = {name for names in WITHOUT_UNIT.values() for name in names.split()}
    return {name for name in names if not _UNIT.search(name)} - reasoned


def test_a_number_that_leaves_the_service_carries_its_unit() -> None:
    told = set(_numbers(json.loads((ROOT / "tests/service/openapi.json").read_text())))
    assert len(told) > 60
    assert _without_unit(told) == set(), "give it its unit, or tell above why it has none"
    assert _without_unit({"height", "height_m"}) == {"height"}


def test_a_number_that_an_operator_sets_carries_its_unit() -> None:
    fields = Settings.model_fields.items()
    numbers = {name for name, field in fields if re.search(r"\b(int|float)\b", str(field.annotation))}
    assert len(numbers) > 10
    assert _without_unit(numbers) == set(), "give it its unit, or tell above why it has none"
