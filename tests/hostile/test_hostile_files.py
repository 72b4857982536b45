"""Every known hostile file through the real upload: it ends as it should, and nobody else notices."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from service.settings import Settings
from tests.hostile.known_drawings import KNOWN_DRAWINGS
from tests.hostile.known_scans import KNOWN_SCANS
from tests.hostile.plant import Plant, working

KNOWN = KNOWN_DRAWINGS | KNOWN_SCANS


@pytest.fixture(scope="module")
def plant(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Plant]:
    with working(Settings(data_dir=tmp_path_factory.mktemp("hostile"))) as started:
        yield started


@pytest.mark.parametrize("name", KNOWN)
def test_a_known_file_ends_as_it_should(plant: Plant, name: str) -> None:
    known = KNOWN[name]
    ending = plant.push(known.collection, known.make(), name="plan.dat")
    assert ending.end == known.ends, ending
    assert known.finding is None or known.finding in ending.findings
    assert plant.unwell(ending.ids) == []
