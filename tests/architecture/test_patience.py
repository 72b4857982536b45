"""No test gives up after a few seconds that a loaded machine may need."""

from __future__ import annotations

import ast

from tests.architecture.sources import ROOT

ASKING = {"get", "head", "post", "put", "patch", "delete", "request", "stream", "options", "Client"}


def test_every_request_of_a_test_says_how_long_it_waits() -> None:
    hasty = []
    for path in sorted((ROOT / "tests").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            match node:
                case ast.Call(func=ast.Attribute(value=ast.Name(id="httpx"), attr=attr)) if attr in ASKING:
                    if not any(word.arg == "timeout" for word in node.keywords):
                        hasty.append(f"{path.name}:{node.lineno}")
    assert hasty == [], "ask by `tests.web`, or give a timeout"
