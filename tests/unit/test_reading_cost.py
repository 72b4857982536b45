from __future__ import annotations

import struct
from dataclasses import replace

import pytest

from service.domain.bounds import Bounds
from service.domain.job_limits import JOB_MEMORY_BYTES, JobLimits, Limit, Limits, Usage
from service.domain.media import HEAD_BYTES
from service.domain.reading_cost import Promise, ReadingLimits
from service.settings import Settings
from tests import files

BOUNDS = Bounds()
MIB, GIB = 1 << 20, 1 << 30


def promise_of(content: bytes, size_bytes: int | None = None) -> Promise:
    return Promise.of(content[:HEAD_BYTES], size_bytes=size_bytes or len(content), bounds=BOUNDS)


def las(points: int, *, minor: int = 2) -> bytes:
    head = bytearray(b"LASF" + bytes(371))
    head[24:26] = bytes([1, minor])
    head[107:111] = struct.pack("<I", points if minor < 4 else 0)
    head[247:255] = struct.pack("<Q", points if minor >= 4 else 0)
    return bytes(head)


def zipped(name: str) -> bytes:
    return b"PK\x03\x04" + bytes(22) + struct.pack("<HH", len(name), 0) + name.encode()


@pytest.mark.parametrize(
    ("content", "size", "points"),
    [
        (files.ply_header(40_000_000), 600_000_000, 40_000_000),
        (files.pcd(files.room()), None, 5_000),
        (las(7_000_000), 1_000_000_000, 7_000_000),
        (las(8_000_000, minor=4), 1_000_000_000, 8_000_000),
        (las(4_000_000_000), 1_000, BOUNDS.max_points),
        (b"1 2 3\n4 5 6\n7 8 9\n" * 100, 30_000_000, 5_000_000),
        (b"v 1 2 3\n", 80_000_000, 10_000_000),
        (b"v 1 2 3\n", 2_000_000_000, BOUNDS.max_points),
        (b"ply\rformat ascii 1.0\r", 30_000_000, 10_000_000),
        (b"# .PCD v0.7\nDATA binary_compressed\n", 9_000_000, 9_000_000),
        (las(0)[:100], 9_000_000, 9_000_000),
        (bytes(80) + (100).to_bytes(4, "little") + bytes(5_000), 36_000_000, 3_000_000),
        (b"ASTM-E57" + bytes(60), 6_000_000, 3_000_000),
        (b"glTF" + bytes(60), 6_000_000, 3_000_000),
        (b"PXR-USDC" + bytes(60), 6_000_000, 3_000_000),
        (zipped("room.usdc"), 6_000_000, 3_000_000),
    ],
)
def test_a_scan_promises_what_its_header_tells_or_its_size_can_hold(
    content: bytes, size: int | None, points: int
) -> None:
    assert promise_of(content, size) == Promise(points=points)


def test_a_sheet_promises_its_pixels() -> None:
    assert promise_of(files.white_png(9000, 8000)) == Promise(pixels=72_000_000)
    assert promise_of(b"II*\0" + bytes(60), 1000) == Promise(pixels=256_000)
    assert promise_of(b"II*\0" + bytes(60), 90_000_000) == Promise(pixels=BOUNDS.max_pixels)
    assert promise_of(b"BM" + bytes(60), 1_000_000) == Promise(pixels=8_000_000)
    assert promise_of(b"P5\n3000 3000\n255\n" + bytes(60), 9_000_000) == Promise(pixels=9_000_000)
    assert promise_of(zipped("map.yaml"), 1000) == Promise(pixels=256_000)


def test_a_cad_file_promises_its_bytes() -> None:
    assert promise_of(b"  0\nSECTION\n  2\nHEADER\n", 30_000_000) == Promise(cad_bytes=30_000_000)
    pdf = promise_of(b"%PDF-1.7\n", 659)
    assert pdf == Promise(pixels=659 * 256, cad_bytes=659)
    assert pdf.cpu_s(60.0) == 60.0


@pytest.mark.parametrize(
    ("promise", "cpu_s"),
    [
        (Promise(), 60.0),
        (Promise(points=1_000_000), 60.0),
        (Promise(points=1_600_000), 66.0),
        (Promise(points=50_000_000), 550.0),
        (Promise(pixels=10_000_000), 60.0),
        (Promise(pixels=200_000_000), 250.0),
        (Promise(cad_bytes=10_000_000), 60.0),
        (Promise(cad_bytes=96 * MIB), 60.0 + 10.0 * (96 * MIB / 10_000_000 - 1.0)),
    ],
)
def test_cpu_grows_with_each_further_step(promise: Promise, cpu_s: float) -> None:
    assert promise.cpu_s(60.0) == pytest.approx(cpu_s)


def test_memory_is_the_base_until_the_content_needs_more() -> None:
    assert Promise(points=5_900_000).memory_bytes(2 * GIB) == 2 * GIB
    assert Promise(points=6_100_000).memory_bytes(2 * GIB) > 2 * GIB
    assert Promise(pixels=89_000_000).memory_bytes(2 * GIB) == 2 * GIB
    assert Promise(pixels=90_000_000).memory_bytes(2 * GIB) > 2 * GIB
    ifc = promise_of(b"ISO-10303-21;\nHEADER;\nFILE_SCHEMA(('IFC4'));\n", 5_000)
    assert ifc.memory_bytes(2 * GIB) == GIB + BOUNDS.max_model_memory_bytes


JOB = JobLimits(10 * GIB, 1800.0, 1700.0, reading_memory_bytes=2 * GIB, reading_cpu_s=60.0)
USED = Usage(memory_bytes=2500 * MIB, cpu_s=81.26, wall_s=1700.4)


@pytest.mark.parametrize(
    ("limit", "told"),
    [
        ("cpu", "took 81.26 s of CPU; a file of 3 million points may take 80 s. Thin the scan"),
        (
            "memory",
            "held 2500 MiB of memory and wanted more; a file of 3 million points may take 2048 MiB. T",
        ),
        ("wall", "took 1700 s; a file of 3 million points may take 1700 s. Thin the scan"),
    ],
)
def test_the_refusal_says_which_limit_what_was_used_what_was_promised_and_what_to_do(
    limit: Limit, told: str
) -> None:
    limits = ReadingLimits.of(Promise(points=3_000_000), JOB, file_name="hall.ply")
    assert ReadingLimits.from_json(limits.to_json()) == limits
    problem = limits.refusal(limit, USED).problem()
    assert problem["slug"] == "reading-too-costly"
    assert (problem["limit"], problem["points"], problem["pixels"]) == (limit, 3_000_000, 0)
    assert (problem["cpu_limit_s"], problem["cpu_used_s"]) == (80.0, 81.3)
    assert (problem["memory_limit_bytes"], problem["memory_used_bytes"]) == (2 * GIB, 2500 * MIB)
    assert (problem["wall_limit_s"], problem["wall_used_s"]) == (1700.0, 1700.4)
    assert problem["detail"].startswith(f"Reading hall.ply {told}")


@pytest.mark.parametrize(
    ("limit", "slug", "told"),
    [
        ("cpu", "job-timed-out", "took 81.26 s of CPU; a job may take 1800 s."),
        ("memory", "job-out-of-memory", "held 2500 MiB of memory and wanted more; a job may take 10240 MiB."),
        ("wall", "job-timed-out", "took 1700 s; a job may take 1700 s."),
    ],
)
def test_so_does_that_of_a_job_which_reads_no_file(limit: Limit, slug: str, told: str) -> None:
    problem = JOB.refusal(limit, USED).problem()
    assert (problem["slug"], problem["limit"], problem["cpu_used_s"]) == (slug, limit, 81.3)
    assert problem["detail"].startswith(f"The job {told} Ask for less at a time")
    assert f"GROUNDPLAN_JOB_{limit.upper()}" in problem["detail"]


@pytest.mark.parametrize(
    ("used", "limit"),
    [
        (Usage(10 * GIB, 1800.0, 1700.0), None),
        (Usage(10 * GIB + 1), "memory"),
        (Usage(cpu_s=1800.1), "cpu"),
        (Usage(wall_s=1700.1), "wall"),
        (Usage(1, 1.0, 1.0).most(Usage(0, 1801.0, 0.5)), "cpu"),
    ],
)
def test_a_limit_is_passed_by_more_than_it(used: Usage, limit: Limit | None) -> None:
    assert JOB.passed(used) == limit


def test_numbers_for_machines_are_told_to_a_tenth() -> None:
    told = Limits(memory_bytes=GIB, cpu_s=80.26, wall_s=1700.26).members("cpu", Usage(5, 81.26, 1700.44))
    assert (told["cpu_limit_s"], told["wall_limit_s"]) == (80.3, 1700.3)
    assert (told["memory_used_bytes"], told["cpu_used_s"], told["wall_used_s"]) == (5, 81.3, 1700.4)
    assert Usage() == Usage(memory_bytes=0, cpu_s=0.0, wall_s=0.0)


def test_a_promise_is_told_in_millions() -> None:
    assert Promise(pixels=72_000_000, cad_bytes=2_500_000).words() == "72 Mpx and 2.5 MB of drawing"


def test_no_reading_may_take_more_than_any_job() -> None:
    limits = ReadingLimits.of(
        Promise(points=50_000_000), replace(JOB, memory_bytes=3 * GIB, cpu_s=100.0), file_name="a"
    )
    assert (limits.memory_bytes, limits.cpu_s) == (3 * GIB, 100.0)


def test_the_largest_scan_that_bounds_let_in_has_room_by_default() -> None:
    """A point takes 136 bytes and 5.3 to 7.1 us of CPU (`tests/benchmarks/test_largest_files.py`)."""
    may = Settings()
    job = JobLimits(
        JOB_MEMORY_BYTES, may.job_cpu_s, may.job_wall_s, may.reading_memory_bytes, may.reading_cpu_s
    )
    limits = ReadingLimits.of(Promise(points=BOUNDS.max_points), job, file_name="a")
    assert limits.memory_bytes >= 1.2 * 136 * BOUNDS.max_points
    assert limits.cpu_s == 60.0 + 10.0 * 49
