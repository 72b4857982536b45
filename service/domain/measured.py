"""Dataclasses whose values are kept and sent as JSON: a member's name stands in the class alone."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any, Self


class Measured:
    """Let a dataclass be written as JSON, for what is measured, kept in a row, and only shown afterwards.

    Nothing reads it back, so rows of earlier versions stay as they are: they may lack a member, which is
    then shown as null, as is a number that is not finite. `service.api.schemas.kept` makes the schema.
    """

    def to_json(self) -> dict[str, Any]:
        """Return the value as a JSON object: every member by its name."""
        return _members(self)

    @classmethod
    def upgraded(cls, value: Any) -> Any:
        """Return what an earlier version wrote, an object or a text, as this one would have."""
        return value

    @classmethod
    def of_row(cls, value: Mapping[str, Any]) -> Self:
        """Return what a row of any version holds, to be written again: its members are JSON as they are."""
        told = cls.upgraded(value)
        names = (field.name for field in fields(cls))  # type: ignore[arg-type]  # those that derive are dataclasses
        return cls(**{name: told.get(name) for name in names})


def as_json(value: Any) -> Any:
    """Return a value as JSON: dataclasses as objects, sequences as lists, null for a number not finite.

    Anything that has a `to_json` or a `tolist` of its own says it that way.

    Examples
    --------
    >>> as_json((1.5, math.inf, {"walls": 2}))
    [1.5, None, {'walls': 2}]
    """
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, list | tuple):
        return [as_json(one) for one in value]
    if isinstance(value, Mapping):
        return {name: as_json(one) for name, one in value.items()}
    if hasattr(value, "to_json"):
        return value.to_json()
    if hasattr(value, "tolist"):
        return as_json(value.tolist())
    return _members(value) if is_dataclass(value) else value


def _members(value: Any) -> dict[str, Any]:
    return {field.name: as_json(getattr(value, field.name)) for field in fields(value)}
