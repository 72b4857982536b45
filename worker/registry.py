"""Which handler does which kind of job: every kind has one."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from service.domain.lifecycle import JobKind
from worker.context import JobContext
from worker.handlers.read_drawing import read_drawing

HANDLERS: Mapping[JobKind, Callable[[JobContext], None]] = {
    JobKind.READ_DRAWING: read_drawing,
}
