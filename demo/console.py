"""What the demonstration says: who speaks, what was done, which numbers came out."""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass, field


class DemoFailed(Exception):
    """A step of the demonstration did not hold; the message says which and how."""


@dataclass
class Console:
    """Write steps on standard output as they happen, with the seconds since the start [s]."""

    started: float = field(default_factory=time.monotonic)
    finished: bool = False

    def act(self, title: str) -> None:
        """Announce who speaks from here on."""
        self._write(f"\n== {title}\n")

    def say(self, sentence: str) -> None:
        """Report one step that is done."""
        self._write(f"  {time.monotonic() - self.started:6.1f} s  {sentence}\n")

    @staticmethod
    def _write(text: str) -> None:
        sys.stdout.write(text)
        sys.stdout.flush()


def expect(fact: object, otherwise: str) -> None:
    """Go on if `fact` holds, else raise `DemoFailed` with the sentence `otherwise`."""
    if not fact:
        raise DemoFailed(otherwise)
