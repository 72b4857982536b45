"""Begin, show, hold and end roll-outs: a revision that reaches a channel's robots stage by stage."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from service.db import rollouts as table
from service.db.robots import Robot, RobotFilter
from service.db.rollouts import Figures, Rollout, RolloutStep
from service.db.session import Session
from service.domain.access import Actor
from service.domain.errors import InvalidRequest, RolloutNotFound, RolloutNotInState
from service.domain.ids import new_id
from service.domain.lifecycle import Role
from service.domain.rollout import Plan, RolloutState, RolloutStepKind, Stage
from service.usecases.audit import record
from service.usecases.kernel import Kernel
from service.usecases.maps import covered_map
from service.usecases.publish import pass_gates, published_pointer
from service.usecases.revisions import ready_revision
from service.usecases.robots import Followed, list_robots
from service.usecases.rollout_members import refuse_under_way, take_stage

_STAFF = (Role.TABLET, Role.ADMIN)
SHOWN_FAILURES = 20
"""Most failed robots that are shown with a roll-out."""


@dataclass(frozen=True)
class Shown:
    """Hold a roll-out with its history; `figures` is None and nobody `failed` once it has ended."""

    rollout: Rollout
    steps: Sequence[RolloutStep]
    figures: Figures | None
    failed: Sequence[tuple[Robot, str | None]] = ()


def begin_rollout(
    kernel: Kernel, session: Session, actor: Actor, *, map_id: str, channel: str, plan: Plan
) -> Shown:
    """Return a new roll-out of a ready revision, in its first stage.

    Raises
    ------
    Forbidden
        If the actor is no admin.
    MapNotFound, RevisionNotFound, RevisionNotReady
        As `ready_revision`.
    GatesClosed
        As `pass_gates`.
    NothingPublished
        If the channel points nowhere: there is nothing to fall back on. Publish instead.
    RolloutUnderWay
        If the channel has a roll-out that has not ended.
    InvalidRequest
        If the channel points to the revision already, or a group has no robot.
    """
    actor.require_role(Role.ADMIN)
    covered_map(session, actor, map_id=map_id, lock=True)
    revision = ready_revision(session, actor, map_id=map_id, n=plan.revision_n)
    pointer = published_pointer(session, actor, map_id=map_id, channel=channel)
    refuse_under_way(session, map_id, channel=channel)
    if pointer.revision_n == plan.revision_n:
        detail = f"The channel {channel!r} points to revision {plan.revision_n} already."
        raise InvalidRequest(detail, errors=[{"pointer": "#/revision", "detail": detail}])
    gates = pass_gates(session, revision, channel=channel, override=plan.override)
    _require_robots(session, map_id, channel=channel, stages=plan.stages)
    now = kernel.now()
    rollout = Rollout(
        id=kernel.new_id("rol"),
        map_id=map_id,
        channel=channel,
        revision_n=plan.revision_n,
        from_n=pointer.revision_n,
        state=RolloutState.RUNNING.value,
        stages=[stage.to_json() for stage in plan.stages],
        stage=0,
        stage_began_at=now,
        failure_limit=plan.failure_limit,
        counts_from=now,
        override=plan.override if gates else None,
        overridden=gates or None,
        created_at=now,
        created_by=actor.key_id,
    )
    session.add(rollout)
    session.flush()
    enter_stage(kernel, session, rollout, 0, actor=actor)
    return _shown(session, [rollout])[0]


def enter_stage(kernel: Kernel, session: Session, rollout: Rollout, n: int, *, actor: Actor | None) -> None:
    """Begin stage `n`: its robots have the roll-out's revision from now on."""
    rollout.stage, rollout.stage_began_at = n, kernel.now()
    taken = take_stage(session, rollout)
    detail = f"{taken} robots have revision {rollout.revision_n}."
    record_step(kernel, session, rollout, RolloutStepKind.STAGE, detail=detail, actor=actor)


def record_step(
    kernel: Kernel,
    session: Session,
    rollout: Rollout,
    kind: RolloutStepKind,
    *,
    detail: str | None,
    actor: Actor | None,
) -> None:
    """Keep what happened to a roll-out; `actor` None is the product itself."""
    session.add(
        RolloutStep(
            id=kernel.new_id("rst"),
            rollout_id=rollout.id,
            map_id=rollout.map_id,
            kind=kind.value,
            stage=rollout.stage,
            detail=detail,
            at=kernel.now(),
            key_id=None if actor is None else actor.key_id,
        )
    )
    record(
        kernel,
        session,
        actor,
        action=f"rollout-{kind}",
        subject_id=rollout.id,
        map_id=rollout.map_id,
        after={"state": rollout.state, "stage": rollout.stage, "detail": detail},
    )
    session.flush()


def pause_rollout(kernel: Kernel, session: Session, actor: Actor, *, rollout_id: str) -> Shown:
    """Return the roll-out, paused: its stage stays, and no other begins.

    Raises
    ------
    Forbidden, RolloutNotFound
        As `show_rollout`; only an admin may.
    RolloutNotInState
        If it does not run.
    """
    rollout = _held(session, actor, rollout_id, allowed=(RolloutState.RUNNING,), to="paused")
    rollout.state = RolloutState.PAUSED.value
    record_step(kernel, session, rollout, RolloutStepKind.PAUSED, detail=None, actor=actor)
    return _shown(session, [rollout])[0]


def resume_rollout(kernel: Kernel, session: Session, actor: Actor, *, rollout_id: str) -> Shown:
    """Return the roll-out, running again; failures up to now are forgiven, and its stage begins anew.

    Raises
    ------
    Forbidden, RolloutNotFound
        As `show_rollout`; only an admin may.
    RolloutNotInState
        If it is neither paused nor stopped.
    """
    allowed = (RolloutState.PAUSED, RolloutState.STOPPED)
    rollout = _held(session, actor, rollout_id, allowed=allowed, to="resumed")
    rollout.state, rollout.reason, rollout.counts_from = RolloutState.RUNNING.value, None, kernel.now()
    record_step(kernel, session, rollout, RolloutStepKind.RESUMED, detail=None, actor=actor)
    enter_stage(kernel, session, rollout, rollout.stage, actor=actor)
    return _shown(session, [rollout])[0]


def abort_rollout(kernel: Kernel, session: Session, actor: Actor, *, rollout_id: str) -> Shown:
    """Return the roll-out, ended: every robot has again what the channel points to.

    Raises
    ------
    Forbidden, RolloutNotFound
        As `show_rollout`; only an admin may.
    RolloutNotInState
        If it has ended.
    """
    allowed = tuple(state for state in RolloutState if not state.has_ended)
    rollout = _held(session, actor, rollout_id, allowed=allowed, to="aborted")
    table.unassign(session, rollout, keep_enabled=False)
    rollout.state, rollout.ended_at = RolloutState.ABORTED.value, kernel.now()
    record_step(kernel, session, rollout, RolloutStepKind.ABORTED, detail=None, actor=actor)
    return _shown(session, [rollout])[0]


def show_rollout(session: Session, actor: Actor, *, rollout_id: str) -> Shown:
    """Return a roll-out with its figures, its history and who failed.

    Raises
    ------
    Forbidden
        If the key is a robot's.
    RolloutNotFound
        If there is no such roll-out for the key.
    """
    return _shown(session, [_found(session, actor, rollout_id)])[0]


def list_rollouts(
    session: Session,
    actor: Actor,
    *,
    map_id: str,
    channel: str | None,
    state: RolloutState | None,
    below: str | None,
    limit: int,
) -> list[Shown]:
    """Return up to `limit` roll-outs of a map, newest first, with their figures and histories.

    Raises
    ------
    Forbidden
        If the key is a robot's.
    MapNotFound
        If there is no such map for the key.
    """
    actor.require_role(*_STAFF)
    covered_map(session, actor, map_id=map_id)
    rows = table.list_rollouts(session, map_id, channel=channel, state=state, below=below, limit=limit)
    return _shown(session, rows, with_failed=False)


def list_rollout_robots(
    session: Session,
    actor: Actor,
    *,
    rollout_id: str,
    behind: bool | None,
    after: str | None,
    limit: int,
) -> list[Followed]:
    """Return up to `limit` robots that have their revision from a roll-out; none once it has ended.

    Raises
    ------
    Forbidden, RolloutNotFound
        As `show_rollout`.
    """
    rollout = _found(session, actor, rollout_id)
    if RolloutState(rollout.state).has_ended:
        return []
    wanted = RobotFilter(map_id=rollout.map_id, channel=rollout.channel, behind=behind, assigned=True)
    return list_robots(session, actor, wanted, after=after, limit=limit)


def failures_from(rollout: Rollout) -> str:
    """Return the id after which a report of failure counts."""
    return new_id("rep", now=rollout.counts_from, entropy=bytes)


def _require_robots(session: Session, map_id: str, *, channel: str, stages: Sequence[Stage]) -> None:
    """Pass when every stage has somebody to prove it: an empty one would prove nothing."""
    robots = table.robots_of_channel(session, map_id, channel=channel)
    groups = {group for _, group in robots}
    for n, stage in enumerate(stages):
        if not robots:
            detail = f"No robot follows the channel {channel!r}: publish the revision instead."
        elif stage.group is not None and stage.group not in groups:
            detail = f"No robot on the channel {channel!r} is of the group {stage.group!r}."
        else:
            continue
        raise InvalidRequest(detail, errors=[{"pointer": f"#/stages/{n}", "detail": detail}])


def _found(session: Session, actor: Actor, rollout_id: str, *, lock: bool = False) -> Rollout:
    actor.require_role(*_STAFF)
    missing = RolloutNotFound(f"There is no roll-out {rollout_id}, or this key does not cover its map.")
    rollout = table.find_rollout(session, rollout_id, lock=lock)
    if rollout is None:
        raise missing
    actor.require_map(rollout.map_id, otherwise=missing)
    return rollout


def _held(
    session: Session, actor: Actor, rollout_id: str, *, allowed: Sequence[RolloutState], to: str
) -> Rollout:
    actor.require_role(Role.ADMIN)
    rollout = _found(session, actor, rollout_id, lock=True)
    if rollout.state not in allowed:
        raise RolloutNotInState(f"The roll-out is {rollout.state}: it cannot be {to}.", state=rollout.state)
    return rollout


def _shown(session: Session, rows: Sequence[Rollout], *, with_failed: bool = True) -> list[Shown]:
    steps, figures = table.steps_of(session, [row.id for row in rows]), table.figures_of(session, rows)
    shown = []
    for row in rows:
        is_open = with_failed and row.id in figures
        failed = (
            table.failed_robots(session, row, after=failures_from(row), limit=SHOWN_FAILURES)
            if is_open
            else ()
        )
        shown.append(Shown(row, steps[row.id], figures.get(row.id), failed))
    return shown
