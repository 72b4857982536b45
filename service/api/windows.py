"""How many requests each key has sent of late, in a table that does not grow with what strangers invent."""

from __future__ import annotations

import math
import time
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass

WINDOW_S = 60
"""Over how long a key's requests are counted [s]."""

MOST_KEYS = 16_384
"""How many keys are remembered; the one not heard for longest is forgotten first. More than a fleet has, and
more than the requests of a minute that a key may send by default: whoever sends so many strange keys to be
forgotten gains nothing by it. A key takes about 300 bytes."""


@dataclass
class _Window:
    """Hold what a key has sent in the window with this number, and in the one before."""

    number: int
    now: int = 0
    before: int = 0


@dataclass(frozen=True)
class Counted:
    """Hold whether a request is within the limit, how many are left, and when there will be more [s]."""

    is_within: bool
    left: int
    more_in_s: int


class Windows:
    """Count by a sliding window: the last one weighs as much as the sliding one still covers of it.

    Parameters
    ----------
    most : int
        Most requests of one key in a window.
    clock : callable
        Tells seconds that never go back.
    """

    def __init__(self, *, most: int, clock: Callable[[], float] = time.monotonic) -> None:
        self.most = most
        self._clock = clock
        self._windows: OrderedDict[str, _Window] = OrderedDict()

    def __len__(self) -> int:
        """Return how many keys are remembered."""
        return len(self._windows)

    def hit(self, key: str) -> Counted:
        """Count a request of a key, if it is within the limit."""
        number, since = divmod(self._clock(), WINDOW_S)
        window, ends_in_s = self._window(key, int(number)), WINDOW_S - since
        left = self.most - math.floor(window.before * ends_in_s / WINDOW_S + window.now)
        is_within = left > 0
        if is_within:
            window.now += 1
        more_in_s = ends_in_s % (WINDOW_S / window.before) if window.before else ends_in_s
        return Counted(is_within, max(0, left - 1), max(1, math.ceil(more_in_s)))

    def _window(self, key: str, number: int) -> _Window:
        """Return the window of a key, which is now the one that was heard last."""
        window = self._windows.setdefault(key, _Window(number))
        self._windows.move_to_end(key)
        if len(self._windows) > MOST_KEYS:
            self._windows.popitem(last=False)
        if window.number != number:
            window.before = window.now if window.number == number - 1 else 0
            window.number, window.now = number, 0
        return window
