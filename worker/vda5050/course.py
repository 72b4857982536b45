"""What a vehicle has to do next about its map: fetch, enable, tidy up, or nothing."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

from worker.vda5050.messages import OURS, ActionState, ActionType, VehicleState

_SILENCE_S = 30.0
_AGAIN_S = 60.0
_LONGEST_S = 3600.0
_LARGEST_N = 2**31 - 1
_NUMBER = re.compile(r"[1-9][0-9]{0,9}")


@dataclass(frozen=True)
class Step:
    """Hold what is to be asked of the vehicle: an action about one version of the map, and its id."""

    type: ActionType
    n: int
    action_id: str


@dataclass
class _Asked:
    """Hold when an action was asked for last, by which id, and how that went; None: not asked for yet."""

    last: int = 0
    action_id: str | None = None
    at: float = float("-inf")
    failures: int = 0
    failed_at: float | None = None


@dataclass
class Course:
    """Follow one vehicle's way to the revision that it should have.

    What it was asked for is named by ids that tell it, so that after a restart the vehicle's own state says
    what is under way. A vehicle is judged only by what it says of an action that was asked for since it
    should have the revision: what it remembers of earlier tries decides nothing.

    Parameters
    ----------
    map_id : str
        The map, which is the vehicle's `mapId`; a revision's number is its `mapVersion`.
    wanted_n : int, optional
        The revision that it should have.
    has_told_failure : bool
        Whether a failure with this revision has been passed on since it should have it.
    """

    map_id: str
    wanted_n: int | None = None
    has_told_failure: bool = False
    _asked: dict[tuple[ActionType, int], _Asked] = field(default_factory=dict)

    def want(self, n: int | None) -> None:
        """Set out for a revision; for another one than before everything begins anew."""
        if n != self.wanted_n:
            self.wanted_n, self.has_told_failure = n, False
            self._asked.clear()

    def versions(self, state: VehicleState, *, below: int = _LARGEST_N + 1) -> dict[int, bool]:
        """Return the revisions of the map that the vehicle has, and which is enabled.

        A version that is no number below `below` is no revision of ours: it is left as it is.
        """
        ours = {
            int(version): enabled
            for (map_id, version), enabled in state.maps.items()
            if map_id == self.map_id and _NUMBER.fullmatch(version)
        }
        return {n: enabled for n, enabled in ours.items() if n < below}

    def next_step(
        self, state: VehicleState, wanted_n: int, *, now: float, below: int = _LARGEST_N + 1
    ) -> Step | None:
        """Return what to ask of the vehicle now, or None while it works, waits, or has all that it should.

        A revision is enabled only while the vehicle stands without an order. When it has the revision
        enabled, older ones are deleted but for the latest, to which it may be sent back.
        """
        self.want(wanted_n)
        held = self.versions(state, below=below)
        if held.get(wanted_n):
            spare = sorted((n for n, enabled in held.items() if not enabled), reverse=True)[1:]
            return next(self._due(ActionType.DELETE, spare, state, now=now), None)
        if wanted_n not in held:
            return next(self._due(ActionType.DOWNLOAD, [wanted_n], state, now=now), None)
        if not state.is_idle:
            return None
        return next(self._due(ActionType.ENABLE, [wanted_n], state, now=now), None)

    def failure(self, state: VehicleState, wanted_n: int) -> ActionState | None:
        """Return the latest try to fetch or enable the revision, if it was asked for here and has failed."""
        for kind in (ActionType.ENABLE, ActionType.DOWNLOAD):
            asked = self._asked.get((kind, wanted_n))
            found = None if asked is None else state.actions.get(asked.action_id or "")
            if found is not None:
                return found if found.has_failed else None
        return None

    def _due(
        self, kind: ActionType, revisions: Iterable[int], state: VehicleState, *, now: float
    ) -> Iterator[Step]:
        for n in revisions:
            asked = self._asked.setdefault((kind, n), _Asked())
            numbers = _numbers(kind, n, state)
            asked.last = max([asked.last, *numbers])
            if now >= self._may_ask_at(kind, n, asked, state, now=now):
                asked.last += 1
                asked.action_id, asked.at, asked.failed_at = _action_id(kind, n, asked.last), now, None
                yield Step(kind, n, asked.action_id)

    def _may_ask_at(
        self, kind: ActionType, n: int, asked: _Asked, state: VehicleState, *, now: float
    ) -> float:
        """Return when it may be asked for: once, again after silence, later and later after failures.

        What goes on is waited for, also if a process before this one asked for it.
        """
        if asked.action_id is None:
            latest = state.actions.get(_action_id(kind, n, asked.last))
            return now if latest is None or latest.has_ended else float("inf")
        found = state.actions.get(asked.action_id)
        if found is None or found.status == "FINISHED":
            return asked.at + _SILENCE_S
        if not found.has_failed:
            return float("inf")
        if asked.failed_at is None:
            asked.failed_at, asked.failures = now, asked.failures + 1
        return asked.failed_at + min(_AGAIN_S * 2.0 ** min(asked.failures - 1, 10), _LONGEST_S)


def _action_id(kind: ActionType, n: int, number: int) -> str:
    return f"{OURS}{kind}-{n}-{number}"


def _numbers(kind: ActionType, n: int, state: VehicleState) -> list[int]:
    """Return the numbers of an action's tries that the vehicle tells of."""
    head = _action_id(kind, n, 0)[:-1]
    tails = (action_id.removeprefix(head) for action_id in state.actions if action_id.startswith(head))
    return [int(tail) for tail in tails if _NUMBER.fullmatch(tail)]
