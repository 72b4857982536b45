"""Every rule of CONTRIBUTING says what holds it, `poe check` runs that, and nothing here goes unnamed."""

from __future__ import annotations

import re
import tomllib

import pytest

from tests.architecture.sources import ROOT

TASKS = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["poe"]["tasks"]
PAGE = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
TABLE = PAGE.partition("## Rules, each with what holds it")[2].partition("\n## ")[0]
ROWS = re.findall(r"^\| (.+?) \| (.+?) \|$", TABLE, re.MULTILINE)[1:]
TOOLS = {
    "ruff": "ruff check .",
    "lint-imports": "lint-imports",
    "mypy": "mypy",
    "numpydoc lint": "numpydoc lint",
    "tools/build-dashboard --check": "tools/build-dashboard --check",
    "tools/setup": "tools/setup",
}
STARRED = "(*)"
"""Held by `poe test`: it starts processes, or is what tests stand on."""
RUN = [word for word in TASKS["rules"]["cmd"].split() if word.startswith("tests/")]


def _paths(held_by: str) -> list[str]:
    return re.findall(r"`(tests/[\w/.]+)`", held_by)


def _is_slow(path: str) -> bool:
    text = (ROOT / path).read_text(encoding="utf-8")
    return re.search(r"^pytestmark = pytest\.mark\.slow$", text, re.MULTILINE) is not None


def _is_run(path: str) -> bool:
    return any(path == one or path.startswith(f"{one}/") for one in RUN) and not _is_slow(path)


@pytest.mark.parametrize(("rule", "held_by"), ROWS)
def test_a_rule_is_held_by_what_check_runs_or_by_review(rule: str, held_by: str) -> None:
    if held_by == "by review":
        return
    paths = _paths(held_by)
    assert all((ROOT / path).exists() for path in paths)
    if STARRED in held_by:
        assert [path for path in paths if (ROOT / path).is_file() and _is_run(path)] == []
        return
    assert [path for path in paths if not _is_run(path)] == []
    assert paths or any(tool in held_by for tool in TOOLS), rule


def test_check_runs_the_tools_that_rules_name() -> None:
    assert TASKS["check"]["sequence"] == ["lint", "rules"]
    run = [step["cmd"] for step in TASKS["lint"]["sequence"]] + (ROOT / "tools/test").read_text().splitlines()
    assert [tool for tool, command in TOOLS.items() if not any(command in line for line in run)] == []


def test_every_test_of_the_architecture_holds_a_rule_that_is_told() -> None:
    told = {path for _, held_by in ROWS for path in _paths(held_by)}
    tests = {path.relative_to(ROOT).as_posix() for path in (ROOT / "tests/architecture").glob("test_*.py")}
    assert tests - told == set()
    assert sum(held_by == "by review" for _, held_by in ROWS) == 2
