"""The page of formats, made from their table; run as a module, it refreshes `docs/formats.md`."""

from __future__ import annotations

import argparse
from pathlib import Path

from service.domain.formats import FORMATS, Media, Purpose

PAGE = Path(__file__).resolve().parents[2] / "docs/formats.md"
HEAD = """# Formats

Every file that is read, as `service/domain/formats.py` lists it; `poe formats` writes this page anew. A
file's own bytes decide what it is, never its name: the endings are those that such files usually have.

How each is read: [drawings](drawings.md), [scans](scans.md). [How to add one](../CONTRIBUTING.md#a-format).
"""
_COLUMNS = "| format | endings | media type |\n|---|---|---|\n"
_BESIDE = " (command line alone: an upload has no file beside it)"


def text() -> str:
    """Return the whole page."""
    parts = [f"\n## Taken as a {purpose}\n\n{_COLUMNS}{_rows(purpose)}" for purpose in Purpose]
    return HEAD + "".join(parts)


def _rows(purpose: Purpose) -> str:
    return "".join(_row(one) for one in FORMATS if one.fits is purpose)


def _row(one: Media) -> str:
    called = ", ".join(one.called) + (_BESIDE if one.needs_others else "")
    endings = ", ".join(f"`{ending}`" for ending in one.extensions)
    return f"| {called} | {endings} | `{one.media_type}` |\n"


if __name__ == "__main__":
    argparse.ArgumentParser(description=__doc__).parse_args()
    PAGE.write_text(text(), encoding="utf-8")
