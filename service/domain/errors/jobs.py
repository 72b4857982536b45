"""Background work and how it ended."""

from __future__ import annotations

from service.domain.errors.tree import Conflict, NotFound, Unfulfilled


class JobNotFound(NotFound):
    """No job with this id exists, or the key does not cover its map."""

    title = "No such job"


class RebuiltDifferently(Unfulfilled):
    """The revision was built again from its inputs, and some files have other bytes than they had.

    `paths` names them. The recorded files stay as they are; `built_with` and `rebuilt_with` are the versions
    of the software that made them.
    """

    title = "The revision was rebuilt differently"


class JobNotCancellable(Conflict):
    """The job has already ended."""

    title = "The job has already ended"


class JobNotRetryable(Conflict):
    """Only a job that failed or was cancelled can be tried again."""

    title = "The job cannot be tried again"


class PlacementNotComputed(Unfulfilled):
    """No placement could be computed: the scan and the map share too little to compare."""

    title = "No placement could be computed"


class JobCrashed(Unfulfilled):
    """The work on the job came to no end: a defect ended it, or its process died in each of three tries.

    Nothing was changed, and the file that the job works on is kept. `attempts` counts the tries, `last` tells
    how the last one ended. Retry the job once; if it ends so again, the worker's log tells the cause under
    the job's id: send it to those who look after the installation.
    """

    title = "The job crashed"


class JobTimedOut(Unfulfilled):
    """The job took longer than a job may, and was stopped.

    `limit` tells at which limit: `cpu` seconds (`cpu_used_s` of `cpu_limit_s`) or seconds of the `wall` clock
    (`wall_used_s` of `wall_limit_s`). Ask for less at a time, or let the operator raise
    `GROUNDPLAN_JOB_CPU_S` or `GROUNDPLAN_JOB_WALL_S`.
    """

    title = "The job took too long"


class JobOutOfMemory(Unfulfilled):
    """The job needed more memory than a job may take, and was stopped.

    `memory_used_bytes` tells what it held, `memory_limit_bytes` what it may. Ask for less at a time, or let
    the operator raise `GROUNDPLAN_JOB_MEMORY_BYTES`.
    """

    title = "The job needed too much memory"
