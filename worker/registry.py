"""Which handler does which kind of job: every kind has one."""

from __future__ import annotations

import gc
from collections.abc import Callable, Mapping

import cv2
import numpy as np

from service.domain.lifecycle import JobKind
from worker.context import JobContext
from worker.geometry.drawing.raster.read import read_raster
from worker.geometry.drawing.scale.decision import given
from worker.handlers.build_revision import build_revision, rebuild_revision
from worker.handlers.compare_revisions import compare_revisions
from worker.handlers.deliver_webhooks import deliver_webhooks
from worker.handlers.export_cloud import export_cloud
from worker.handlers.make_delta import make_delta
from worker.handlers.place_scan import place_scan
from worker.handlers.read_drawing import read_drawing
from worker.handlers.read_scan import read_scan

HANDLERS: Mapping[JobKind, Callable[[JobContext], None]] = {
    JobKind.READ_DRAWING: read_drawing,
    JobKind.READ_SCAN: read_scan,
    JobKind.PLACE_SCAN: place_scan,
    JobKind.BUILD_REVISION: build_revision,
    JobKind.MAKE_DELTA: make_delta,
    JobKind.COMPARE_REVISIONS: compare_revisions,
    JobKind.REBUILD_REVISION: rebuild_revision,
    JobKind.EXPORT_CLOUD: export_cloud,
    JobKind.DELIVER_WEBHOOKS: deliver_webhooks,
}

_GARBAGE = (100_000, 50, 100)
"""After so many new objects, and so many looks through the younger ones, garbage is looked for."""


def prepare() -> None:
    """Load what jobs need beyond imports: one tiny drawing is read, so that compiled code is in memory.

    No library may start threads here, since a fork does not take them along: OpenCV is told so, and
    loops that numba runs in parallel are left to the job.
    """
    cv2.setNumThreads(0)
    sheet = np.full((200, 240), 255, dtype=np.uint8)
    sheet[40:155, 40:200] = 0
    sheet[45:150, 45:195] = 255
    read_raster(sheet, scale=given(0.05))


def after_fork() -> None:
    """Let libraries use threads again, in the process of a job, and look for garbage less often.

    A job makes objects by the million that it keeps, and its process ends with it: the usual looks through
    all of them take a fifth of the time in which a large drawing is read.
    """
    cv2.setNumThreads(-1)
    gc.set_threshold(*_GARBAGE)
