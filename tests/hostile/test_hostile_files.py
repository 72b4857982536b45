"""Hostile files through the real upload: each ends as it should, within its cost, and nobody else notices."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from service.settings import Settings
from tests.hostile.damage import DAMAGES, FORMATS, case, damaged
from tests.hostile.known_drawings import KNOWN_DRAWINGS
from tests.hostile.known_scans import KNOWN_SCANS
from tests.hostile.plant import Plant, working
from tests.hostile.run import Case
from tests.ledger import Ledger, digest_of

KNOWN = KNOWN_DRAWINGS | KNOWN_SCANS
SEEDS = range(0, len(FORMATS) * len(DAMAGES), 17)  # each damage, and a third of the kinds
"""Few of the seeds of ``poe hostile``."""


@pytest.fixture(scope="module")
def plant(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Plant]:
    with working(Settings(data_dir=tmp_path_factory.mktemp("hostile"))) as started:
        yield started


@pytest.mark.parametrize("name", KNOWN)
def test_a_known_file_ends_as_it_should(plant: Plant, name: str) -> None:
    known = KNOWN[name]
    ending = plant.ending(plant.send(known.collection, known.make()))
    assert (ending.end, ending.faults) == (known.ends, []), ending.detail
    assert known.finding is None or known.finding in ending.findings


@pytest.mark.postgres
def test_damaged_files_end_as_readings_or_problems(postgres_url: str, tmp_path: Path) -> None:
    with working(Settings(data_dir=tmp_path, database_url=postgres_url)) as plant:
        uploads = {seed: plant.send(FORMATS[case(seed)[0]][0], damaged(*case(seed), seed)) for seed in SEEDS}
        endings = {(*case(seed), seed): plant.ending(upload) for seed, upload in uploads.items()}
    assert {name: ending for name, ending in endings.items() if ending.faults} == {}


def test_a_ledger_forgets_what_other_sources_said(tmp_path: Path) -> None:
    sources = tmp_path / "service"
    (sources / "deep").mkdir(parents=True)
    code = sources / "deep" / "code.py"
    code.write_text("1")
    lock = tmp_path / "uv.lock"
    lock.write_text("1")

    def ledger(word: str = "sqlite") -> Ledger[Case]:
        return Ledger(tmp_path / "ledger.jsonl", Case, of=digest_of(sources, lock, word=word))

    case_, said = Case("png", "cut", 7), {"end": "reading", "faults": []}
    ledger().write(case_, said)
    assert ledger().ended == {case_: said}
    assert ledger("postgresql").ended == {}
    for changed in (code, lock):
        changed.write_text("2")
        assert ledger().ended == {}
        changed.write_text("1")
        assert ledger().ended == {case_: said}
    code.rename(sources / "code.py")
    assert ledger().ended == {}
