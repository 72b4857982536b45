"""Nothing stands in the product that nothing but a test calls."""

from __future__ import annotations

import ast
from collections import Counter

from tests.architecture.sources import ROOT, trees

USERS = ("demo", "client", "migrations")


def test_every_function_and_class_of_a_module_is_used() -> None:
    others = [ast.parse(path.read_text()) for room in USERS for path in (ROOT / room).rglob("*.py")]
    used = Counter(name for tree in (*trees().values(), *others) for name in _names_in(tree))
    alone = {name: path for path, tree in trees().items() for name in _undecorated(tree)}
    assert {name: path for name, path in alone.items() if not used[name]} == {}


def _undecorated(tree: ast.Module) -> list[str]:
    """Return what stands in a module by itself; a decorator may be what calls the rest."""
    kinds = ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef
    return [node.name for node in tree.body if isinstance(node, kinds) and not node.decorator_list]


def _names_in(tree: ast.Module) -> list[str]:
    """Return every name that a module uses, imports, or holds as a text, as a registry does."""
    names = []
    for node in ast.walk(tree):
        match node:
            case ast.Name(id=name) | ast.Attribute(attr=name) | ast.alias(name=name):
                names.append(name)
            case ast.Constant(value=str(text)):
                names.append(text)
    return names
