"""A choice about a scan, with who made it and why."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Generic, Literal, TypeVar

T = TypeVar("T")

Source = Literal["given", "stated", "found", "assumed"]
"""Given by a person, stated by the file, found from the points, or assumed for want of all of these."""


@dataclass(frozen=True)
class Choice(Generic[T]):
    """Hold a value, where it comes from, and the sentences that speak for it."""

    value: T
    source: Source
    evidence: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """Return the choice as a JSON object."""
        return {"value": self.value, "source": self.source, "evidence": list(self.evidence)}

    @classmethod
    def from_json(cls, value: Mapping[str, Any]) -> Choice[T]:
        """Return the choice that `to_json` wrote."""
        return cls(value["value"], value["source"], tuple(value["evidence"]))
