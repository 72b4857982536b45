"""Binary bodies of polygon files, held against another reader: lists anywhere, of equal and varied length."""

from __future__ import annotations

import struct
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plyfile import PlyData, PlyElement

from service.domain.errors import FileMalformed, FileTruncated
from worker.formats.ply_body import read_columns
from worker.formats.ply_header import PlyElement as Element
from worker.formats.ply_header import read_ply_header

CODES = ("i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8")


def made(seed: int, path: Path) -> PlyData:
    """Write a file of one to three elements, each with scalars and lists in any order, and return it."""
    rng = np.random.default_rng(seed)
    elements = [_element(rng, f"e{k}") for k in range(rng.integers(1, 4))]
    data = PlyData(elements, byte_order="<>"[seed % 2])
    data.write(str(path))
    return data


def _element(rng: np.random.Generator, name: str) -> PlyElement:
    count, is_varied = int(rng.integers(1, 9)), bool(rng.integers(0, 2))
    fields = [
        (f"p{k}", "O" if rng.random() < 0.4 else str(rng.choice(CODES))) for k in range(rng.integers(1, 6))
    ]
    table = np.zeros(count, dtype=fields)
    kinds = {}
    for column, code in fields:
        if code == "O":
            kinds[column] = str(rng.choice(CODES))
            lengths = rng.integers(0, 5, count) if is_varied else np.full(count, rng.integers(0, 5))
            for row, length in enumerate(lengths):
                table[column][row] = _values(rng, kinds[column], int(length))
        else:
            table[column] = _values(rng, code, count)
    return PlyElement.describe(
        table, name, val_types=kinds, len_types={c: str(rng.choice(("u1", "i2", "u4"))) for c in kinds}
    )


def _values(rng: np.random.Generator, code: str, count: int) -> Any:
    return rng.integers(0, 100, count).astype(code)


@pytest.mark.parametrize("seed", range(60))
def test_every_property_is_what_another_reader_finds(tmp_path: Path, seed: int) -> None:
    path = tmp_path / "a.ply"
    made(seed, path)
    header, oracle = read_ply_header(path), PlyData.read(str(path))
    for element in header.elements:
        names = [p.name for p in element.properties]
        for name, column in zip(names, read_columns(path, header, element, names), strict=True):
            told = oracle[element.name][name]
            if column.lengths is None:
                assert column.values.tolist() == told.tolist()
            else:
                assert column.lengths.tolist() == [len(row) for row in told]
                assert column.values.tolist() == [value for row in told for value in row]


@pytest.mark.parametrize("seed", range(8))
def test_a_body_that_is_cut_anywhere_is_refused(tmp_path: Path, seed: int) -> None:
    path = tmp_path / "a.ply"
    made(seed, path)
    header, whole = read_ply_header(path), path.read_bytes()
    last = header.elements[-1]
    for end in range(header.data_offset, len(whole)):
        path.write_bytes(whole[:end])
        with pytest.raises(FileTruncated):
            read_columns(path, header, last, [p.name for p in last.properties])


@pytest.mark.parametrize("seed", range(20))
def test_damaged_bodies_are_read_or_refused(tmp_path: Path, seed: int) -> None:
    path = tmp_path / "a.ply"
    made(seed, path)
    header, whole = read_ply_header(path), bytearray(path.read_bytes())
    rng = np.random.default_rng(seed)
    for _ in range(20):
        hurt = bytearray(whole)
        hurt[rng.integers(header.data_offset, len(whole))] = rng.integers(0, 256)
        path.write_bytes(hurt)
        for element in header.elements:
            with suppress(FileTruncated, FileMalformed):
                read_columns(path, header, element, [p.name for p in element.properties])


def test_a_list_of_less_than_nothing_is_refused(tmp_path: Path) -> None:
    path = _lists(tmp_path, lengths=[3, -1], length="char")
    with pytest.raises(FileMalformed, match="-1 values"):
        _faces(path)


@pytest.mark.parametrize(("lengths", "refused"), [([3, 4], False), ([3, 4, 3], True)])
def test_lists_of_varied_length_have_a_limit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, lengths: list[int], *, refused: bool
) -> None:
    monkeypatch.setattr("worker.formats.ply_body._MAX_VARIED", 2)
    path = _lists(tmp_path, lengths=lengths)
    if refused:
        with pytest.raises(FileMalformed, match="triangulate"):
            _faces(path)
    else:
        assert _faces(path) == lengths


@pytest.mark.parametrize("element", ["element none 3", "element camera 0\nproperty float f"])
def test_elements_without_bytes_are_passed_over(tmp_path: Path, element: str) -> None:
    head = f"ply\nformat binary_little_endian 1.0\n{element}\nelement vertex 1\nproperty int x\nend_header\n"
    (tmp_path / "a.ply").write_bytes(head.encode() + struct.pack("<i", 7))
    header = read_ply_header(tmp_path / "a.ply")
    assert read_columns(tmp_path / "a.ply", header, header.elements[1], ["x"])[0].values.tolist() == [7]
    read_columns(tmp_path / "a.ply", header, header.elements[0], [])


def test_a_list_that_lies_takes_no_memory(tmp_path: Path) -> None:
    path = _lists(tmp_path, lengths=[3, 4_000_000_000], length="uint")
    with pytest.raises(FileTruncated):
        _faces(path)


def _lists(folder: Path, *, lengths: list[int], length: str = "uchar") -> Path:
    code = {"uchar": "B", "char": "b", "uint": "I"}[length]
    body = b"".join(struct.pack("<" + code, n) + bytes(4 * min(max(n, 0), 9)) for n in lengths)
    head = (
        f"ply\nformat binary_little_endian 1.0\nelement face {len(lengths)}\n"
        f"property list {length} int vertex_indices\nend_header\n"
    )
    (folder / "a.ply").write_bytes(head.encode() + body)
    return folder / "a.ply"


def _faces(path: Path) -> list[int]:
    header = read_ply_header(path)
    element: Element = header.elements[0]
    (column,) = read_columns(path, header, element, ["vertex_indices"])
    assert column.lengths is not None
    return [int(n) for n in column.lengths]
