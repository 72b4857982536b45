"""Proposals to take off what a later scan looked through."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Path, Query, Response

from service.api.auth import TabletActor
from service.api.deps import BaseUrl, KernelDep, MapId, Once, answered, respond
from service.api.paging import Paging, PagingDep
from service.api.schemas.base import Page
from service.api.schemas.proposals import ProposalOut
from service.api.schemas.revisions import RevisionWithJob
from service.db.session import Session
from service.domain.access import Actor
from service.domain.lifecycle import ProposalState
from service.usecases import proposals
from service.usecases.answer import Answered, answer_once
from service.usecases.kernel import Kernel

router = APIRouter(prefix="/v1", tags=["proposals"])

ProposalId = Annotated[str, Path(description="Id of the proposal.")]


State = Annotated[ProposalState | None, Query(description="Only proposals of this state.")]


@router.get("/maps/{map_id}/proposals", response_model=Page[ProposalOut])
def list_proposals(
    kernel: KernelDep, actor: TabletActor, paging: PagingDep, map_id: MapId, state: State = None
) -> Page[ProposalOut]:
    """List what later scans looked through, newest first. Needs a tablet or admin key."""
    return _listed(kernel, actor, paging, map_id=map_id, state=state)


@router.get("/proposals", response_model=Page[ProposalOut])
def find_proposals(
    kernel: KernelDep, actor: TabletActor, paging: PagingDep, state: State = None
) -> Page[ProposalOut]:
    """List proposals on all maps that the key covers, newest first. Needs a tablet or admin key."""
    return _listed(kernel, actor, paging, map_id=None, state=state)


@router.post("/proposals/{proposal_id}/accept", status_code=202, response_model=RevisionWithJob)
def accept_proposal(
    kernel: KernelDep, actor: TabletActor, once: Once, base_url: BaseUrl, proposal_id: ProposalId
) -> Response:
    """Take off what has gone: a new revision without it. Needs a tablet or admin key."""

    def act(session: Session) -> Answered:
        made = proposals.accept_proposal(kernel, session, actor, proposal_id=proposal_id)
        revision = made.shown.revision
        where = f"/v1/maps/{revision.map_id}/revisions/{revision.n}"
        return answered(RevisionWithJob.of(made, base_url=base_url), status=202, headers={"Location": where})

    return respond(answer_once(kernel, actor, point="decide-proposal", request=once, act=act))


@router.post("/proposals/{proposal_id}/dismiss", response_model=ProposalOut)
def dismiss_proposal(kernel: KernelDep, actor: TabletActor, once: Once, proposal_id: ProposalId) -> Response:
    """Let the layer stay: the proposal is closed. Needs a tablet or admin key."""

    def act(session: Session) -> Answered:
        row = proposals.dismiss_proposal(kernel, session, actor, proposal_id=proposal_id)
        return answered(ProposalOut.model_validate(row), status=200)

    return respond(answer_once(kernel, actor, point="decide-proposal", request=once, act=act))


def _listed(
    kernel: Kernel, actor: Actor, paging: Paging, *, map_id: str | None, state: ProposalState | None
) -> Page[ProposalOut]:
    with kernel.db.reading() as session:
        rows = proposals.list_proposals(
            session, actor, map_id=map_id, state=state, before=paging.after_id(), limit=paging.limit + 1
        )
        return Page[ProposalOut](**paging.page(rows, key=lambda row: row.id, show=ProposalOut.model_validate))
