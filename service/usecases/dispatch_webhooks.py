"""Hand events to the webhooks that want them, and give each webhook a job that delivers."""

from __future__ import annotations

import json
from datetime import timedelta

from service.db import webhooks as table
from service.db.jobs import enqueue
from service.db.session import Session
from service.db.webhooks import Webhook, WebhookDelivery, WebhookEvent
from service.domain.lifecycle import JobKind
from service.domain.webhook import DeliveryState
from service.usecases.kernel import Kernel

_MOST = 500
_AFTER_A_CRASH_S = 60.0


def dispatch_webhooks(kernel: Kernel) -> None:
    """Hand out the events that wait, and let a job deliver what is due.

    Called again and again by every service process; each event and each webhook is taken by one.
    """
    with kernel.db.reading() as session:
        has_events = table.has_events(session)
        is_due = bool(table.due_webhooks(session, now=kernel.now()))
    if has_events or is_due:
        with kernel.db.writing("dispatch-webhooks") as session:
            _hand_out(kernel, session)
            _enqueue(kernel, session)


def _hand_out(kernel: Kernel, session: Session) -> None:
    webhooks = [row for row in table.all_webhooks(session) if row.disabled_at is None]
    for event in table.take_events(session, limit=_MOST):
        for webhook in webhooks:
            if _wants(webhook, event):
                session.add(_delivery(kernel, webhook, event))
    session.flush()


def _enqueue(kernel: Kernel, session: Session) -> None:
    now = kernel.now()
    for webhook in table.due_webhooks(session, now=now, lock=True):
        first = table.due_deliveries(session, webhook.id, now=now, limit=1)[0]
        job = enqueue(
            session,
            JobKind.DELIVER_WEBHOOKS,
            job_id=kernel.new_id("job"),
            map_id=first.map_id,
            subject_id=webhook.id,
            key_id=None,
            now=now,
        )
        webhook.job_id = job.id
        webhook.try_at = now + timedelta(seconds=_AFTER_A_CRASH_S)  # the job itself says when, if it ends


def _wants(webhook: Webhook, event: WebhookEvent) -> bool:
    covered = webhook.map_ids is None or event.map_id in webhook.map_ids
    return covered and event.kind in webhook.events and event.at >= webhook.created_at


def _delivery(kernel: Kernel, webhook: Webhook, event: WebhookEvent) -> WebhookDelivery:
    now = kernel.now()
    told = {"map_id": event.map_id, **event.told}
    body = {"type": event.kind, "timestamp": event.at.isoformat(), "data": told}
    return WebhookDelivery(
        id=kernel.new_id("msg"),
        webhook_id=webhook.id,
        map_id=event.map_id,
        event=event.kind,
        body=json.dumps(body, ensure_ascii=False, separators=(",", ":")),
        state=DeliveryState.PENDING.value,
        tries=[],
        try_at=now,
        created_at=now,
    )
