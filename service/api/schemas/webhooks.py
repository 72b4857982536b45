"""Webhooks and their deliveries as JSON."""

from __future__ import annotations

import json
from datetime import datetime
from typing import Annotated, Self

from pydantic import Field

from service.api.schemas.base import Identifier, Input, JsonObject, Output
from service.db.webhooks import WebhookDelivery
from service.domain.webhook import DeliveryState, EventKind
from service.usecases.webhooks import Secret


class WebhookIn(Input):
    """A webhook to be made."""

    url: str = Field(
        min_length=8,
        max_length=2000,
        pattern=r"^https?://[\x21-\x7e]+$",
        description="Where events are sent.",
    )
    events: Annotated[list[EventKind], Field(min_length=1, max_length=20)]
    map_ids: Annotated[list[Identifier], Field(min_length=1, max_length=200)] | None = Field(
        None, description="Only what happens on these maps; by default on all."
    )


class WebhookOut(Output):
    """A webhook."""

    id: str
    url: str
    events: list[EventKind]
    map_ids: list[str] | None
    created_at: datetime
    created_by: str
    failures: int = Field(description="How often in a row it could not be reached.")
    disabled_at: datetime | None = Field(description="When it answered 410: nothing is sent since.")
    old_secret_until: datetime | None = Field(
        description="Until then deliveries are also signed with the secret before."
    )


class WebhookSecretOut(WebhookOut):
    """A webhook with its secret."""

    secret: str = Field(description="Signs deliveries (`whsec_...`); in this answer only.")

    @classmethod
    def with_secret(cls, made: Secret) -> Self:
        """Return a webhook as JSON, with its secret."""
        shown = WebhookOut.model_validate(made.webhook).model_dump()
        return cls(**shown, secret=made.secret)


class TryOut(Output):
    """One try of a delivery."""

    at: datetime
    status: int | None = Field(description="Status of the answer; null where there was none.")
    error: str | None
    seconds: float


class DeliveryOut(Output):
    """One event for one webhook."""

    id: str = Field(description="Sent as `webhook-id`, the same at each try.")
    map_id: str
    event: EventKind
    state: DeliveryState
    body: JsonObject = Field(description="What is sent.")
    tries: list[TryOut]
    next_try_at: datetime | None
    created_at: datetime
    ended_at: datetime | None

    @classmethod
    def of(cls, row: WebhookDelivery) -> Self:
        """Return a delivery as JSON."""
        state = DeliveryState(row.state)
        return cls(
            id=row.id,
            map_id=row.map_id,
            event=EventKind(row.event),
            state=state,
            body=json.loads(row.body),
            tries=[TryOut(**kept) for kept in row.tries],
            next_try_at=row.try_at if state is DeliveryState.PENDING else None,
            created_at=row.created_at,
            ended_at=row.ended_at,
        )
