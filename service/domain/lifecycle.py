"""States of jobs and revisions, the kinds of job, and the steps that are allowed between states."""

from __future__ import annotations

from enum import StrEnum


class JobKind(StrEnum):
    """What a job does; `worker.registry` has one handler for each."""

    READ_DRAWING = "read-drawing"
    READ_SCAN = "read-scan"
    PLACE_SCAN = "place-scan"
    BUILD_REVISION = "build-revision"
    MAKE_DELTA = "make-delta"
    COMPARE_REVISIONS = "compare-revisions"
    REBUILD_REVISION = "rebuild-revision"
    EXPORT_CLOUD = "export-cloud"
    DELIVER_WEBHOOKS = "deliver-webhooks"


class JobState(StrEnum):
    """Where a job stands. ``failed``, ``succeeded`` and ``cancelled`` are final."""

    QUEUED = "queued"
    RUNNING = "running"
    SUCCEEDED = "succeeded"
    FAILED = "failed"
    CANCELLED = "cancelled"

    @property
    def is_final(self) -> bool:
        """Return whether no worker will touch the job again."""
        return self in {JobState.SUCCEEDED, JobState.FAILED, JobState.CANCELLED}


class RevisionStatus(StrEnum):
    """Whether a revision can be used; ``ready`` and ``failed`` are final."""

    BUILDING = "building"
    READY = "ready"
    FAILED = "failed"


class ProposalState(StrEnum):
    """What a person decided on a proposal; ``accepted`` and ``dismissed`` are final."""

    OPEN = "open"
    ACCEPTED = "accepted"
    DISMISSED = "dismissed"


class RobotState(StrEnum):
    """How far a robot has come with a revision, in its own words."""

    DOWNLOADED = "downloaded"
    VERIFIED = "verified"
    ENABLED = "enabled"
    FAILED = "failed"


class ExportFormat(StrEnum):
    """What a revision's cloud can be exported as, beside the PCD that it always has."""

    LAZ = "laz"
    PLY = "ply"


class Role(StrEnum):
    """What a key may do: a tablet uploads and places, a robot downloads, an admin does everything."""

    TABLET = "tablet"
    ROBOT = "robot"
    ADMIN = "admin"


MAX_ATTEMPTS = 3
BACK_OFF_S = (1.0, 5.0)
"""Seconds until the second and the third attempt of a job whose child died; of one whose worker died none."""

MOST_WAITING_DELTAS = 8
"""Deltas of one map that have still to be made, beyond which no other is begun.

Each takes seconds, minutes for clouds of 1 GB (`tests/benchmarks/test_large_delta.py`), and robots of a map
hold few revisions: eight serve a fleet that is spread over the last eight publications. As many again may
wait that the product foresees, one for each move of a channel, so that no robot keeps the fleet's next back.
"""

MOST_FULL_TRIES = 5
"""Tries of a job that begin with room above the reserve and find the disk full; the last one ends it.

With the pauses of `room_wait_s` a job of some minutes outlasts twenty minutes in which others fill the disk
and make room again; one that does not fit costs a worker five tries, and not tries for ever.
"""

MOST_ROOM_WAIT_S = 300.0
_WAITS_A_TRY = 2.0


def room_wait_s(took_s: float, *, least_s: float) -> float:
    """Return the seconds until a job that found the disk full is tried again.

    Twice as long as the try took, so that a job which does not fit leaves its worker to the others; but
    `least_s` at least, and five minutes at most.

    Examples
    --------
    >>> room_wait_s(1.0, least_s=15.0), room_wait_s(60.0, least_s=15.0), room_wait_s(3000.0, least_s=15.0)
    (15.0, 120.0, 300.0)
    """
    return min(max(least_s, _WAITS_A_TRY * took_s), MOST_ROOM_WAIT_S)
