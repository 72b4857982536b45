"""Journeys, recipes and the page of places name what is there, and every name in them is looked at."""

from __future__ import annotations

import ast
import re

import pytest

from service.domain.lifecycle import JobKind
from tests.architecture.sources import ROOT
from worker.registry import HANDLERS

JOURNEYS = (ROOT / "docs" / "journeys.md").read_text(encoding="utf-8")
RECIPES = (
    (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8").partition("## Recipes")[2].partition("\n## ")[0]
)
PLACES = (ROOT / "docs" / "where.md").read_text(encoding="utf-8").partition("\n## ")[2]
_NAMED = re.compile(r"`((?:service|worker|client|tests|docs|migrations)/[\w/.]*[\w/])(?::([\w.]+))?`")
_FILE = re.compile(r"`[^` ]*[/.][^` ]*`")
_TOOLS = re.compile(r"`(?:tools|poe)\b")
NAMED = sorted(set(_NAMED.findall(JOURNEYS + RECIPES + PLACES)))


def _names(body: list[ast.stmt], before: str = "") -> set[str]:
    """Return functions, classes and values, those of a class with their class."""
    found = set()
    for node in body:
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            found.add(before + node.name)
        elif isinstance(node, ast.ClassDef):
            found |= {before + node.name} | _names(node.body, f"{before}{node.name}.")
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            found |= {before + target.id for target in targets if isinstance(target, ast.Name)}
    return found


@pytest.mark.parametrize(("path", "name"), NAMED)
def test_a_step_is_in_the_sources(path: str, name: str) -> None:
    assert (ROOT / path).exists()
    if not name:
        return
    text = (ROOT / path).read_text(encoding="utf-8")
    if path.endswith((".ts", ".tsx")):
        assert re.search(
            rf"^(?:export )?(?:async )?(?:function|const|interface) {name}\b", text, re.MULTILINE
        )
    else:
        assert name in _names(ast.parse(text).body)


@pytest.mark.parametrize("page", [JOURNEYS, RECIPES, PLACES], ids=["journeys", "recipes", "places"])
def test_no_step_is_named_otherwise(page: str) -> None:
    files = [name for name in _FILE.findall(page) if not _TOOLS.match(name)]
    assert len(files) > 10
    assert [name for name in files if not _NAMED.fullmatch(name)] == []


def test_there_are_seven_journeys_and_five_recipes() -> None:
    assert len(re.findall(r"^## ", JOURNEYS, flags=re.MULTILINE)) == 7
    assert re.findall(r"^### (.+)", RECIPES, flags=re.MULTILINE) == [
        "A format",
        "A finding",
        "A kind of job",
        "A migration",
        "An evidence of placement",
    ]


def test_every_kind_of_job_has_a_handler_of_its_own() -> None:
    assert set(HANDLERS) == set(JobKind)
    assert len(set(HANDLERS.values())) == len(HANDLERS)
