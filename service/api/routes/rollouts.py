"""Roll-outs: begun, watched, held and ended."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated

from fastapi import APIRouter, Path, Query, Response

from service.api.auth import AdminActor, TabletActor
from service.api.deps import KernelDep, MapId, Once, answered, respond
from service.api.paging import PagingDep
from service.api.schemas.base import Page
from service.api.schemas.revisions import Channel
from service.api.schemas.robots import RobotOut
from service.api.schemas.rollouts import RolloutIn, RolloutOut
from service.db.session import Session
from service.domain.access import Actor
from service.domain.rollout import RolloutState
from service.usecases import rollouts
from service.usecases.answer import Answered, IdempotentRequest, answer_once
from service.usecases.kernel import Kernel

router = APIRouter(prefix="/v1", tags=["roll-outs"])

RolloutId = Annotated[str, Path(description="Id of the roll-out.")]


@router.post("/maps/{map_id}/rollouts", status_code=201, response_model=RolloutOut)
def begin_rollout(
    kernel: KernelDep, actor: AdminActor, once: Once, map_id: MapId, body: RolloutIn
) -> Response:
    """Begin to roll a revision out to a channel's robots, stage by stage; its first stage begins at once.

    The next stage begins when enough robots report `enabled`; when too many report `failed` it stops
    by itself. After the last stage the channel points to the revision. Needs an admin key.
    """

    def act(session: Session) -> Answered:
        shown = rollouts.begin_rollout(
            kernel,
            session,
            actor,
            map_id=map_id,
            channel=body.channel,
            plan=body.plan(),
        )
        told = RolloutOut.of(shown)
        return answered(told, status=201, headers={"Location": f"/v1/rollouts/{told.id}"})

    return respond(answer_once(kernel, actor, point="begin-rollout", request=once, act=act))


@router.get("/maps/{map_id}/rollouts", response_model=Page[RolloutOut])
def list_rollouts(
    kernel: KernelDep,
    actor: TabletActor,
    paging: PagingDep,
    map_id: MapId,
    *,
    channel: Annotated[Channel | None, Query(description="Only roll-outs on this channel.")] = None,
    state: Annotated[RolloutState | None, Query(description="Only roll-outs in this state.")] = None,
) -> Page[RolloutOut]:
    """List the roll-outs of a map, newest first. Needs a tablet or admin key."""
    with kernel.db.reading() as session:
        rows = rollouts.list_rollouts(
            session,
            actor,
            map_id=map_id,
            channel=channel,
            state=state,
            below=paging.after_id(),
            limit=paging.limit + 1,
        )
        return Page[RolloutOut](**paging.page(rows, key=lambda row: row.rollout.id, show=RolloutOut.of))


@router.get("/rollouts/{rollout_id}", response_model=RolloutOut)
def get_rollout(kernel: KernelDep, actor: TabletActor, rollout_id: RolloutId) -> RolloutOut:
    """Show a roll-out: its stage, how many robots have the revision and run it, who failed and why."""
    with kernel.db.reading() as session:
        return RolloutOut.of(rollouts.show_rollout(session, actor, rollout_id=rollout_id))


@router.get("/rollouts/{rollout_id}/robots", response_model=Page[RobotOut])
def list_rollout_robots(
    kernel: KernelDep,
    actor: TabletActor,
    paging: PagingDep,
    rollout_id: RolloutId,
    *,
    behind: Annotated[
        bool | None, Query(description="Only robots that do not run the revision yet, or only the others.")
    ] = None,
) -> Page[RobotOut]:
    """List the robots that the stages so far take: `progress` and `detail` say how far each is, and why."""
    with kernel.db.reading() as session:
        rows = rollouts.list_rollout_robots(
            session,
            actor,
            rollout_id=rollout_id,
            behind=behind,
            after=paging.after_id(),
            limit=paging.limit + 1,
        )
        return Page[RobotOut](**paging.page(rows, key=lambda row: row.robot.id, show=RobotOut.of))


@router.post("/rollouts/{rollout_id}/pause", response_model=RolloutOut)
def pause_rollout(kernel: KernelDep, actor: AdminActor, once: Once, rollout_id: RolloutId) -> Response:
    """Begin no further stage; robots of the present one still get the revision. Needs an admin key."""
    return _change(kernel, actor, once, rollouts.pause_rollout, rollout_id)


@router.post("/rollouts/{rollout_id}/resume", response_model=RolloutOut)
def resume_rollout(kernel: KernelDep, actor: AdminActor, once: Once, rollout_id: RolloutId) -> Response:
    """Go on with a paused or stopped roll-out: failures up to now are forgiven, its stage begins anew.

    Needs an admin key.
    """
    return _change(kernel, actor, once, rollouts.resume_rollout, rollout_id)


@router.post("/rollouts/{rollout_id}/abort", response_model=RolloutOut)
def abort_rollout(kernel: KernelDep, actor: AdminActor, once: Once, rollout_id: RolloutId) -> Response:
    """End a roll-out: every robot should have again what the channel points to. Needs an admin key."""
    return _change(kernel, actor, once, rollouts.abort_rollout, rollout_id)


def _change(
    kernel: Kernel,
    actor: Actor,
    once: IdempotentRequest | None,
    change: Callable[..., rollouts.Shown],
    rollout_id: str,
) -> Response:
    def act(session: Session) -> Answered:
        return answered(RolloutOut.of(change(kernel, session, actor, rollout_id=rollout_id)), status=200)

    return respond(answer_once(kernel, actor, point="change-rollout", request=once, act=act))
