"""Let roll-outs go on by themselves: to the next stage, to their end, or to a stop."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import timedelta
from enum import StrEnum

from service.db import rollouts as table
from service.db.models import Publication
from service.db.revisions import find_channel, move_pointer
from service.db.robots import Robot
from service.db.rollouts import Rollout
from service.db.session import Session
from service.domain.rollout import RolloutState, RolloutStepKind
from service.domain.webhook import EventKind
from service.usecases.events import emit, tell_published
from service.usecases.kernel import Kernel
from service.usecases.rollout_members import stages_of
from service.usecases.rollouts import enter_stage, failures_from, record_step

_NAMED = 5


class _Move(StrEnum):
    STAY = "stay"
    STOP = "stop"
    GO_ON = "go-on"
    FINISH = "finish"


def advance_rollouts(kernel: Kernel) -> None:
    """Look at every running roll-out, and let each that is due take one step, in a transaction of its own.

    Called again and again by every service process: a roll-out is locked and looked at anew before its step,
    so that of several only one takes it.
    """
    with kernel.db.reading() as session:
        due = [row.id for row in table.running_rollouts(session) if _move(kernel, session, row) != _Move.STAY]
    for rollout_id in due:
        with kernel.db.writing("advance-rollout") as session:
            rollout = table.find_rollout(session, rollout_id, lock=True)
            if rollout is not None and rollout.state == RolloutState.RUNNING:
                _step(kernel, session, rollout, _move(kernel, session, rollout))


def _move(kernel: Kernel, session: Session, rollout: Rollout) -> _Move:
    """Return what the roll-out has to do now."""
    failed = table.failed_robots(session, rollout, after=failures_from(rollout), limit=rollout.failure_limit)
    if len(failed) >= rollout.failure_limit:
        return _Move.STOP
    stages = stages_of(rollout)
    stage = stages[rollout.stage]
    figures = table.figures_of(session, [rollout])[rollout.id]
    is_young = kernel.now() < rollout.stage_began_at + timedelta(seconds=stage.min_s)
    if is_young or not stage.is_reached(enabled=figures.enabled, taken=figures.taken):
        return _Move.STAY
    return _Move.FINISH if rollout.stage + 1 == len(stages) else _Move.GO_ON


def _step(kernel: Kernel, session: Session, rollout: Rollout, move: _Move) -> None:
    if move is _Move.GO_ON:
        enter_stage(kernel, session, rollout, rollout.stage + 1, actor=None)
    elif move is _Move.FINISH:
        _finish(kernel, session, rollout)
    elif move is _Move.STOP:
        _stop(kernel, session, rollout)


def _finish(kernel: Kernel, session: Session, rollout: Rollout) -> None:
    """Let the channel point to the revision: from now on all its robots have it from there."""
    pointer = find_channel(session, rollout.map_id, channel=rollout.channel)
    assert pointer is not None
    now = kernel.now()
    publication = Publication(
        id=kernel.new_id("pub"),
        map_id=rollout.map_id,
        channel=rollout.channel,
        generation=pointer.generation + 1,
        from_n=pointer.revision_n,
        to_n=rollout.revision_n,
        published_at=now,
        published_by=rollout.created_by,
        reason=rollout.override or f"end of the roll-out {rollout.id}",
        overridden=rollout.overridden,
    )
    move_pointer(session, pointer, publication)
    tell_published(kernel, session, publication)
    table.unassign(session, rollout, keep_enabled=False)
    rollout.state, rollout.ended_at = RolloutState.FINISHED.value, now
    detail = f"The channel {rollout.channel!r} points to revision {rollout.revision_n}."
    record_step(kernel, session, rollout, RolloutStepKind.FINISHED, detail=detail, actor=None)
    _tell(kernel, session, rollout, EventKind.ROLLOUT_FINISHED)


def _stop(kernel: Kernel, session: Session, rollout: Rollout) -> None:
    """Send the revision to nobody else; robots that run it keep it until a person decides."""
    after = failures_from(rollout)
    failed = table.failed_robots(session, rollout, after=after, limit=max(_NAMED, rollout.failure_limit))
    rollout.reason = _reason(rollout, failed)
    table.unassign(session, rollout, keep_enabled=True)
    rollout.state = RolloutState.STOPPED.value
    record_step(kernel, session, rollout, RolloutStepKind.STOPPED, detail=rollout.reason, actor=None)
    _tell(kernel, session, rollout, EventKind.ROLLOUT_STOPPED)


def _tell(kernel: Kernel, session: Session, rollout: Rollout, kind: EventKind) -> None:
    told = {
        "rollout_id": rollout.id,
        "channel": rollout.channel,
        "revision": rollout.revision_n,
        "reason": rollout.reason,
    }
    emit(kernel, session, kind, map_id=rollout.map_id, told=told)


def _reason(rollout: Rollout, failed: Sequence[tuple[Robot, str | None]]) -> str:
    words = [f"{robot.name} ({robot.id}): {detail or 'without a word'}" for robot, detail in failed[:_NAMED]]
    count = "1 robot" if len(failed) == 1 else f"{len(failed)} robots"
    more = "" if len(failed) <= _NAMED else "; and others"
    return f"{count} failed with revision {rollout.revision_n}: {'; '.join(words)}{more}"
