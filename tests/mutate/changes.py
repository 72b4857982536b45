"""The numbers of a module's source, and the source with one of them changed."""

from __future__ import annotations

import ast
from dataclasses import dataclass

FACTORS = (0.8, 1.25)
"""What a number is multiplied with; a whole one stays whole and moves by 1 at least."""


@dataclass(frozen=True, order=True)
class Change:
    """Name a change: the module's path, the number's place among its numbers, its line, and the factor."""

    module: str
    place: int
    line: int
    factor: float
    before: str
    after: str


def _numbers(tree: ast.Module) -> list[ast.Constant]:
    """Return the numbers of a tree, in order; those in subscripts and annotations are no limits."""
    found: list[ast.Constant] = []

    def visit(node: ast.AST) -> None:
        if isinstance(node, ast.Constant) and type(node.value) in (int, float):
            found.append(node)
        for name, child in ast.iter_fields(node):
            if isinstance(node, ast.Subscript) and name == "slice":
                continue
            if name in {"annotation", "returns"}:
                continue
            for part in child if isinstance(child, list) else [child]:
                if isinstance(part, ast.AST):
                    visit(part)

    visit(tree)
    return found


def _moved(value: float, factor: float) -> float:
    if isinstance(value, int):
        away = abs(value) * abs(factor - 1.0)
        step = max(1, round(away))
        return value + step if factor > 1.0 else value - step
    return float(f"{value * factor:.12g}")


def changes_of(source: str, module: str) -> list[Change]:
    """Return what can be changed in a source; a number that a factor leaves as it is cannot."""
    found = []
    for place, node in enumerate(_numbers(ast.parse(source))):
        for factor in FACTORS:
            value = node.value
            assert isinstance(value, int | float)
            after = _moved(value, factor)
            if after != value:
                found.append(Change(module, place, node.lineno, factor, repr(value), repr(after)))
    return found


def changed(source: str, change: Change) -> str:
    """Return the source with a change; comments are lost."""
    tree = ast.parse(source)
    node = _numbers(tree)[change.place]
    assert repr(node.value) == change.before
    node.value = ast.literal_eval(change.after)
    return ast.unparse(tree)
