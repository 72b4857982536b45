"""What became of revisions: compared, checked against their inputs, published and rolled back."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query, Request, Response

from service.api.auth import AdminActor, AnyActor, TabletActor
from service.api.deps import BaseUrl, KernelDep, MapId, Once, RevisionN, answered, respond
from service.api.downloads import DOCUMENTED, IMMUTABLE, send_file
from service.api.paging import PagingDep
from service.api.schemas.base import Page
from service.api.schemas.history import (
    ChannelOut,
    ChannelsOut,
    ComparedOut,
    GateOut,
    GatesOut,
    PublicationOut,
)
from service.api.schemas.jobs import JobOut
from service.api.schemas.revisions import Channel
from service.db.session import Session
from service.usecases import compare, publish, rebuild
from service.usecases.answer import Answered, answer_once

router = APIRouter(prefix="/v1/maps/{map_id}", tags=["revisions"])

With = Annotated[int, Query(alias="with", ge=1, le=2**31 - 1, description="The revision to compare with.")]


@router.get("/revisions/{n}/gates", response_model=GatesOut)
def get_gates(
    kernel: KernelDep, actor: TabletActor, map_id: MapId, n: RevisionN, channel: Channel = "stable"
) -> GatesOut:
    """Tell what stands against publishing a ready revision on a channel. Needs a tablet or admin key."""
    with kernel.db.reading() as session:
        gates = publish.show_gates(session, actor, map_id=map_id, n=n, channel=channel)
        return GatesOut(revision=n, channel=channel, gates=[GateOut.model_validate(gate) for gate in gates])


@router.get("/channels", response_model=ChannelsOut)
def list_channels(kernel: KernelDep, actor: AnyActor, map_id: MapId) -> ChannelsOut:
    """Tell where each channel of a map points."""
    with kernel.db.reading() as session:
        rows = publish.list_channels(session, actor, map_id=map_id)
        return ChannelsOut(channels=[ChannelOut.model_validate(row) for row in rows])


@router.get("/publications", response_model=Page[PublicationOut])
def list_publications(
    kernel: KernelDep, actor: TabletActor, paging: PagingDep, map_id: MapId, channel: Channel | None = None
) -> Page[PublicationOut]:
    """List who moved which channel's pointer, when, from where to where and why, newest first.

    Needs a tablet or admin key.
    """
    with kernel.db.reading() as session:
        rows = publish.list_publications(
            session,
            actor,
            map_id=map_id,
            channel=channel,
            before=paging.after_id(),
            limit=paging.limit + 1,
        )
        return Page[PublicationOut](**paging.page(rows, key=lambda row: row.id, show=PublicationOut.of))


@router.get("/revisions/{n}/compare", response_model=ComparedOut)
def compare_revisions(
    kernel: KernelDep,
    actor: TabletActor,
    base_url: BaseUrl,
    response: Response,
    map_id: MapId,
    *,
    n: RevisionN,
    with_n: With,
) -> ComparedOut:
    """Tell what changed from revision `with` to revision `n`: drawing, recipe, layers, regions, and points.

    The points are compared by a job that the first who asks begins: until it has ended well the answer is
    `202` with `geometry` null. For tablets and admins: a robot's key begins no such work.
    """
    found = compare.compare(kernel, actor, map_id=map_id, n=n, with_n=with_n)
    response.status_code = 202 if found.geometry is None else 200
    return ComparedOut.of(found, map_id=map_id, base_url=base_url)


@router.head("/revisions/{n}/compare.png", include_in_schema=False)
@router.get("/revisions/{n}/compare.png", response_class=Response, responses=DOCUMENTED)
def get_picture(
    request: Request, kernel: KernelDep, actor: TabletActor, map_id: MapId, *, n: RevisionN, with_n: With
) -> Response:
    """Show what went (red) and what came (green) from revision `with` to revision `n`, from above."""
    file = compare.comparison_picture(kernel, actor, map_id=map_id, n=n, with_n=with_n)
    return send_file(request, file, caching=IMMUTABLE)


@router.post("/revisions/{n}/rebuild", status_code=202, response_model=JobOut)
def rebuild_revision(
    kernel: KernelDep, actor: AdminActor, once: Once, base_url: BaseUrl, map_id: MapId, *, n: RevisionN
) -> Response:
    """Build a ready revision again from its inputs and compare every file with the recorded one.

    The job succeeds when every byte is the same, and fails with `rebuilt-differently` when one is not.
    Files that were let go come back by it. Needs an admin key.
    """

    def act(session: Session) -> Answered:
        job = rebuild.rebuild(kernel, session, actor, map_id=map_id, n=n)
        where = {"Location": f"/v1/jobs/{job.id}"}
        return answered(JobOut.of(job, base_url=base_url), status=202, headers=where)

    return respond(answer_once(kernel, actor, point="rebuild-revision", request=once, act=act))
