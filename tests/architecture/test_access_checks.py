"""Every route and every use case that is told who asks also looks at it: none relies on its author alone."""

from __future__ import annotations

import ast
from collections.abc import Iterator

import pytest

from tests.architecture.sources import trees

CHECKS = {"covers", "require_role", "require_all_maps", "require_map", "map_ids", "role"}
"""What of an actor decides: its role, or the maps that it covers."""
RECORDERS = {
    "answer_once": "remembers whose answer it was; the act that it is given looks",
    "ask_for_delta": "records who asked; the pointer's and the delta's use case have looked",
    "change": "records who revised; `revise`, `accept_placement` and `accept_proposal` have looked",
    "joined": "counts the streams of a key; what a listener hears is asked of its actor each time",
}
"""Public functions that only write down who asked, each with who looks."""

Function = ast.FunctionDef | ast.AsyncFunctionDef


def functions(room: str) -> dict[str, list[Function]]:
    """Return the functions of a room that are told who asks, by name."""
    found: dict[str, list[Function]] = {}
    for path, tree in trees().items():
        if path.startswith(room):
            for node in ast.walk(tree):
                if isinstance(node, Function) and _actors(node):
                    found.setdefault(node.name, []).append(node)
    return found


def _actors(function: Function) -> set[str]:
    """Return the names of its parameters that are an actor."""
    arguments = [*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs]
    return {one.arg for one in arguments if one.annotation and _is_actor(ast.unparse(one.annotation))}


def _is_actor(annotation: str) -> bool:
    return annotation in {"Actor", "AnyActor", "TabletActor", "AdminActor"}


def _looks(function: Function) -> bool:
    """Return whether it asks an actor for what decides."""
    actors = _actors(function)
    return any(
        isinstance(node, ast.Attribute)
        and node.attr in CHECKS
        and isinstance(node.value, ast.Name)
        and node.value.id in actors
        for node in ast.walk(function)
    )


def _passes_to(function: Function) -> Iterator[str]:
    """Give the names of what it hands its actor to."""
    actors = _actors(function)
    for node in ast.walk(function):
        if isinstance(node, ast.Call):
            given = [*node.args, *(word.value for word in node.keywords)]
            if any(isinstance(one, ast.Name) and one.id in actors for one in given):
                yield ast.unparse(node.func).rpartition(".")[2]
                yield from (name.id for name in given if isinstance(name, ast.Name))


def checked(known: dict[str, list[Function]], *, below: frozenset[str] = frozenset()) -> frozenset[str]:
    """Return the functions that look at an actor, or hand it to one that does, here or `below`."""
    good = below
    while True:
        more = below | {
            name
            for name, each in known.items()
            if all(_looks(one) or good & set(_passes_to(one)) for one in each)
        }
        if more == good:
            return good
        good = more


def test_who_asks_is_looked_at_by_all_who_are_told() -> None:
    usecases, routes = functions("service/usecases/"), functions("service/api/")
    assert min(len(usecases), len(routes)) > 50
    looking = checked(usecases)
    blind = (set(usecases) - looking) | (set(routes) - checked(routes, below=looking))
    assert {name for name in blind if not name.startswith("_")} == set(RECORDERS)


@pytest.mark.parametrize(
    ("source", "is_found"),
    [
        ("def f(actor: Actor): return actor.key_id", True),
        ("def f(actor: Actor): actor.require_role(Role.ADMIN)", False),
        ("def f(actor: Actor, x): g(actor, x)\ndef g(who: Actor, x): return x", True),
        ("def f(actor: Actor, x): g(actor, x)\ndef g(who: Actor, x): who.require_map(x)", False),
        ("def f(asked: AdminActor, actor: Actor): g(asked)\ndef g(who: Actor): return who.key_id", True),
    ],
)
def test_one_who_does_not_look_is_found(source: str, *, is_found: bool) -> None:
    known: dict[str, list[Function]] = {}
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, Function):
            known.setdefault(node.name, []).append(node)
    assert ("f" not in checked(known)) is is_found
