"""Every finding of a drawing or a scan has its line in the documentation, and the reverse."""

from __future__ import annotations

import ast
import re

import pytest

from tests.architecture.sources import ROOT, trees

PAGES = {"drawings.md": False, "scans.md": True}
"""The pages that list findings, and whether they are those of scans."""
SCANS = "scan-"
"""How the codes of a scan's findings begin."""
MAKERS = {"Finding", "_finding"}


def codes_in_code(*, of_scans: bool) -> set[str]:
    """Return the literal codes of all findings that readers make."""
    calls = (node for path, tree in trees().items() if path.startswith("worker/") for node in ast.walk(tree))
    found = {
        str(call.args[0].value)
        for call in calls
        if isinstance(call, ast.Call)
        and getattr(call.func, "id", "") in MAKERS
        and call.args
        and isinstance(call.args[0], ast.Constant)
    }
    return {code for code in found if code.startswith(SCANS) is of_scans}


def codes_in_documents(page: str) -> set[str]:
    told = (ROOT / "docs" / page).read_text(encoding="utf-8").partition("## Findings")[2]
    return set(re.findall(r"^\| `([a-z-]+)` \|", told, re.MULTILINE))


@pytest.mark.parametrize("page", PAGES)
def test_every_finding_is_documented(page: str) -> None:
    made = codes_in_code(of_scans=PAGES[page])
    assert len(made) > 5
    assert made - codes_in_documents(page) == set()


@pytest.mark.parametrize("page", PAGES)
def test_every_documented_finding_is_made_somewhere(page: str) -> None:
    text = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "worker").rglob("*.py"))
    assert {code for code in codes_in_documents(page) if f'"{code}"' not in text} == set()
