"""Every finding of a drawing has its line in the documentation, and the reverse."""

from __future__ import annotations

import ast
import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
PLACES = (ROOT / "worker" / "geometry" / "drawing", ROOT / "worker" / "formats")
NOT_OF_DRAWINGS = "scan-"
MAKERS = {"Finding", "_finding"}


def codes_in_code() -> set[str]:
    """Return the literal codes of all findings that readers of drawings make."""
    found = set()
    for path in (path for place in PLACES for path in place.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            is_finding = isinstance(node, ast.Call) and getattr(node.func, "id", "") in MAKERS
            if is_finding and node.args and isinstance(node.args[0], ast.Constant):
                found.add(str(node.args[0].value))
    return {code for code in found if not code.startswith(NOT_OF_DRAWINGS)}


def codes_in_documents() -> set[str]:
    page = (ROOT / "docs" / "drawings.md").read_text(encoding="utf-8").partition("## Findings")[2]
    return set(re.findall(r"^\| `([a-z-]+)` \|", page, re.MULTILINE))


def test_every_finding_is_documented() -> None:
    assert codes_in_code() - codes_in_documents() == set()


def test_every_documented_finding_is_made_somewhere() -> None:
    text = "".join(path.read_text(encoding="utf-8") for place in PLACES for path in place.rglob("*.py"))
    assert {code for code in codes_in_documents() if f'"{code}"' not in text} == set()
