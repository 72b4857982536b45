"""Webhooks: addresses that are told of events."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Path, Query, Response

from service.api.auth import AdminActor
from service.api.deps import KernelDep, LimitsDep, Once, answered, respond
from service.api.paging import PagingDep
from service.api.schemas.base import Page
from service.api.schemas.webhooks import DeliveryOut, WebhookIn, WebhookOut, WebhookSecretOut
from service.db.session import Session
from service.domain.webhook import DeliveryState
from service.usecases import webhooks
from service.usecases.answer import Answered, answer_once

router = APIRouter(prefix="/v1/webhooks", tags=["webhooks"])

_NO_STORE = {"Cache-Control": "no-store"}

WebhookId = Annotated[str, Path(description="Id of the webhook.")]


@router.post("", status_code=201, response_model=WebhookSecretOut)
def make_webhook(
    kernel: KernelDep, limits: LimitsDep, actor: AdminActor, once: Once, body: WebhookIn
) -> Response:
    """Tell an address of events, by signed POST requests (Standard Webhooks).

    The answer alone has the secret. Private addresses are refused unless the operator has allowed their
    network. Needs an admin key.
    """

    def act(session: Session) -> Answered:
        made = webhooks.make_webhook(
            kernel,
            session,
            actor,
            url=body.url,
            events=body.events,
            map_ids=body.map_ids,
            allowed=limits.webhook_networks,
        )
        told = WebhookSecretOut.with_secret(made)
        return answered(told, status=201, headers={"Location": f"/v1/webhooks/{told.id}", **_NO_STORE})

    return respond(answer_once(kernel, actor, point="make-webhook", request=once, act=act))


@router.get("", response_model=Page[WebhookOut])
def list_webhooks(kernel: KernelDep, actor: AdminActor, paging: PagingDep) -> Page[WebhookOut]:
    """List the webhooks, without their secrets. Needs an admin key."""
    with kernel.db.reading() as session:
        rows = webhooks.list_webhooks(session, actor, after=paging.after_id(), limit=paging.limit + 1)
        return Page[WebhookOut](**paging.page(rows, key=lambda row: row.id, show=WebhookOut.model_validate))


@router.get("/{webhook_id}", response_model=WebhookOut)
def get_webhook(kernel: KernelDep, actor: AdminActor, webhook_id: WebhookId) -> WebhookOut:
    """Show a webhook, without its secret. Needs an admin key."""
    with kernel.db.reading() as session:
        return WebhookOut.model_validate(webhooks.show_webhook(session, actor, webhook_id=webhook_id))


@router.delete("/{webhook_id}", status_code=204)
def remove_webhook(kernel: KernelDep, actor: AdminActor, webhook_id: WebhookId) -> Response:
    """Remove a webhook with its log; nothing more is sent to it. Needs an admin key."""
    with kernel.db.writing("remove-webhook") as session:
        webhooks.remove_webhook(kernel, session, actor, webhook_id=webhook_id)
    return Response(status_code=204)


@router.post("/{webhook_id}/secret", response_model=WebhookSecretOut)
def renew_secret(kernel: KernelDep, actor: AdminActor, once: Once, webhook_id: WebhookId) -> Response:
    """Replace the secret: for a day deliveries carry a signature with either. Needs an admin key."""

    def act(session: Session) -> Answered:
        made = webhooks.renew_secret(kernel, session, actor, webhook_id=webhook_id)
        return answered(WebhookSecretOut.with_secret(made), status=200, headers=_NO_STORE)

    return respond(answer_once(kernel, actor, point="renew-webhook-secret", request=once, act=act))


@router.get("/{webhook_id}/deliveries", response_model=Page[DeliveryOut])
def list_deliveries(
    kernel: KernelDep,
    actor: AdminActor,
    paging: PagingDep,
    webhook_id: WebhookId,
    *,
    state: Annotated[DeliveryState | None, Query(description="Only deliveries in this state.")] = None,
) -> Page[DeliveryOut]:
    """List what was, is to be, or could not be delivered, newest first, with each try. Needs an admin key."""
    with kernel.db.reading() as session:
        rows = webhooks.list_deliveries(
            session,
            actor,
            webhook_id=webhook_id,
            state=state,
            below=paging.after_id(),
            limit=paging.limit + 1,
        )
        return Page[DeliveryOut](**paging.page(rows, key=lambda row: row.id, show=DeliveryOut.of))
