"""A choice about a scan, with who made it and why."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from service.domain.scan_reading import Source

T = TypeVar("T")


@dataclass(frozen=True)
class Choice(Generic[T]):
    """Hold a value, where it comes from, and the sentences that speak for it."""

    value: T
    source: Source
    evidence: tuple[str, ...]

    @classmethod
    def from_json(cls, value: Mapping[str, Any]) -> Choice[T]:
        """Return the choice that a reading tells."""
        return cls(value["value"], value["source"], tuple(value["evidence"]))
