"""Webhooks, events on their way to them, and what is to be, was or could not be delivered."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from typing import Any

from sqlalchemy import CheckConstraint, ForeignKey, Index, String, Text, and_, delete, exists, or_, select
from sqlalchemy.orm import Mapped, Session, mapped_column

from service.db.models import Base, Id, Job, Json
from service.domain.lifecycle import JobState
from service.domain.webhook import DeliveryState, EventKind

_STATES = f"state IN ({', '.join(repr(str(state)) for state in DeliveryState)})"
_ENDED = tuple(state.value for state in JobState if state.is_final)


class WebhookEvent(Base):
    """Something that happened, written with it, until it is handed to the webhooks that want it."""

    __tablename__ = "webhook_events"

    id: Mapped[str] = mapped_column(Id, primary_key=True)
    kind: Mapped[str] = mapped_column(String(40))
    map_id: Mapped[str] = mapped_column(ForeignKey("maps.id"))
    told: Mapped[dict[str, Any]]
    at: Mapped[datetime]


class Webhook(Base):
    """An address that is told of events; `map_ids` null: of all maps. The secret signs, so it is kept.

    `failures` counts in a row how often it could not be reached, before `try_at` nothing is tried, `job_id`
    is the job that tries or tried last.
    """

    __tablename__ = "webhooks"

    id: Mapped[str] = mapped_column(Id, primary_key=True)
    url: Mapped[str] = mapped_column(Text)
    events: Mapped[list[Any]] = mapped_column(Json)
    map_ids: Mapped[list[Any] | None] = mapped_column(Json)
    secret: Mapped[str] = mapped_column(String(100))
    old_secret: Mapped[str | None] = mapped_column(String(100))
    old_secret_until: Mapped[datetime | None]
    failures: Mapped[int] = mapped_column(default=0)
    try_at: Mapped[datetime]
    job_id: Mapped[str | None] = mapped_column(ForeignKey("jobs.id"))
    disabled_at: Mapped[datetime | None]
    created_at: Mapped[datetime]
    created_by: Mapped[str] = mapped_column(ForeignKey("keys.id"))


class WebhookDelivery(Base):
    """One event for one webhook: the very body that is sent, and each try."""

    __tablename__ = "webhook_deliveries"
    __table_args__ = (
        CheckConstraint(_STATES, name="state"),
        Index(None, "webhook_id", "id"),
        Index(None, "state", "webhook_id", "try_at"),
    )

    id: Mapped[str] = mapped_column(Id, primary_key=True)
    webhook_id: Mapped[str] = mapped_column(ForeignKey("webhooks.id", ondelete="CASCADE"))
    map_id: Mapped[str] = mapped_column(ForeignKey("maps.id"))
    event: Mapped[str] = mapped_column(String(40))
    body: Mapped[str] = mapped_column(Text)
    state: Mapped[str] = mapped_column(String(16))
    tries: Mapped[list[Any]] = mapped_column(Json)
    try_at: Mapped[datetime]
    created_at: Mapped[datetime]
    ended_at: Mapped[datetime | None]


def add_event(
    session: Session, kind: EventKind, *, event_id: str, map_id: str, told: dict[str, Any], at: datetime
) -> None:
    """Write down what happened, in its own transaction, for the webhooks.

    Parameters
    ----------
    event_id : str
        Never used before; events sort by it.
    told : dict
        What there is to say of it, as JSON values.
    """
    session.add(WebhookEvent(id=event_id, kind=kind.value, map_id=map_id, told=told, at=at))


def has_events(session: Session) -> bool:
    """Return whether an event waits to be handed out."""
    return session.scalar(select(WebhookEvent.id).limit(1)) is not None


def take_events(session: Session, *, limit: int) -> Sequence[WebhookEvent]:
    """Return up to `limit` events, which are gone with this transaction; another one gets others."""
    query = select(WebhookEvent).order_by(WebhookEvent.id).limit(limit).with_for_update(skip_locked=True)
    events = session.scalars(query).all()
    session.execute(
        delete(WebhookEvent)
        .where(WebhookEvent.id.in_([event.id for event in events]))
        .execution_options(synchronize_session=False)
    )
    return events


def all_webhooks(session: Session) -> Sequence[Webhook]:
    """Return every webhook, in the order of their making."""
    return session.scalars(select(Webhook).order_by(Webhook.id)).all()


def find_webhook(session: Session, webhook_id: str, *, lock: bool = False) -> Webhook | None:
    """Return the webhook with this id, or None; with `lock` no other transaction changes it meanwhile."""
    return session.get(Webhook, webhook_id, with_for_update=True if lock else None)


def delete_webhook(session: Session, webhook: Webhook) -> None:
    """Remove a webhook with its deliveries."""
    session.execute(delete(WebhookDelivery).where(WebhookDelivery.webhook_id == webhook.id))
    session.execute(delete(Webhook).where(Webhook.id == webhook.id))


def due_webhooks(session: Session, *, now: datetime, lock: bool = False) -> Sequence[Webhook]:
    """Return the webhooks with something to deliver now that no job works on."""
    waits = exists().where(_is_due(now), WebhookDelivery.webhook_id == Webhook.id)
    query = (
        select(Webhook)
        .outerjoin(Job, Job.id == Webhook.job_id)
        .where(Webhook.disabled_at.is_(None), Webhook.try_at <= now, waits)
        .where(or_(Job.id.is_(None), Job.state.in_(_ENDED)))
        .order_by(Webhook.id)
    )
    return session.scalars(query.with_for_update(of=Webhook, skip_locked=True) if lock else query).all()


def due_deliveries(
    session: Session, webhook_id: str, *, now: datetime, limit: int
) -> Sequence[WebhookDelivery]:
    """Return up to `limit` deliveries that may be tried now, oldest first."""
    due = and_(_is_due(now), WebhookDelivery.webhook_id == webhook_id)
    query = select(WebhookDelivery).where(due).order_by(WebhookDelivery.id).limit(limit)
    return session.scalars(query).all()


def list_deliveries(
    session: Session, webhook_id: str, *, state: DeliveryState | None, below: str | None, limit: int
) -> Sequence[WebhookDelivery]:
    """Return up to `limit` deliveries of a webhook, newest first, with ids below `below`."""
    query = select(WebhookDelivery).where(WebhookDelivery.webhook_id == webhook_id)
    if state is not None:
        query = query.where(WebhookDelivery.state == state.value)
    if below is not None:
        query = query.where(WebhookDelivery.id < below)
    return session.scalars(query.order_by(WebhookDelivery.id.desc()).limit(limit)).all()


def _is_due(now: datetime) -> Any:
    return and_(WebhookDelivery.state == DeliveryState.PENDING.value, WebhookDelivery.try_at <= now)
