"""The product's sources as syntax trees, parsed once."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
ROOMS = ("service", "worker")


@cache
def trees() -> dict[str, ast.Module]:
    """Return each source file of the product by its path, as a tree."""
    paths = sorted(path for room in ROOMS for path in (ROOT / room).rglob("*.py"))
    return {path.relative_to(ROOT).as_posix(): ast.parse(path.read_text()) for path in paths}


@cache
def names_used_outside(path: str) -> frozenset[str]:
    """Return every name that the product uses outside of a file or a folder, imports left out."""
    return frozenset(
        node.id if isinstance(node, ast.Name) else node.attr
        for other, tree in trees().items()
        if not other.startswith(path)
        for node in ast.walk(tree)
        if isinstance(node, ast.Name | ast.Attribute)
    )
