"""What docs/command-line.md says of the commands."""

from __future__ import annotations

import re
from pathlib import Path

PAGE = Path(__file__).resolve().parents[1] / "docs" / "command-line.md"
_ROW = re.compile(r"^\| `groundplan ([a-z0-9 ]+)` \| (.*?) \|", re.MULTILINE)


def documented(command: str) -> list[str]:
    """Return the members of a command's JSON in the page's order; none of one that runs for ever."""
    told = dict(_ROW.findall(PAGE.read_text(encoding="utf-8")))[command]
    return re.findall(r"`(\w+)`", told)


def commands() -> list[str]:
    """Return the commands that the page names."""
    return [name for name, _ in _ROW.findall(PAGE.read_text(encoding="utf-8"))]
