"""The worker process: read the settings, join the parts, work until told to stop."""

from __future__ import annotations

import argparse
import os
import secrets
import signal
import socket
import sys
from datetime import UTC, datetime

import structlog
from pydantic import ValidationError

from service import crash_points, logs
from service.db.delivery import open_delivery
from service.db.session import Database, open_engine
from service.domain.job_limits import JobLimits, job_memory_of
from service.machine import memory_bytes
from service.settings import Settings
from service.storage.local import LocalBlobStore
from service.storage.room import Room
from service.usecases.kernel import Kernel
from service.usecases.readiness import why_not_started
from worker.figures import Figures
from worker.runner import NoChild, Runner, Terms


def main(argv: list[str] | None = None) -> int:
    """Run a worker and return its exit status: 0 when told to stop, 1 refused (with one line why)."""
    argparse.ArgumentParser(
        prog="python -m worker",
        description="Run jobs until SIGTERM or SIGINT. Settings come from the environment (GROUNDPLAN_...); "
        "`groundplan worker` takes the folder of files as an option.",
    ).parse_args(argv)
    try:
        settings = Settings()
        url = settings.url()
        logs.configure(level=settings.log_level)
        crash_points.arm_from(settings.crash_at, folder=settings.data_dir)
    except ValidationError as error:
        first = error.errors()[0]
        return _refuse(f"the setting {'.'.join(map(str, first['loc']))}: {first['msg']}")
    except (OSError, ValueError) as error:
        return _refuse(str(error))
    name = f"{socket.gethostname()}:{os.getpid()}"
    kernel = Kernel(
        db=Database(open_engine(url)),
        blobs=LocalBlobStore(settings.data_dir),
        now=lambda: datetime.now(UTC),
        entropy=secrets.token_bytes,
        room=Room(settings.folders(), reserve_bytes=settings.reserve_bytes),
    )
    if why := why_not_started(kernel):
        return _refuse(why)
    limits = JobLimits(
        memory_bytes=settings.job_memory_bytes or job_memory_of(memory_bytes()),
        cpu_s=settings.job_cpu_s,
        wall_s=settings.job_wall_s,
        reading_memory_bytes=settings.reading_memory_bytes,
        reading_cpu_s=settings.reading_cpu_s,
    )
    terms = Terms(
        name=name,
        folder=settings.data_dir.absolute() / "jobs",
        lease_s=settings.lease_s,
        beat_s=settings.beat_s,
        room_wait_s=settings.room_wait_s,
        limits=limits,
    )
    delivery = open_delivery(kernel.db, now=kernel.now, poll_s=settings.poll_s, name=name)
    figures = Figures()
    if settings.worker_metrics_port is not None:
        figures.serve(settings.metrics_host, settings.worker_metrics_port)
    runner = Runner(kernel, delivery, terms=terms, figures=figures)
    signal.signal(signal.SIGTERM, runner.stop)
    signal.signal(signal.SIGINT, runner.stop)
    structlog.get_logger(__name__).info("the worker started", worker=name)
    try:
        runner.run()
    except NoChild:
        return _refuse("its child processes end before they are ready; see above")
    finally:
        kernel.db.close()
    return 0


def _refuse(why: str) -> int:
    sys.stderr.write(f"groundplan worker: {why}\n")
    return 1


if __name__ == "__main__":
    sys.exit(main())
