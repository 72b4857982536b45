"""Write down what happens, for the webhooks that want to hear of it."""

from __future__ import annotations

from typing import Any

from service.db.models import Publication
from service.db.session import Session
from service.db.webhooks import add_event
from service.domain.webhook import EventKind
from service.usecases.kernel import Kernel


def emit(kernel: Kernel, session: Session, kind: EventKind, *, map_id: str, told: dict[str, Any]) -> None:
    """Write down what happened, in its own transaction: either both are there or neither."""
    add_event(session, kind, event_id=kernel.new_id("evt"), map_id=map_id, told=told, at=kernel.now())


def tell_published(kernel: Kernel, session: Session, publication: Publication) -> None:
    """Write down that a channel's pointer was moved."""
    told = {
        "channel": publication.channel,
        "from_revision": publication.from_n,
        "to_revision": publication.to_n,
    }
    emit(kernel, session, EventKind.REVISION_PUBLISHED, map_id=publication.map_id, told=told)
