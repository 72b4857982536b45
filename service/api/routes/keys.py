"""API keys: who may do what on which maps."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Path, Response

from service.api.auth import AdminActor, Presented
from service.api.deps import KernelDep, Once, answered, respond
from service.api.paging import PagingDep
from service.api.schemas.base import Page
from service.api.schemas.keys import KeyIn, KeyOut, NewKeyOut
from service.db.session import Session
from service.usecases import keys
from service.usecases.answer import Answered, answer_once

router = APIRouter(prefix="/v1/keys", tags=["keys"])

_HIDDEN = "gp_(shown-once)"
"""Stands in for the secret in the remembered answer: what is kept cannot be used."""


@router.post("", status_code=201, response_model=NewKeyOut)
def create_key(
    kernel: KernelDep, actor: AdminActor, once: Once, presented: Presented, body: KeyIn
) -> Response:
    """Make an API key. Its secret is in this answer and nowhere else.

    A tablet uploads, places and confirms; a robot reads revisions and downloads; an admin does
    everything. Needs an admin key that covers all maps.
    """
    assert presented is not None
    root = presented.credentials if once is not None else None

    def act(session: Session) -> Answered:
        made = keys.make_key(
            kernel,
            session,
            actor,
            name=body.name,
            role=body.role,
            map_ids=body.map_ids,
            expires_at=body.expires_at,
            root=root,
        )
        shown = KeyOut.model_validate(made.key)
        told = NewKeyOut(**shown.model_dump(), key=made.secret if root is None else _HIDDEN)
        return answered(told, status=201, headers={"Location": f"/v1/keys/{made.key.id}"})

    done = answer_once(kernel, actor, point="create-key", request=once, act=act)
    if root is not None:
        told = NewKeyOut.model_validate_json(done.body)
        told.key = keys.derived_secret(root, key_id=told.id)
        done = Answered(done.status, done.headers, told.model_dump_json())
    return respond(Answered(done.status, {**done.headers, "Cache-Control": "no-store"}, done.body))


@router.get("", response_model=Page[KeyOut])
def list_keys(kernel: KernelDep, actor: AdminActor, paging: PagingDep) -> Page[KeyOut]:
    """List all keys, oldest first, without their secrets. Needs an admin key that covers all maps."""
    with kernel.db.reading() as session:
        rows = keys.list_keys(session, actor, after=paging.after_id(), limit=paging.limit + 1)
        return Page[KeyOut](**paging.page(rows, key=lambda row: row.id, show=KeyOut.model_validate))


@router.delete("/{key_id}", status_code=204)
def revoke_key(
    kernel: KernelDep, actor: AdminActor, key_id: Annotated[str, Path(description="Id of the key.")]
) -> None:
    """Make a key invalid at once; revoking it again changes nothing. Needs an admin key of all maps."""
    with kernel.db.writing("revoke-key") as session:
        keys.revoke_key(kernel, session, actor, key_id=key_id)
