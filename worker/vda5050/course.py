"""What a vehicle has to do next about its map: fetch, enable, tidy up, or nothing."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

from worker.vda5050.messages import ActionState, ActionType, VehicleState

_SILENCE_S = 30.0
_AGAIN_S = 60.0
_LONGEST_S = 3600.0


@dataclass(frozen=True)
class Step:
    """Hold what is to be asked of the vehicle: an action about one version of the map, and its id."""

    type: ActionType
    n: int
    action_id: str


@dataclass
class _Asked:
    """Hold how often an action was asked for, when last, and since when that one has failed."""

    tries: int = 0
    at: float = float("-inf")
    failed_at: float | None = None


@dataclass
class Course:
    """Follow one vehicle's way to the revision that it should have.

    What it was asked for is named by ids that tell it, so that after a restart the vehicle's own state says
    what is under way.

    Parameters
    ----------
    map_id : str
        The map, which is the vehicle's `mapId`; a revision's number is its `mapVersion`.
    """

    map_id: str
    _asked: dict[tuple[ActionType, int], _Asked] = field(default_factory=dict)

    def versions(self, state: VehicleState) -> dict[int, bool]:
        """Return the revisions of the map that the vehicle has, and which is enabled."""
        return {
            int(version): enabled
            for (map_id, version), enabled in state.maps.items()
            if map_id == self.map_id and version.isascii() and version.isdigit()
        }

    def next_step(self, state: VehicleState, wanted_n: int, *, now: float) -> Step | None:
        """Return what to ask of the vehicle now, or None while it works, waits, or has all that it should.

        When it has the revision enabled, older ones are deleted but for the latest, to which it may be sent
        back.
        """
        held = self.versions(state)
        if held.get(wanted_n):
            spare = sorted((n for n, enabled in held.items() if not enabled), reverse=True)[1:]
            return next(self._due(ActionType.DELETE, spare, state, now=now), None)
        kind = ActionType.ENABLE if wanted_n in held else ActionType.DOWNLOAD
        return next(self._due(kind, [wanted_n], state, now=now), None)

    def failure(self, state: VehicleState, wanted_n: int) -> ActionState | None:
        """Return the latest try to fetch or enable the revision, if it has failed."""
        for kind in (ActionType.ENABLE, ActionType.DOWNLOAD):
            asked = self._known(kind, wanted_n, state)
            found = state.actions.get(_action_id(kind, wanted_n, asked.tries))
            if found is not None:
                return found if found.has_failed else None
        return None

    def _due(
        self, kind: ActionType, revisions: Iterable[int], state: VehicleState, *, now: float
    ) -> Iterator[Step]:
        for n in revisions:
            asked = self._known(kind, n, state)
            if now >= self._may_ask_at(kind, n, asked, state, now=now):
                asked.tries, asked.at, asked.failed_at = asked.tries + 1, now, None
                yield Step(kind, n, _action_id(kind, n, asked.tries))

    def _may_ask_at(
        self, kind: ActionType, n: int, asked: _Asked, state: VehicleState, *, now: float
    ) -> float:
        """Return when it may be asked for: once, again after silence, later and later after failures."""
        if asked.tries == 0:
            return now
        found = state.actions.get(_action_id(kind, n, asked.tries))
        if found is None or found.status == "FINISHED":
            return asked.at + _SILENCE_S
        if not found.has_failed:
            return float("inf")
        asked.failed_at = now if asked.failed_at is None else asked.failed_at
        return asked.failed_at + min(_AGAIN_S * 2.0 ** min(asked.tries - 1, 10), _LONGEST_S)

    def _known(self, kind: ActionType, n: int, state: VehicleState) -> _Asked:
        """Return what was asked for, also by a process before this one: the vehicle tells its ids."""
        asked = self._asked.setdefault((kind, n), _Asked())
        while _action_id(kind, n, asked.tries + 1) in state.actions:
            asked.tries += 1
        return asked


def _action_id(kind: ActionType, n: int, tries: int) -> str:
    return f"groundplan-{kind}-{n}-{tries}"
