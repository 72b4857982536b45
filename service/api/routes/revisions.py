"""Revisions of a map: made, listed and published."""

from __future__ import annotations

from functools import partial
from typing import Annotated

from fastapi import APIRouter, Header, Query, Response

from service.api.auth import AdminActor, AnyActor, TabletActor
from service.api.conditions import match
from service.api.deps import BaseUrl, KernelDep, MapId, Once, RevisionN, answered, respond
from service.api.paging import PagingDep
from service.api.schemas.base import Page
from service.api.schemas.revisions import (
    ArtifactOut,
    PublishedOut,
    PublishIn,
    RevisionIn,
    RevisionOut,
    RevisionWithJob,
)
from service.db.session import Session
from service.domain.lifecycle import RevisionStatus
from service.usecases import publish, revisions
from service.usecases.answer import Answered, answer_once
from service.usecases.revise import revise

router = APIRouter(prefix="/v1/maps/{map_id}", tags=["revisions"])


@router.post("/revisions", status_code=202, response_model=RevisionWithJob)
def create_revision(
    kernel: KernelDep,
    actor: TabletActor,
    once: Once,
    base_url: BaseUrl,
    map_id: MapId,
    *,
    body: RevisionIn,
) -> Response:
    """Ask for a new revision: a recipe, a read drawing and placed scans become a map.

    With `base`, what the body leaves out is taken over from it, and `operations` change it; without, only
    what the body names goes in. What others did since the base is kept (`rebased` tells what), or the
    request is refused where they changed the same things. The revision is `building` until its job ends.
    Needs a tablet or admin key.
    """

    def act(session: Session) -> Answered:
        made = revise(kernel, session, actor, map_id=map_id, wanted=body.wanted())
        where = f"/v1/maps/{map_id}/revisions/{made.shown.revision.n}"
        return answered(RevisionWithJob.of(made, base_url=base_url), status=202, headers={"Location": where})

    return respond(answer_once(kernel, actor, point="revise", request=once, act=act))


@router.get("/revisions", response_model=Page[RevisionOut])
def list_revisions(
    kernel: KernelDep,
    actor: AnyActor,
    paging: PagingDep,
    map_id: MapId,
    status: Annotated[RevisionStatus | None, Query(description="Only revisions of this status.")] = None,
) -> Page[RevisionOut]:
    """List a map's revisions, newest first."""
    with kernel.db.reading() as session:
        rows = revisions.list_revisions(
            session, actor, map_id=map_id, status=status, below=paging.after_n(), limit=paging.limit + 1
        )
        return Page[RevisionOut](**paging.page(rows, key=lambda shown: shown.revision.n, show=RevisionOut.of))


@router.get("/revisions/{n}", response_model=RevisionOut)
def get_revision(kernel: KernelDep, actor: AnyActor, map_id: MapId, n: RevisionN) -> RevisionOut:
    """Show one revision: what it is made of, and whether it is ready."""
    with kernel.db.reading() as session:
        return RevisionOut.of(revisions.show_revision(session, actor, map_id=map_id, n=n))


@router.get("/revisions/{n}/artifacts", response_model=Page[ArtifactOut])
def list_artifacts(
    kernel: KernelDep, actor: AnyActor, paging: PagingDep, base_url: BaseUrl, map_id: MapId, *, n: RevisionN
) -> Page[ArtifactOut]:
    """List the files of a ready revision, by path."""
    show = partial(ArtifactOut.of, map_id=map_id, n=n, base_url=base_url)
    with kernel.db.reading() as session:
        rows = revisions.list_artifacts(
            session, actor, map_id=map_id, n=n, after=paging.after_id(), limit=paging.limit + 1
        )
        return Page[ArtifactOut](**paging.page(rows, key=lambda row: row.path, show=show))


@router.post("/revisions/{n}/publish", response_model=PublishedOut)
def publish_revision(
    kernel: KernelDep,
    actor: AdminActor,
    once: Once,
    base_url: BaseUrl,
    map_id: MapId,
    n: RevisionN,
    body: PublishIn,
    if_match: Annotated[
        str | None,
        Header(description="ETag of `published` as the caller saw it; if it has moved, nothing changes."),
    ] = None,
) -> Response:
    """Point a channel to a ready revision: robots that ask are told this one. An earlier one rolls back.

    Refused where a gate is closed (`GET .../gates`), unless `override` says why it is done all the same; a
    revision that was on the channel before always passes. Needs an admin key.
    """
    holds = None if if_match is None else partial(match, if_match)

    def act(session: Session) -> Answered:
        done = publish.publish(
            kernel,
            session,
            actor,
            map_id=map_id,
            n=n,
            channel=body.channel,
            holds=holds,
            said=body.said(),
        )
        tag = f'"{publish.pointer_tag(done.pointer)}"'
        return answered(PublishedOut.of(done, base_url=base_url), status=200, headers={"ETag": tag})

    return respond(answer_once(kernel, actor, point="publish", request=once, act=act))
