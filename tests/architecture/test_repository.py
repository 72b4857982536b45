"""What the repository holds: sources and its own pictures, in commits of one form."""

from __future__ import annotations

import re
import subprocess

import pytest

from service.domain.formats import FORMATS
from tests.architecture.sources import ROOT

TEXT = {".svg", ".yaml", ".csv", ".xyz", ".pts"}
"""Endings of formats that are read, which sources have as well: they have to be text at least."""
PICTURES = ("docs/pictures/", "service/web/app/public/icon-", "service/web/dist/icon-")
SUBJECT = re.compile(
    r"(build|chore|ci|docs|feat|fix|perf|refactor|revert|style|test)(\([a-z0-9 ,-]+\))?!?: \S.*"
)


def _git(*words: str) -> list[str]:
    if not (ROOT / ".git").exists():
        pytest.skip("this is no clone: it has no .git")
    done = subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=True)
    return done.stdout.splitlines()


def test_drawings_scans_and_databases_are_made_by_tests_and_not_kept() -> None:
    data = {ending for one in FORMATS for ending in one.extensions} - TEXT
    tracked = [path for path in _git("ls-files") if (ROOT / path).is_file() and not path.startswith(PICTURES)]
    assert len(tracked) > 500
    assert [path for path in tracked if path.endswith(tuple(data))] == []
    assert [path for path in tracked if b"\0" in (ROOT / path).read_bytes()] == []


def test_commits_are_conventional() -> None:
    subjects = _git("log", "--no-merges", "--format=%s")
    assert [subject for subject in subjects if not SUBJECT.fullmatch(subject)] == []
    assert not SUBJECT.fullmatch("Add things")
