"""How much memory a job may take where nobody says: by the machine, and by its control groups."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from service.domain.job_limits import JOB_MEMORY_BYTES, job_memory_of
from service.machine import memory_bytes

MIB = 1 << 20
MACHINE = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")


@pytest.mark.parametrize(
    ("total", "most"), [(12800 * MIB - 5, 10240 * MIB - 4), (12800 * MIB, 10240 * MIB), (99 << 30, 10 << 30)]
)
def test_a_job_takes_the_lesser_of_ten_gib_and_four_fifths(total: int, most: int) -> None:
    assert job_memory_of(total) == most <= JOB_MEMORY_BYTES


@pytest.mark.parametrize(
    ("group", "file", "line"),
    [
        ("", "memory.max", "0::/"),
        ("system.slice/groundplan.service", "memory.max", "0::/system.slice/groundplan.service"),
        ("system.slice", "memory.max", "0::/system.slice/groundplan.service"),
        ("memory", "memory.limit_in_bytes", "9:memory:/docker/of-the-host"),
        ("memory/plant", "memory.limit_in_bytes", "9:memory:/plant"),
    ],
)
def test_a_group_that_holds_the_process_limits_it(tmp_path: Path, group: str, file: str, line: str) -> None:
    own, place = tmp_path / "own", tmp_path / "groups" / group
    place.mkdir(parents=True)
    own.write_text(f"{line}\n")
    for said, most in (("4096\n", 4096), ("max\n", MACHINE), (f"{1 << 62}\n", MACHINE)):
        (place / file).write_text(said)
        assert memory_bytes(groups=tmp_path / "groups", own=own) == most


def test_without_groups_it_is_the_machine_s(tmp_path: Path) -> None:
    assert memory_bytes(groups=tmp_path, own=tmp_path / "none") == MACHINE
    other = tmp_path / "another.slice"
    other.mkdir()
    (other / "memory.max").write_text("4096")
    assert memory_bytes(groups=tmp_path, own=tmp_path / "none") == MACHINE
