"""Which test files are near to a change: by what they import, directly or not, and by what they name."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable
from pathlib import Path, PurePosixPath

ROOMS = ("service", "worker", "migrations", "demo", "client", "tests")
BY_COST = ("unit", "architecture", "geometry", "formats", "service", "migrations", "worker")
"""Folders of tests, the cheapest first; those of others start browsers and fleets, or fill disks."""

_FROM = re.compile(r"^[ \t]*from ([\w.]+) import (\([^)]*\)|[^\n]*)", re.MULTILINE)
_IMPORT = re.compile(r"^[ \t]*import ([^\n]+)", re.MULTILINE)
_NAME = re.compile(r"[\w.]+")
_TEXT = re.compile(r"\"([^\"\n]+)\"|'([^'\n]+)'")


def near(root: Path, changed: Collection[str]) -> list[tuple[int, str]]:
    """Return test files with their distance to changed files, the nearest first; of equals the cheapest.

    A file that changed is at 0, one that imports it or names it in a text is at 1, and so on. A test of a
    costly folder is only near where it changed itself.

    Parameters
    ----------
    root : Path
        The repository.
    changed : collection of str
        Paths of changed files from there, of any kind.
    """
    sources = {
        path.relative_to(root).as_posix(): path.read_text(encoding="utf-8")
        for room in ROOMS
        for path in sorted((root / room).rglob("*.py"))
        if "node_modules" not in path.parts
    }
    needs = {path: _imported(text) for path, text in sources.items()}
    names = {path: _texts(text) for path, text in sources.items() if _is_test(path)}
    distance = dict.fromkeys(changed, 0)
    front, far = set(changed), 0
    while front:
        far += 1
        modules = {_module(path) for path in front}
        told = {path for path in front if not path.endswith(".py")}
        front = {path for path in sources if path not in distance and not modules.isdisjoint(needs[path])}
        front |= {path for path in names if path not in distance and _names_one(names[path], told)}
        distance |= dict.fromkeys(front, far)
    found = [(far, path) for path, far in distance.items() if path in sources and _is_test(path)]
    return sorted(
        ((far, path) for far, path in found if far == 0 or _cost(path) < len(BY_COST)),
        key=lambda one: (one[0], _cost(one[1]), one[1]),
    )


def _is_test(path: str) -> bool:
    return path.startswith("tests/") and PurePosixPath(path).name.startswith("test_")


def _cost(path: str) -> int:
    folder = PurePosixPath(path).parts[1]
    return BY_COST.index(folder) if folder in BY_COST else len(BY_COST)


def _module(path: str) -> str:
    return path.removesuffix(".py").removesuffix("/__init__").replace("/", ".")


def _imported(text: str) -> set[str]:
    found: set[str] = set()
    for module, names in _FROM.findall(text):
        found |= {module} | {f"{module}.{name}" for name in _NAME.findall(names)}
    for names in _IMPORT.findall(text):
        found |= set(_NAME.findall(names))
    return found


def _texts(text: str) -> frozenset[str]:
    return frozenset(one for pair in _TEXT.findall(text) for one in pair)


def _names_one(texts: Iterable[str], paths: Collection[str]) -> bool:
    names = {PurePosixPath(path).name for path in paths} | set(paths)
    return bool(names) and any(text in names or text.rpartition("/")[2] in names for text in texts)
