"""Remarks about an input or a result: never a refusal, always with a stable code."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from service.domain.geojson import Geometry
from service.domain.measured import Measured

Severity = Literal["info", "warning", "serious"]
Value = int | float | bool | str | Sequence[int | float] | Sequence[str] | None
"""A number, a word, or a plain list of either."""


@dataclass(frozen=True)
class Finding(Measured):
    """Hold one remark: a stable code, a sentence, and what it rests on.

    Parameters
    ----------
    code : str
        Kebab-case; what a program goes by.
    severity : {"info", "warning", "serious"}
        Something serious asks for a look before a map is made.
    message : str
        A sentence for people.
    values : mapping of str to number, str, or list of either
        What was counted or measured; a key carries its unit.
    where : Geometry, optional
        The place: of a drawing in the file's own coordinates, as edits take them; of a scan in frame `scan`.

    Raises
    ------
    ValueError
        If a value is nested.
    """

    code: str
    severity: Severity
    message: str
    values: Mapping[str, Value] = field(default_factory=dict)
    where: Geometry | None = None

    def __post_init__(self) -> None:
        nested = [name for name, value in self.values.items() if not _is_plain(value)]
        if nested:
            msg = f"the finding {self.code} has values that are neither words, numbers nor lists: {nested}"
            raise ValueError(msg)

    @classmethod
    def upgraded(cls, value: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return a stored finding with the members that earlier versions had beside the message as values.

        Polygons of a member `plans` are its place, members of a member are values of their joint name.
        """
        told = {name: value.get(name) for name in ("code", "severity", "message")}
        if isinstance(value.get("values"), Mapping):
            return {**told, "values": dict(_flat(value["values"])), "where": value.get("where")}
        others = {name: one for name, one in value.items() if name not in told}
        plans = others.get("plans")
        if not (isinstance(plans, list) and all(isinstance(one, dict) and "within" in one for one in plans)):
            return {**told, "values": dict(_flat(others)), "where": None}
        where = Geometry.polygons(one["within"] for one in others.pop("plans")).to_json()
        return {**told, "values": dict(_flat(others)), "where": where}


def _is_plain(value: object) -> bool:
    if isinstance(value, list | tuple):
        return all(isinstance(one, str | int | float) for one in value)
    return value is None or isinstance(value, str | int | float)


def _flat(values: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Give values that may be nested as plain ones; what is no list of words or numbers as its JSON text."""
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{name}_")
        else:
            yield f"{prefix}{name}", value if _is_plain(value) else json.dumps(value)
