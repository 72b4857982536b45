"""What was wrong with a vehicle's messages, until it has sent good ones for a while."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

QUIET_S = 10.0
"""How long a vehicle has to send nothing wrong until it counts as repaired [s]: what sends now right, now
wrong is told of once in that time at most. Well below the minute in which a repaired one has to be served."""

Name: TypeAlias = tuple[str, str]
"""Manufacturer and serial number of a vehicle."""


@dataclass
class _Fault:
    sentence: str
    at: float
    is_over: bool = False


class Faults:
    """Remember for each vehicle the first of the faults that follow each other."""

    def __init__(self) -> None:
        self._of: dict[Name, _Fault] = {}

    def wrong(self, name: Name, sentence: str, *, now: float) -> None:
        """Note that a message was wrong."""
        fault = self._of.setdefault(name, _Fault(sentence, now))
        fault.at, fault.is_over = now, False

    def right(self, name: Name) -> None:
        """Note that a message was right, behind those that were wrong."""
        if name in self._of:
            self._of[name].is_over = True

    def of(self, name: Name, *, now: float) -> str | None:
        """Return what is wrong with a vehicle's messages, or None."""
        fault = self._of.get(name)
        if fault is not None and fault.is_over and now - fault.at >= QUIET_S:
            del self._of[name]
            return None
        return None if fault is None else fault.sentence
