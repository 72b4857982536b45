"""Seeded hostile files of every kind and damage through the real upload, and one table of how they ended.

``poe hostile 1-400`` pushes a file for each of these seeds, ``poe hostile --draw 400`` as many of seeds that
are drawn and printed. What has ended is kept in a ledger, so that a run goes on where it stopped; what
other sources, another database or other right files said counts no more.
"""

from __future__ import annotations

import argparse
import secrets
import shutil
import sys
import tempfile
import time
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from service.settings import Settings
from tests.hostile.damage import DAMAGES, FORMATS, add_right_files, case, damaged
from tests.hostile.known import READING
from tests.hostile.known_drawings import KNOWN_DRAWINGS
from tests.hostile.known_scans import KNOWN_SCANS
from tests.hostile.plant import Plant, Upload, working
from tests.ledger import Ledger, digest_of
from tests.postgres import running_server

_ROOT = Path(__file__).resolve().parents[2]
_LEDGER = Path("build/hostile.jsonl")
_SOURCES = ("service", "worker", "migrations", "tests", "uv.lock")
_AHEAD = 3
_KNOWN = "known"


@dataclass(frozen=True, order=True)
class Case:
    """Name a file: its kind, what damaged it, and by which seed."""

    kind: str
    damage: str
    seed: int

    def collection(self) -> str:
        """Return what it is uploaded to."""
        return KNOWN[self.damage].collection if self.kind == _KNOWN else FORMATS[self.kind][0]

    def content(self) -> bytes:
        """Return its bytes."""
        return (
            KNOWN[self.damage].make() if self.kind == _KNOWN else damaged(self.kind, self.damage, self.seed)
        )


KNOWN = KNOWN_DRAWINGS | KNOWN_SCANS


@dataclass
class Row:
    """Sum up what happened to the files of one kind."""

    files: int = 0
    readings: int = 0
    problems: int = 0
    slugs: set[str] = field(default_factory=set)
    cpu_s: float = 0.0
    peak_mib: int = 0
    faults: int = 0

    def add(self, said: dict[str, Any]) -> None:
        """Add a file."""
        self.files += 1
        self.readings += said["end"] == READING
        self.problems += said["end"] != READING
        self.slugs |= {said["end"]} - {READING}
        self.cpu_s, self.peak_mib = max(self.cpu_s, said["cpu_s"]), max(self.peak_mib, said["peak_mib"])
        self.faults += bool(said["faults"])

    def line(self, name: str) -> str:
        """Return the row as it is printed."""
        return (
            f"{name:28.28} {self.files:6} {self.readings:8} {self.problems:8} {len(self.slugs):6} "
            f"{self.cpu_s:8.2f} {self.peak_mib:6} {self.faults:6}"
        )


def table(ended: dict[Case, dict[str, Any]]) -> str:
    """Return a row for each kind, and one for all."""
    rows: dict[str, Row] = {}
    for what, said in sorted(ended.items()):
        rows.setdefault(what.kind, Row()).add(said)
        rows.setdefault("all", Row()).add(said)
    rows["all"] = rows.pop("all", Row())
    head = f"{'kind':28} {'files':>6} {'readings':>8} {'problems':>8} {'slugs':>6} {'CPU s':>8} {'MiB':>6} "
    return "\n".join([head + f"{'faults':>6}", *(row.line(name) for name, row in rows.items())])


def push_all(plant: Plant, cases: Iterable[Case]) -> Iterator[tuple[Case, dict[str, Any]]]:
    """Yield how each case ended; a few are uploaded ahead, so that the worker never waits."""
    waiting: deque[tuple[Case, Upload]] = deque()
    for what in cases:
        waiting.append((what, plant.send(what.collection(), what.content())))
        if len(waiting) > _AHEAD:
            yield _ended(plant, *waiting.popleft())
    while waiting:
        yield _ended(plant, *waiting.popleft())


def _ended(plant: Plant, what: Case, upload: Upload) -> tuple[Case, dict[str, Any]]:
    ending = plant.ending(upload)
    if what.kind == _KNOWN and ending.end != KNOWN[what.damage].ends:
        ending.faults.append(f"should end as {KNOWN[what.damage].ends}")
    return what, asdict(ending)


def _asked() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("seeds", nargs="*", default=[], help="a seed or a range: 7 or 1-400")
    parser.add_argument("--draw", type=int, default=0, help="draw so many seeds, and print them")
    parser.add_argument("--known", action="store_true", help="the known files as well")
    parser.add_argument("--each", action="store_true", help="every kind with every damage for each seed")
    parser.add_argument("--more", type=Path, help="damage the files of this folder instead of generated ones")
    parser.add_argument("--postgres", action="store_true", help="on PostgreSQL instead of SQLite")
    parser.add_argument("--ledger", type=Path, default=_LEDGER)
    parser.add_argument("--anew", action="store_true", help="forget what the ledger holds")
    parser.add_argument("--minutes", type=float, default=float("inf"), help="stop after so many")
    return parser.parse_args()


def _cases(asked: argparse.Namespace) -> list[Case]:
    seeds: list[int] = []
    for word in asked.seeds:
        first, _, last = word.partition("-")
        seeds += range(int(first), int(last or first) + 1)
    kinds = add_right_files(asked.more) if asked.more else list(FORMATS)
    drawn = [secrets.randbelow(1 << 40) for _ in range(asked.draw)]
    if drawn:
        print("drawn:", *drawn, flush=True)
    cases = [Case(_KNOWN, name, 0) for name in KNOWN] if asked.known else []
    for seed in seeds + drawn:
        pairs = [(k, d) for k in kinds for d in DAMAGES] if asked.each else [case(seed, kinds)]
        cases += [Case(kind, damage, seed) for kind, damage in pairs]
    return cases


def _until(cases: Iterable[Case], end: float) -> Iterator[Case]:
    for what in cases:
        if time.monotonic() > end:
            return
        yield what


def main() -> int:
    """Push what is asked for, print the table, and return 1 where something was wrong."""
    asked = _asked()
    if asked.anew:
        asked.ledger.unlink(missing_ok=True)
    of = digest_of(
        *(_ROOT / name for name in _SOURCES), *filter(None, [asked.more]), word=str(asked.postgres)
    )
    ledger, cases = Ledger(asked.ledger, Case, of=of), _cases(asked)
    end = time.monotonic() + 60.0 * asked.minutes
    folder = Path(tempfile.mkdtemp(prefix="groundplan-hostile-"))
    todo = _until((what for what in cases if what not in ledger.ended), end)
    try:
        if asked.postgres:
            with running_server() as postgres, postgres.database() as url:
                _push(Settings(data_dir=folder, database_url=url), todo, ledger)
        else:
            _push(Settings(data_dir=folder), todo, ledger)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    seen = {what: ledger.ended[what] for what in cases if what in ledger.ended}
    print(table(seen))
    return int(any(said["faults"] for said in seen.values()))


def _push(settings: Settings, cases: Iterator[Case], ledger: Ledger[Case]) -> None:
    with working(settings) as plant:
        for what, said in push_all(plant, cases):
            ledger.write(what, said)
            if said["faults"]:
                print(what, said["end"], said["detail"], *said["faults"], sep="\n  ", flush=True)


if __name__ == "__main__":
    sys.exit(main())
