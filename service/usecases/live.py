"""One look at the database for all who listen: whose key still holds, which jobs moved on, what happened."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

from service.db.job_lists import find_changed
from service.db.keys import valid_keys
from service.db.models import Job
from service.usecases.fleet_events import FleetEvent, News
from service.usecases.kernel import Kernel


@dataclass(frozen=True)
class Seen:
    """Hold what one look found: of the keys those that are valid, jobs that changed, events not yet told."""

    valid_keys: Collection[str]
    jobs: Sequence[Job]
    events: Sequence[FleetEvent]


def look(kernel: Kernel, news: News, *, key_ids: Collection[str], jobs: Mapping[str, int]) -> Seen:
    """Return what has changed for the listeners, in one transaction.

    Parameters
    ----------
    kernel : Kernel
        Where rows are read.
    news : News
        How far the fleet's events were told.
    key_ids : collection of str
        The keys of all who listen.
    jobs : mapping of str to int
        The jobs that are listened to, each with its counter `changed` as it was told last.
    """
    now = kernel.now()
    with kernel.db.reading() as session:
        return Seen(
            valid_keys(session, key_ids, now=now), find_changed(session, jobs), news.look(session, now=now)
        )
