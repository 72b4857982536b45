"""Tell what happens in the fleet: pointers that move, and what robots report."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from enum import StrEnum
from typing import Any

from sqlalchemy.orm import Session

from service.db.fleet_events import publications_behind, reports_behind
from service.db.models import Publication
from service.db.robots import RobotReport
from service.domain.access import Actor
from service.domain.errors import InvalidRequest
from service.domain.ids import first_id_at, made_at
from service.domain.lifecycle import Role
from service.usecases.maps import covered_map

_LATE_S = 10.0
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


@dataclass
class Listening:
    """Hold how far a listener has heard.

    A transaction may end after one whose ids are younger, so each look begins ten seconds before the last
    one did, and what was told is not told again.

    Parameters
    ----------
    actor : Actor
        Who listens.
    map_id : str, optional
        The one map that is listened to; None: all that the key covers.
    since : datetime
        What happened up to here is not told.
    """

    actor: Actor
    map_id: str | None
    since: datetime
    told: set[str] = field(default_factory=set)

    def look(self, session: Session, *, now: datetime) -> list[FleetEvent]:
        """Return what has happened since the last look, in the order of its time."""
        covered: Collection[str] | None = self.actor.map_ids if self.map_id is None else [self.map_id]
        found: list[FleetEvent] = []
        rows = _publications(session, first_id_at("pub", self.since), covered)
        found += [event for event in rows if event.id not in self.told]
        rows = _reports(session, first_id_at("rep", self.since), covered)
        found += [event for event in rows if event.id not in self.told]
        found.sort(key=lambda event: event.id)
        self.since = max(self.since, now - timedelta(seconds=_LATE_S))
        first = first_id_at("", self.since)[1:]
        self.told = {event_id for event_id in self.told | {event.id for event in found} if event_id >= first}
        return found


def listen(
    session: Session, actor: Actor, *, map_id: str | None, after: str | None, now: datetime
) -> Listening:
    """Return a listener that will be told what happens from now on, or since the event `after`.

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
    since = now if after is None else min(now, _made_at(after) - timedelta(seconds=_LATE_S))
    return Listening(actor, map_id, since)


def _publications(session: Session, after: str, covered: Collection[str] | None) -> list[FleetEvent]:
    events: list[FleetEvent] = []
    while rows := publications_behind(session, after, covered=covered, limit=_MOST):
        events += [_published(row) for row in rows]
        after = rows[-1].id
    return events


def _reports(session: Session, after: str, covered: Collection[str] | None) -> list[FleetEvent]:
    events: list[FleetEvent] = []
    while rows := reports_behind(session, after, covered=covered, limit=_MOST):
        events += [_reported(report, map_id) for report, map_id in rows]
        after = rows[-1][0].id
    return events


def _published(row: Publication) -> FleetEvent:
    told = {"channel": row.channel, "from_revision": row.from_n, "to_revision": row.to_n}
    return FleetEvent(row.id[-_SUFFIX:], EventKind.PUBLICATION, row.map_id, row.published_at, told)


def _reported(row: RobotReport, map_id: str) -> FleetEvent:
    told = {"robot_id": row.robot_id, "revision": row.revision_n, "state": row.state, "detail": row.detail}
    return FleetEvent(row.id[-_SUFFIX:], EventKind.REPORT, map_id, row.at, told)


def _made_at(event_id: str) -> datetime:
    try:
        return made_at(event_id)
    except ValueError:
        detail = (
            "Last-Event-ID is no id that this stream gave; leave it out to hear what happens from now on."
        )
        raise InvalidRequest(detail, errors=[{"header": "Last-Event-ID", "detail": detail}]) from None
