"""Values of a binary polygon file (PLY): records of fixed size at once, lists of varied length one by one."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from service.domain.errors import FileMalformed, FileTruncated
from worker.formats.ply_header import PlyElement, PlyHeader

_MAX_VARIED = 2_000_000
"""Records [1] whose lists differ in length, each found where the one before ends: 1 us for each property."""


@dataclass(frozen=True)
class Column:
    """Hold the values of one property; of a list all of them one after the other, with each list's length.

    Parameters
    ----------
    values : (N,) or (sum of lengths,) array
        In the file's own type.
    lengths : (N,) array of int64, optional
        None where the property is no list.
    """

    values: NDArray[Any]
    lengths: NDArray[np.int64] | None = None


def read_columns(path: Path, header: PlyHeader, element: PlyElement, names: Sequence[str]) -> list[Column]:
    """Return properties of one element of a binary file.

    Parameters
    ----------
    path : Path
        The file that `header` was read from.
    element : PlyElement
        One of the header's own.
    names : sequence of str
        Of the element's properties.

    Raises
    ------
    FileTruncated
        If the bytes end before any of the header's elements does.
    FileMalformed
        If a list has fewer than no values, or more than 2,000,000 records have lists of different lengths.
    """
    body = np.memmap(path, dtype=np.uint8, mode="r")
    at, columns = header.data_offset, list[Column]()
    for each in header.elements:
        records = _records(body, at, each, header.encoding)
        if each is element:
            columns = records.columns(names)
        at = records.end
    return columns


@dataclass(frozen=True)
class _Equal:
    """Hold the records of an element that are all of one size."""

    table: NDArray[Any]
    element: PlyElement
    end: int

    def columns(self, names: Sequence[str]) -> list[Column]:
        return [self._column(number) for number in _numbers(self.element, names)]

    def _column(self, number: int) -> Column:
        values = self.table[f"v{number}"]
        if not self.element.properties[number].is_list:
            return Column(values)
        return Column(values.reshape(-1), self.table[f"n{number}"].astype(np.int64))


@dataclass(frozen=True)
class _Varied:
    """Hold where in the bytes each property of each record begins, as (N, properties) positions."""

    body: NDArray[np.uint8]
    order: str
    places: NDArray[np.int64]
    element: PlyElement
    end: int

    def columns(self, names: Sequence[str]) -> list[Column]:
        return [self._column(number) for number in _numbers(self.element, names)]

    def _column(self, number: int) -> Column:
        told, places = self.element.properties[number], self.places[:, number]
        if not told.is_list:
            return Column(self._at(places, told.value_code))
        lengths = self._at(places, told.length_code).astype(np.int64)
        before = np.cumsum(lengths) - lengths
        within = np.arange(int(lengths.sum()), dtype=np.int64) - np.repeat(before, lengths)
        first = np.repeat(places + told.length_bytes, lengths)
        return Column(self._at(first + within * told.value_bytes, told.value_code), lengths)

    def _at(self, places: NDArray[np.int64], code: str) -> NDArray[Any]:
        picked = self.body[places[:, None] + np.arange(int(code[1]))]
        values: NDArray[Any] = picked.view(self.order + code).reshape(-1)
        return values


def _numbers(element: PlyElement, names: Sequence[str]) -> list[int]:
    told = [p.name for p in element.properties]
    return [told.index(name) for name in names]


def _records(body: NDArray[np.uint8], at: int, element: PlyElement, order: str) -> _Equal | _Varied:
    """Return an element's records; all lists are first taken to be as long as those of the first record."""
    first = _walk(body, at, element, order) if element.count else [(at, 0)] * len(element.properties)
    record = _record(element, first, order)
    end = at + element.count * record.itemsize
    lists = [(f"n{k}", n) for k, (_, n) in enumerate(first) if element.properties[k].is_list]
    if end <= len(body):
        table: NDArray[Any] = np.ndarray(element.count, dtype=record, buffer=body, offset=at)
        if all((table[field] == n).all() for field, n in lists):
            return _Equal(table, element, end)
    if not lists:
        raise _cut(element)
    return _one_by_one(body, at, element, order)


def _record(element: PlyElement, first: list[tuple[int, int]], order: str) -> np.dtype[Any]:
    fields: list[Any] = []
    for k, told in enumerate(element.properties):
        if told.is_list:
            fields += [
                (f"n{k}", order + told.length_code),
                (f"v{k}", order + told.value_code, (first[k][1],)),
            ]
        else:
            fields.append((f"v{k}", order + told.value_code))
    return np.dtype(fields)


def _one_by_one(body: NDArray[np.uint8], at: int, element: PlyElement, order: str) -> _Varied:
    if element.count > _MAX_VARIED:
        raise FileMalformed(
            f"The PLY file has {element.count} {element.name} elements whose lists differ in length; at most"
            f" {_MAX_VARIED} of these are read: triangulate it first."
        )
    places = np.zeros((element.count, len(element.properties)), dtype=np.int64)
    for k in range(element.count):
        found = _walk(body, at, element, order)
        places[k] = [place for place, _ in found]
        at = _end(found, element)
    return _Varied(body, order, places, element, at)


def _walk(body: NDArray[np.uint8], at: int, element: PlyElement, order: str) -> list[tuple[int, int]]:
    """Return where each property of the record at `at` begins, and how many values it has."""
    found = []
    for told in element.properties:
        number = 1
        if told.is_list:
            if at + told.length_bytes > len(body):
                raise _cut(element)
            (number,) = struct.unpack_from(order + _STRUCT[told.length_code], body.data, at)
            if number < 0:
                raise FileMalformed(f"A list {told.name!r} of the PLY file has {number} values.")
        found.append((at, number))
        at += told.length_bytes + number * told.value_bytes
        if at > len(body):
            raise _cut(element)
    return found


def _end(found: list[tuple[int, int]], element: PlyElement) -> int:
    """Return where the record ends whose properties were found."""
    (at, number), last = found[-1], element.properties[-1]
    return at + last.length_bytes + number * last.value_bytes


_STRUCT = {"i1": "b", "u1": "B", "i2": "h", "u2": "H", "i4": "i", "u4": "I"}


def _cut(element: PlyElement) -> FileTruncated:
    return FileTruncated(
        f"The PLY file ends before the {element.count} {element.name} elements of its header."
    )
