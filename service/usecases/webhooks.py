"""Make, list, renew and remove webhooks, and tell what was delivered to them."""

from __future__ import annotations

import ipaddress
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import timedelta
from urllib.parse import urlsplit

from service.db import webhooks as table
from service.db.session import Session
from service.db.webhooks import Webhook, WebhookDelivery
from service.domain.access import Actor
from service.domain.errors import InvalidRequest, WebhookNotFound
from service.domain.lifecycle import Role
from service.domain.outbound import Network, may_send_to
from service.domain.webhook import SECRET_BYTES, DeliveryState, EventKind, new_secret
from service.usecases.audit import record
from service.usecases.kernel import Kernel
from service.usecases.maps import covered_map

MOST = 100
_OLD_SECRET_S = 24 * 3600.0


@dataclass(frozen=True)
class Secret:
    """Hold a webhook with its secret, which is shown once."""

    webhook: Webhook
    secret: str


def make_webhook(
    kernel: Kernel,
    session: Session,
    actor: Actor,
    *,
    url: str,
    events: Sequence[EventKind],
    map_ids: Sequence[str] | None,
    allowed: Sequence[Network],
) -> Secret:
    """Return a new webhook with the secret that signs what is sent to it.

    Parameters
    ----------
    map_ids : sequence of str, optional
        Only what happens on these maps; None: on all.
    allowed : sequence of networks
        Where it may be, although these are no public addresses.

    Raises
    ------
    Forbidden
        If the actor is no admin, or wants to hear of maps that the key does not cover.
    MapNotFound
        If one of `map_ids` is no map for the key.
    InvalidRequest
        If the address is none that requests may go to, or there are too many webhooks.
    """
    actor.require_role(Role.ADMIN)
    if map_ids is None:
        actor.require_all_maps()
    for map_id in map_ids or ():
        covered_map(session, actor, map_id=map_id)
    _check_url(url, allowed=allowed)
    if len(table.all_webhooks(session)) >= MOST:
        detail = f"There are {MOST} webhooks, and there can be no more: delete one."
        raise InvalidRequest(detail, errors=[{"pointer": "#", "detail": detail}])
    now = kernel.now()
    webhook = Webhook(
        id=kernel.new_id("whk"),
        url=url,
        events=sorted(events),
        map_ids=None if map_ids is None else sorted(set(map_ids)),
        secret=new_secret(kernel.entropy(SECRET_BYTES)),
        failures=0,
        try_at=now,
        created_at=now,
        created_by=actor.key_id,
    )
    session.add(webhook)
    after = {"url": url, "events": webhook.events, "map_ids": webhook.map_ids}
    record(kernel, session, actor, action="make-webhook", subject_id=webhook.id, after=after)
    session.flush()
    return Secret(webhook, webhook.secret)


def renew_secret(kernel: Kernel, session: Session, actor: Actor, *, webhook_id: str) -> Secret:
    """Return the webhook with a new secret; for a day deliveries are signed with the old one, too.

    Raises
    ------
    Forbidden, WebhookNotFound
        As `show_webhook`.
    """
    webhook = _found(session, actor, webhook_id, lock=True)
    webhook.old_secret = webhook.secret
    webhook.old_secret_until = kernel.now() + timedelta(seconds=_OLD_SECRET_S)
    webhook.secret = new_secret(kernel.entropy(SECRET_BYTES))
    record(kernel, session, actor, action="renew-webhook-secret", subject_id=webhook.id)
    session.flush()
    return Secret(webhook, webhook.secret)


def remove_webhook(kernel: Kernel, session: Session, actor: Actor, *, webhook_id: str) -> None:
    """Remove a webhook with its log; nothing more is sent to it.

    Raises
    ------
    Forbidden, WebhookNotFound
        As `show_webhook`.
    """
    webhook = _found(session, actor, webhook_id, lock=True)
    before = {"url": webhook.url, "events": webhook.events, "map_ids": webhook.map_ids}
    record(kernel, session, actor, action="remove-webhook", subject_id=webhook.id, before=before)
    table.delete_webhook(session, webhook)


def show_webhook(session: Session, actor: Actor, *, webhook_id: str) -> Webhook:
    """Return a webhook.

    Raises
    ------
    Forbidden
        If the actor is no admin.
    WebhookNotFound
        If there is none, or it hears of maps that the key does not cover.
    """
    return _found(session, actor, webhook_id)


def list_webhooks(session: Session, actor: Actor, *, after: str | None, limit: int) -> Sequence[Webhook]:
    """Return up to `limit` webhooks that the key may see, in the order of their making.

    Raises
    ------
    Forbidden
        If the actor is no admin.
    """
    actor.require_role(Role.ADMIN)
    seen = [row for row in table.all_webhooks(session) if _may_see(actor, row) and row.id > (after or "")]
    return seen[:limit]


def list_deliveries(
    session: Session,
    actor: Actor,
    *,
    webhook_id: str,
    state: DeliveryState | None,
    below: str | None,
    limit: int,
) -> Sequence[WebhookDelivery]:
    """Return up to `limit` deliveries to a webhook, newest first.

    Raises
    ------
    Forbidden, WebhookNotFound
        As `show_webhook`.
    """
    webhook = _found(session, actor, webhook_id)
    return table.list_deliveries(session, webhook.id, state=state, below=below, limit=limit)


def _found(session: Session, actor: Actor, webhook_id: str, *, lock: bool = False) -> Webhook:
    actor.require_role(Role.ADMIN)
    webhook = table.find_webhook(session, webhook_id, lock=lock)
    if webhook is None or not _may_see(actor, webhook):
        raise WebhookNotFound(f"There is no webhook {webhook_id}, or this key does not cover its maps.")
    return webhook


def _may_see(actor: Actor, webhook: Webhook) -> bool:
    return actor.map_ids is None or (
        webhook.map_ids is not None and all(actor.covers(map_id) for map_id in webhook.map_ids)
    )


def _check_url(url: str, *, allowed: Sequence[Network]) -> None:
    """Pass when the address is written as one; where its name leads is looked up anew at each delivery."""
    detail = "The address has to be http(s)://host[:port]/path, without a user, a password or a fragment."
    try:
        parts = urlsplit(url)
        is_plain = (
            parts.scheme in {"http", "https"}
            and bool(parts.hostname)
            and parts.username is None
            and not parts.fragment
        )
        is_plain = is_plain and parts.port != 0
    except ValueError:
        is_plain = False
    if is_plain:
        try:
            address = ipaddress.ip_address(parts.hostname or "")
        except ValueError:
            return
        if may_send_to(address, allowed=allowed):
            return
        detail = (
            f"{address} is no public address; an operator can allow its network by"
            " GROUNDPLAN_WEBHOOK_NETWORKS."
        )
    raise InvalidRequest(detail, errors=[{"pointer": "#/url", "detail": detail}])
