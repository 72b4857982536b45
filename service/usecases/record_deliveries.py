"""Record how deliveries to a webhook went, and when what failed is tried again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Any

from service.db import webhooks as table
from service.db.jobs import Attempt, finish_succeeded
from service.db.session import Session
from service.db.webhooks import Webhook, WebhookDelivery
from service.domain.webhook import MAX_TRIES, DeliveryState, back_off_s
from service.usecases.kernel import Kernel

GONE = 410
"""Status by which a receiver says that it wants nothing more."""


@dataclass(frozen=True)
class Tried:
    """Hold one try: when, the status of the answer (None: none came), why it failed, how long it took."""

    delivery_id: str
    at: datetime
    status: int | None
    error: str | None
    seconds: float

    def to_json(self) -> dict[str, Any]:
        """Return the try as a JSON object, for the log."""
        return {
            "at": self.at.isoformat(),
            "status": self.status,
            "error": self.error,
            "seconds": round(self.seconds, 3),
        }


def record_deliveries(kernel: Kernel, session: Session, attempt: Attempt, *, tried: Sequence[Tried]) -> None:
    """Keep every try, in one transaction with the end of the job.

    What got no 2xx waits longer from try to try and fails in the end; a webhook that cannot be reached
    waits as a whole, and one that answers 410 is disabled.

    Raises
    ------
    LeaseLost
        If the job is no longer this attempt's: nothing is recorded.
    """
    finish_succeeded(session, attempt, now=kernel.now())
    webhook = table.find_webhook(session, attempt.subject_id, lock=True)
    if webhook is None:
        return
    webhook.try_at = kernel.now()
    for one in tried:
        delivery = session.get(WebhookDelivery, one.delivery_id)
        if delivery is not None:
            _note(delivery, one, now=kernel.now())
            _judge(webhook, one, now=kernel.now())


def _note(delivery: WebhookDelivery, one: Tried, *, now: datetime) -> None:
    delivery.tries = [*delivery.tries, one.to_json()]
    if one.error is None:
        delivery.state, delivery.ended_at = DeliveryState.DELIVERED.value, now
    elif len(delivery.tries) >= MAX_TRIES:
        delivery.state, delivery.ended_at = DeliveryState.FAILED.value, now
    else:
        delivery.try_at = now + timedelta(seconds=back_off_s(len(delivery.tries)))


def _judge(webhook: Webhook, one: Tried, *, now: datetime) -> None:
    if one.status is not None:
        webhook.failures = 0
    else:
        webhook.failures += 1
        webhook.try_at = now + timedelta(seconds=back_off_s(webhook.failures))
    if one.status == GONE:
        webhook.disabled_at = now
