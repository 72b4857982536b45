"""The page of journeys names functions that are there, and every name on it is looked at."""

from __future__ import annotations

import ast
import re

import pytest

from tests.architecture.sources import ROOT, trees

PAGE = (ROOT / "docs" / "journeys.md").read_text(encoding="utf-8")
NAMED = sorted(set(re.findall(r"`((?:service|worker)/[\w/]+\.py)(?::([\w.]+))?`", PAGE)))


def _names(body: list[ast.stmt], before: str = "") -> set[str]:
    """Return functions and classes, methods with their class."""
    found = set()
    for node in body:
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            found.add(before + node.name)
        elif isinstance(node, ast.ClassDef):
            found |= {before + node.name} | _names(node.body, f"{before}{node.name}.")
    return found


@pytest.mark.parametrize(("path", "name"), NAMED)
def test_a_step_of_a_journey_is_in_the_sources(path: str, name: str) -> None:
    assert path in trees()
    assert not name or name in _names(trees()[path].body)


def test_there_are_five_journeys_and_no_step_is_named_otherwise() -> None:
    assert len(re.findall(r"^## ", PAGE, flags=re.MULTILINE)) == 5
    assert len(re.findall(r"`[^`]*\.py[^`]*`", PAGE)) == len(
        re.findall(r"`(?:service|worker)/[\w/]+\.py(?::[\w.]+)?`", PAGE)
    )
