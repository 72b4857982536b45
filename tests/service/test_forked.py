"""Processes that are forked for tests behave as those that a shell starts."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from service.settings import Settings
from tests.forked import ROOT, forked
from tests.server import environment


@pytest.mark.parametrize("words", [["migrate"], ["key", "create"], ["nonsense"]])
def test_it_ends_and_speaks_as_one_that_python_starts(words: list[str], tmp_path: Path) -> None:
    told = []
    for name in ("forked", "started"):
        surroundings = environment(Settings(data_dir=tmp_path / name))
        with (tmp_path / f"{name}.txt").open("wb") as errors:
            if name == "forked":
                process = forked("service", *words, env=surroundings, stdout=subprocess.PIPE, stderr=errors)
                assert process.stdout is not None
                out, status = process.stdout.read(), process.wait()
                process.stdout.close()
            else:
                command = [sys.executable, "-m", "service", *words]
                done = subprocess.run(
                    command,
                    env=surroundings,
                    stdout=subprocess.PIPE,
                    stderr=errors,
                    cwd=ROOT,
                    check=False,
                    text=True,
                )
                out, status = done.stdout, done.returncode
        said = (tmp_path / f"{name}.txt").read_text().replace(str(tmp_path / name), "DATA")
        told.append((status, out.replace(str(tmp_path / name), "DATA"), said))
    assert told[0] == told[1]


def test_it_can_be_killed_and_says_by_what(tmp_path: Path) -> None:
    with (tmp_path / "log").open("wb") as log:
        process = forked("worker", env=environment(Settings(data_dir=tmp_path)), stderr=log, stdout=log)
        assert process.poll() is None
        process.kill()
        assert process.wait() == -signal.SIGKILL == process.poll()
        process.send_signal(signal.SIGTERM)  # nobody else is meant by its number


def test_what_is_forked_later_knows_nothing_of_what_was_before(tmp_path: Path) -> None:
    for name in ("one", "two"):
        surroundings = environment(Settings(data_dir=tmp_path / name))
        assert forked("service", "migrate", env=surroundings).wait() == 0
    assert (tmp_path / "one" / "groundplan.sqlite3").exists()
    assert (tmp_path / "two" / "groundplan.sqlite3").exists()
