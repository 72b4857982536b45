"""Deliver what is due to a webhook, signed as Standard Webhooks has it."""

from __future__ import annotations

import time
from dataclasses import dataclass
from importlib.metadata import version

from service.db.webhooks import due_deliveries, find_webhook
from service.domain.webhook import signature
from service.usecases.record_deliveries import GONE, Tried, record_deliveries
from worker.context import JobContext
from worker.outbound import NotSent, post

_MOST = 50
_LONGEST_S = 8.0


@dataclass(frozen=True)
class _Letter:
    delivery_id: str
    body: bytes


def deliver_webhooks(context: JobContext) -> None:
    """Send the deliveries that are due, the oldest first, and record how each went.

    Killed in between, they are sent again under the same ids: a receiver drops ids that it knows. After a few
    seconds, or where nobody answers, the rest is left to the next job: others wait for this worker.
    """
    url, secrets, letters = _due(context)
    tried: list[Tried] = []
    begun = time.monotonic()
    for letter in letters:
        tried.append(_send(context, url, secrets, letter))
        if tried[-1].status in {None, GONE} or time.monotonic() - begun > _LONGEST_S:
            break
    with context.kernel.db.writing("record-deliveries") as session:
        record_deliveries(context.kernel, session, context.attempt, tried=tried)


def _due(context: JobContext) -> tuple[str, list[str], list[_Letter]]:
    now = context.kernel.now()
    with context.kernel.db.reading() as session:
        webhook = find_webhook(session, context.attempt.subject_id)
        if webhook is None or webhook.disabled_at is not None:
            return "", [], []
        rows = due_deliveries(session, webhook.id, now=now, limit=_MOST)
        secrets = [webhook.secret]
        if webhook.old_secret is not None and webhook.old_secret_until is not None:
            secrets += [webhook.old_secret] if webhook.old_secret_until > now else []
        return webhook.url, secrets, [_Letter(row.id, row.body.encode()) for row in rows]


def _send(context: JobContext, url: str, secrets: list[str], letter: _Letter) -> Tried:
    at, begun = context.kernel.now(), time.monotonic()
    timestamp = int(at.timestamp())
    headers = {
        "Content-Type": "application/json",
        "User-Agent": f"groundplan/{version('groundplan')}",
        "webhook-id": letter.delivery_id,
        "webhook-timestamp": str(timestamp),
        "webhook-signature": signature(
            secrets, message_id=letter.delivery_id, timestamp=timestamp, body=letter.body
        ),
    }
    status, error = None, None
    try:
        status = post(url, body=letter.body, headers=headers, allowed=context.networks)
    except NotSent as why:
        error = str(why)[:500]
    if status is not None and not 200 <= status < 300:
        error = f"answered {status}"
    return Tried(letter.delivery_id, at, status, error, time.monotonic() - begun)
