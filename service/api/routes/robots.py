"""Robots: enrolled, followed, and heard."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Path, Query, Response

from service.api.auth import AdminActor, AnyActor, Presented, TabletActor
from service.api.deps import KernelDep, Once, answered, respond
from service.api.paging import PagingDep
from service.api.schemas.base import Page
from service.api.schemas.revisions import Channel
from service.api.schemas.robots import (
    Group,
    NewRobotOut,
    ReportIn,
    ReportOut,
    RobotChangeIn,
    RobotIn,
    RobotOut,
)
from service.db.robots import RobotFilter
from service.db.session import Session
from service.usecases import robots
from service.usecases.answer import Answered, answer_once
from service.usecases.keys import derived_secret

router = APIRouter(prefix="/v1/robots", tags=["robots"])

RobotId = Annotated[str, Path(description="Id of the robot.")]

_HIDDEN = "gp_(shown-once)"
"""Stands in for the secret in the remembered answer: what is kept cannot be used."""


@router.post("", status_code=201, response_model=NewRobotOut)
def enrol_robot(
    kernel: KernelDep, actor: AdminActor, once: Once, presented: Presented, body: RobotIn
) -> Response:
    """Enrol a robot: it gets a key of its own, which covers its map alone and is in this answer only.

    Needs an admin key.
    """
    assert presented is not None
    root = presented.credentials if once is not None else None

    def act(session: Session) -> Answered:
        made = robots.enrol_robot(
            kernel,
            session,
            actor,
            device=body.device(),
            root=root,
        )
        told = NewRobotOut.with_key(made.followed, key=made.key.secret if root is None else _HIDDEN)
        return answered(told, status=201, headers={"Location": f"/v1/robots/{told.id}"})

    done = answer_once(kernel, actor, point="enrol-robot", request=once, act=act)
    if root is not None:
        told = NewRobotOut.model_validate_json(done.body)
        told.key = derived_secret(root, key_id=told.key_id)
        done = Answered(done.status, done.headers, told.model_dump_json())
    return respond(Answered(done.status, {**done.headers, "Cache-Control": "no-store"}, done.body))


@router.get("", response_model=Page[RobotOut])
def list_robots(
    kernel: KernelDep,
    actor: TabletActor,
    paging: PagingDep,
    *,
    map_id: Annotated[str | None, Query(alias="map", description="Only robots of this map.")] = None,
    channel: Annotated[Channel | None, Query(description="Only robots that follow this channel.")] = None,
    group: Annotated[Group | None, Query(description="Only robots of this group.")] = None,
    behind: Annotated[
        bool | None, Query(description="Only robots that should run another revision, or only the others.")
    ] = None,
) -> Page[RobotOut]:
    """List robots: what each should run, what it runs, how far it is. Needs a tablet or admin key."""
    with kernel.db.reading() as session:
        rows = robots.list_robots(
            session,
            actor,
            RobotFilter(map_id=map_id, channel=channel, group_name=group, behind=behind),
            after=paging.after_id(),
            limit=paging.limit + 1,
        )
        return Page[RobotOut](**paging.page(rows, key=lambda row: row.robot.id, show=RobotOut.of))


@router.get("/{robot_id}", response_model=RobotOut)
def get_robot(kernel: KernelDep, actor: AnyActor, robot_id: RobotId) -> RobotOut:
    """Show a robot; a robot's own key shows that robot alone."""
    with kernel.db.reading() as session:
        return RobotOut.of(robots.show_robot(session, actor, robot_id=robot_id))


@router.patch("/{robot_id}", response_model=RobotOut)
def change_robot(kernel: KernelDep, actor: AdminActor, robot_id: RobotId, body: RobotChangeIn) -> RobotOut:
    """Give a robot another name, channel or group. Needs an admin key."""
    with kernel.db.writing("change-robot") as session:
        changed = robots.change_robot(kernel, session, actor, robot_id=robot_id, changes=body.changes())
        return RobotOut.of(changed)


@router.post("/{robot_id}/reports", status_code=201, response_model=RobotOut)
def report(kernel: KernelDep, actor: AnyActor, once: Once, robot_id: RobotId, body: ReportIn) -> Response:
    """Tell what the robot did with a revision: downloaded, verified, enabled or failed, with a detail.

    Sent with the robot's own key.
    """

    def act(session: Session) -> Answered:
        followed = robots.take_report(
            kernel,
            session,
            actor,
            robot_id=robot_id,
            revision_n=body.revision,
            state=body.state,
            sha256=body.sha256,
            detail=body.detail,
        )
        return answered(RobotOut.of(followed), status=201)

    return respond(answer_once(kernel, actor, point="take-report", request=once, act=act))


@router.get("/{robot_id}/reports", response_model=Page[ReportOut])
def list_reports(kernel: KernelDep, actor: AnyActor, paging: PagingDep, robot_id: RobotId) -> Page[ReportOut]:
    """List what a robot has reported, newest first."""
    with kernel.db.reading() as session:
        rows = robots.list_reports(
            session, actor, robot_id=robot_id, below=paging.after_id(), limit=paging.limit + 1
        )
        return Page[ReportOut](**paging.page(rows, key=lambda row: row.id, show=ReportOut.model_validate))
