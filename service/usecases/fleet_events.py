"""Tell what happens in the fleet: pointers that move, and what robots report."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from enum import StrEnum
from typing import Any

from service.db import fleet_events as table
from service.db.models import Publication
from service.db.robots import RobotReport
from service.db.session import Session
from service.domain.access import Actor
from service.domain.errors import InvalidRequest
from service.domain.ids import first_id_at, made_at
from service.domain.lifecycle import Role
from service.usecases.maps import covered_map

_LATE = timedelta(seconds=10)
"""How much later than its id was made an event may become visible: its transaction has to end first."""

_EPOCH = datetime.fromtimestamp(0, UTC)
_MOST = 1_000
_SUFFIX = 26


class EventKind(StrEnum):
    """What happened."""

    PUBLICATION = "publication"
    REPORT = "report"


@dataclass(frozen=True)
class FleetEvent:
    """Hold one thing that happened: `id` sorts by time, `told` is what more there is to say."""

    id: str
    kind: EventKind
    map_id: str
    at: datetime
    told: dict[str, Any]


class News:
    """Find what has happened since the last look, each event once.

    A transaction may end after one whose ids are younger, so each look begins ten seconds before the last
    one did, and what was found is not found again. The first look finds the last ten seconds.
    """

    def __init__(self) -> None:
        self._since: datetime | None = None
        self._found: set[str] = set()

    def look(self, session: Session, *, now: datetime) -> list[FleetEvent]:
        """Return what was not found before, in the order of its time."""
        since = now - _LATE if self._since is None else self._since
        ids = table.ids_behind(session, first_id_at("pub", since), first_id_at("rep", since))
        new = [id_ for id_ in ids if id_ not in self._found]
        found = [_published(row) for row in table.find_publications(session, _of_kind("pub", new))]
        found += [_reported(*row) for row in table.find_reports(session, _of_kind("rep", new))]
        self._since = max(since, now - _LATE)
        self._found = set(ids)
        return sorted(found, key=lambda event: event.id)


@dataclass
class Past:
    """Hold what happened before somebody began to listen, so that nothing is told twice or never.

    Parameters
    ----------
    covered : collection of str, optional
        The maps that are listened to; None: all.
    cursor : str
        Id of the event after which the past is to be told; None: nothing of it is.
    floor : str
        Events with ids before this one are past, whenever they are found.
    known : set of str
        Of the events after the floor those that were visible already.
    """

    covered: Collection[str] | None
    cursor: str | None
    floor: str
    known: set[str] = field(default_factory=set)

    def page(self, session: Session) -> list[FleetEvent]:
        """Return the next part of what is to be told, in the order of its time; empty at the end."""
        if self.cursor is None:
            return []
        found = [
            _published(row)
            for row in table.publications_behind(
                session, f"pub_{self.cursor}", covered=self.covered, limit=_MOST
            )
        ]
        found += [
            _reported(*row)
            for row in table.reports_behind(session, f"rep_{self.cursor}", covered=self.covered, limit=_MOST)
        ]
        found = sorted(found, key=lambda event: event.id)[:_MOST]
        self.cursor = found[-1].id if found else None
        self.known |= {event.id for event in found if event.id > self.floor}
        return found

    def is_news(self, event_id: str) -> bool:
        """Return whether an event that was found since is to be told."""
        return event_id > self.floor and event_id not in self.known


def listen(session: Session, actor: Actor, *, map_id: str | None, after: str | None, now: datetime) -> Past:
    """Return the past of a listener who will be told what happens from now on, or since the event `after`.

    After a reconnect some of the last ten seconds' events may come again; their ids are the same.

    Raises
    ------
    Forbidden
        If the key is a robot's.
    MapNotFound
        If there is no such map for the key.
    InvalidRequest
        If `after` is no id of an event.
    """
    actor.require_role(Role.TABLET, Role.ADMIN)
    if map_id is not None:
        covered_map(session, actor, map_id=map_id)
    covered: Collection[str] | None = actor.map_ids if map_id is None else [map_id]
    floor = _first_at(now - _LATE)
    if after is not None:
        return Past(covered, _first_at(min(now, _made_at(after)) - _LATE), floor)
    visible = table.ids_behind(session, f"pub_{floor}", f"rep_{floor}")
    return Past(covered, None, floor, {id_[-_SUFFIX:] for id_ in visible})


def _of_kind(prefix: str, ids: list[str]) -> list[str]:
    return [id_ for id_ in ids if id_.startswith(f"{prefix}_")]


def _published(row: Publication) -> FleetEvent:
    told = {"channel": row.channel, "from_revision": row.from_n, "to_revision": row.to_n}
    return FleetEvent(row.id[-_SUFFIX:], EventKind.PUBLICATION, row.map_id, row.published_at, told)


def _reported(row: RobotReport, map_id: str) -> FleetEvent:
    told = {"robot_id": row.robot_id, "revision": row.revision_n, "state": row.state, "detail": row.detail}
    return FleetEvent(row.id[-_SUFFIX:], EventKind.REPORT, map_id, row.at, told)


def _first_at(moment: datetime) -> str:
    return first_id_at("", max(moment, _EPOCH))[1:]


def _made_at(event_id: str) -> datetime:
    try:
        return made_at(event_id)
    except ValueError:
        detail = (
            "Last-Event-ID is no id that this stream gave; leave it out to hear what happens from now on."
        )
        raise InvalidRequest(detail, errors=[{"header": "Last-Event-ID", "detail": detail}]) from None
