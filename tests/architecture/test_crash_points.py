"""Every commit, rename, fsync and message passes a listed crash point, and every listed one is passed."""

from __future__ import annotations

import ast
from collections.abc import Iterator

from service.crash_points import CRASH_POINTS, TRANSACTIONS
from tests.architecture.sources import trees

THE_POINTS_THEMSELVES = "service/crash_points.py"
SYNCS = {"fsync", "fdatasync"}
RENAMES = {"rename", "renames", "link", "hardlink_to"}

# Functions that make bytes last, or move a name, between two points of their callers, or with no trace.
COVERED_BY_CALLERS = {
    "service/storage/local.py:_sync_folder": "settle calls it, between its own points",
    "service/storage/local.py:_bring": "adopt calls it; settle's first point is the next that happens",
    "service/storage/pieces.py:create": "inside the transaction create-upload, before its points",
    "service/storage/pieces.py:size_bytes": "only asks: it writes nothing of its own",
}
ON_FILES_ALONE = "worker/cli/"  # commands on files of their caller: no job, no upload, no row to lose


def _calls() -> Iterator[tuple[str, ast.Call]]:
    for path, tree in trees().items():
        if path != THE_POINTS_THEMSELVES:
            yield from ((path, node) for node in ast.walk(tree) if isinstance(node, ast.Call))


def _called(call: ast.Call) -> str:
    return call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")


def _literals(node: ast.expr) -> list[str]:
    """Return the strings that an argument may be: a literal, or the two of a conditional."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return [node.value]
    if isinstance(node, ast.IfExp):
        return _literals(node.body) + _literals(node.orelse)
    return []


def test_every_transaction_is_listed_and_every_listed_one_is_made() -> None:
    made: set[str] = set()
    for path, call in _calls():
        given = [word.value for word in call.keywords if word.arg == "point"]
        if _called(call) == "writing":
            given += call.args[:1]
        for argument in given:
            names = _literals(argument)
            passed_on = isinstance(argument, ast.Name) and argument.id == "point"
            assert names or passed_on, f"{path}:{call.lineno}: a transaction's name is a literal"
            made |= set(names)
    assert made == TRANSACTIONS


def test_every_point_reached_is_listed_and_every_listed_one_is_reached() -> None:
    transactions = {f"{name}.{when}" for name in TRANSACTIONS for when in ("before-commit", "after-commit")}
    literal: set[str] = set()
    patterns: list[tuple[str, str]] = []
    for path, call in _calls():
        if _called(call) != "reach":
            continue
        (argument,) = call.args
        if isinstance(argument, ast.JoinedStr):
            parts = [part.value if isinstance(part, ast.Constant) else "\0" for part in argument.values]
            before, _, after = "".join(map(str, parts)).partition("\0")
            patterns.append((before, after))
        else:
            names = _literals(argument)
            assert names, f"{path}:{call.lineno}: a crash point's name is a literal"
            literal |= set(names)
    assert literal <= CRASH_POINTS
    for point in CRASH_POINTS - transactions - literal:
        assert any(point.startswith(start) and point.endswith(end) for start, end in patterns if start), point
    for start, end in patterns:
        assert any(point.startswith(start) and point.endswith(end) for point in CRASH_POINTS), (start, end)


def test_every_function_that_syncs_or_renames_passes_a_point() -> None:
    bare = set()
    for path, tree in trees().items():
        for function in () if path.startswith(ON_FILES_ALONE) else ast.walk(tree):
            if isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef):
                called = [node for node in ast.walk(function) if isinstance(node, ast.Call)]
                if any(map(_makes_it_last, called)) and not any(_called(call) == "reach" for call in called):
                    bare.add(f"{path}:{function.name}")
    assert bare == set(COVERED_BY_CALLERS)


def _makes_it_last(call: ast.Call) -> bool:
    """Return whether this is an fsync or a rename (`Path.replace` takes one argument, `str.replace` two)."""
    name = _called(call)
    on_os = isinstance(call.func, ast.Attribute) and getattr(call.func.value, "id", "") == "os"
    is_replace = name == "replace" and not call.keywords and (on_os or len(call.args) == 1)
    return name in SYNCS | RENAMES or is_replace
