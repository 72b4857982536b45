"""Everything that can be started says what it is with --help, and refuses what it does not know."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from tests.architecture.sources import ROOT
from tests.commands import commands

pytestmark = pytest.mark.slow

ROOMS = ("service", "worker", "demo", "client", "migrations", "tests")
BY_PATH = {"worker/formats/dwg_program.py", "client/groundplan_robot.py"}
"""Started as files: one alone in its process, the other alone on its robot."""
SCRIPTS = sorted(path for path in (ROOT / "tools").iterdir() if path.is_file())
PASS_ON = {"demo", "test"}
"""What they do not know, they hand to the program that they start."""
UNKNOWN = "--no-such-thing"


def _starts(path: Path) -> bool:
    return path.name == "__main__.py" or '\nif __name__ == "__main__":' in path.read_text(encoding="utf-8")


def _command(path: Path) -> list[str]:
    name = path.relative_to(ROOT).as_posix()
    if name in BY_PATH:
        return [sys.executable, name]
    return [sys.executable, "-m", name.removesuffix(".py").removesuffix("/__main__").replace("/", ".")]


def _installed() -> dict[str, list[str]]:
    scripts = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["scripts"]
    return {name: [str(Path(sys.executable).parent / name)] for name in scripts}


PROGRAMS = {
    path.relative_to(ROOT).as_posix(): _command(path)
    for room in ROOMS
    for path in sorted((ROOT / room).rglob("*.py"))
    if "node_modules" not in path.parts and _starts(path)
} | _installed()
SUBCOMMANDS = {f"groundplan {words}": [*_installed()["groundplan"], *words.split()] for words in commands()}


def _run(command: list[str]) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        command, capture_output=True, text=True, check=False, cwd=ROOT, stdin=subprocess.DEVNULL
    )


def test_what_can_be_started_is_found() -> None:
    assert {"service/__main__.py", "worker/__main__.py", "worker/child.py", "groundplan"} <= set(PROGRAMS)
    assert len(SUBCOMMANDS) >= 10


@pytest.mark.parametrize("program", PROGRAMS | SUBCOMMANDS)
def test_a_program_explains_itself_and_refuses_what_it_does_not_know(program: str) -> None:
    command = (PROGRAMS | SUBCOMMANDS)[program]
    told = _run([*command, "--help"])
    assert (told.returncode, told.stderr) == (0, "")
    assert told.stdout.startswith("usage: ")
    refused = _run([*command, UNKNOWN])
    assert refused.returncode == 2
    assert refused.stdout == ""
    assert refused.stderr.startswith("usage: ")
    assert "Traceback" not in refused.stderr


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.name)
def test_a_tool_explains_itself_and_does_nothing(script: Path) -> None:
    told = _run([str(script), "--help"])
    assert (told.returncode, told.stderr) == (0, "")
    assert f"usage: tools/{script.name}" in told.stdout or "usage (as root" in told.stdout
    if script.name not in PASS_ON:
        refused = _run([str(script), UNKNOWN])
        assert refused.returncode == 2
        assert script.name in refused.stderr
