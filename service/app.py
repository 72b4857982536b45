"""The service put together: settings in, an application out."""

from __future__ import annotations

import asyncio
import secrets
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import asdict, replace
from datetime import UTC, datetime
from importlib.metadata import version

import structlog
from fastapi import FastAPI
from starlette.concurrency import run_in_threadpool
from starlette.types import ASGIApp

from service.api import openapi, problems
from service.api.addresses import Addresses
from service.api.deps import JSON_BODY_BYTES, Limits
from service.api.drain import Drain
from service.api.edge import Edge
from service.api.live import Broadcast
from service.api.methods import Heads
from service.api.metrics import Metrics
from service.api.polling import Polling
from service.api.rates import Rates
from service.api.routes import (
    artifacts,
    audit,
    convergence,
    drawings,
    exports,
    fleet_events,
    health,
    history,
    jobs,
    keys,
    maps,
    placements,
    proposals,
    published,
    revisions,
    robots,
    rollouts,
    scans,
    search,
    session,
    tus,
    webhooks,
)
from service.api.routes import problems as problem_pages
from service.api.unchanged import Unchanged
from service.db.blobs import has_blobs
from service.db.schema import require_schema
from service.db.session import Database, SQLAlchemyError, open_engine
from service.domain.bounds import Bounds
from service.domain.errors import DomainError
from service.settings import Settings
from service.storage.local import LocalBlobStore
from service.storage.pieces import PieceStore
from service.storage.room import Room, spare_for_start
from service.usecases.advance_rollouts import advance_rollouts
from service.usecases.dispatch_webhooks import dispatch_webhooks
from service.usecases.kernel import Kernel
from service.usecases.stats import Figures
from service.usecases.sweep_storage import sweep_storage
from service.web import pages

_ROUTERS = (
    maps.router,
    drawings.router,
    scans.router,
    revisions.router,
    artifacts.router,
    exports.router,
    published.router,
    history.router,
    proposals.router,
    audit.router,
    convergence.router,
    search.router,
    robots.router,
    rollouts.router,
    fleet_events.router,
    placements.router,
    tus.router,
    webhooks.router,
    jobs.router,
    keys.router,
    session.router,
    health.router,
    problem_pages.router,
    pages.router,
)


_SWEEP_EVERY_S = 600.0
_ADVANCE_EVERY_S = 0.5


class Application(FastAPI):
    """The application in its `Edge`: around everything, answers to defects and oversized bodies included.

    Only polls that find nothing new are answered before, and keys that send too much refused.
    """

    def build_middleware_stack(self) -> ASGIApp:
        """Return what answers a request."""
        edge = Edge(Heads(super().build_middleware_stack()), metrics=self.state.metrics)
        unchanged = Unchanged(edge, polling=self.state.polling, metrics=self.state.metrics)
        return Rates(unchanged, per_minute=self.state.max_requests_per_minute, metrics=self.state.metrics)


class BlobsMissing(Exception):
    """The database names files and the store has none at all; the sentence tells what to do."""


def open_kernel(settings: Settings) -> Kernel:
    """Return the kernel of this process: the database and the blobs that the settings name."""
    settings.data_dir.mkdir(parents=True, exist_ok=True)
    room = Room(settings.folders(), reserve_bytes=settings.reserve_bytes)
    if (database := settings.folders().get("database")) is not None and database.is_dir():
        spare_for_start(database, room)
    return Kernel(
        db=Database(open_engine(settings.url())),
        blobs=LocalBlobStore(settings.data_dir),
        now=lambda: datetime.now(UTC),
        entropy=secrets.token_bytes,
        room=room,
    )


def require_blobs(kernel: Kernel) -> None:
    """Pass when the store holds something, or the database, of whatever version, names nothing.

    Raises
    ------
    BlobsMissing
        If the files were left where they were, by an upgrade or a restored backup.
    """
    if kernel.blobs.is_empty() and has_blobs(kernel.db.engine):
        raise BlobsMissing(
            "The database names files, and the folder `blobs` of the data folder is empty. Before"
            " docker-compose.yml gave it a volume of its own it lay in the volume `data`: copy it with"
            " `docker run --rm -u 0 -v groundplan_data:/from:ro -v groundplan_blobs:/to groundplan-service"
            " cp -a /from/blobs/. /to/`, then start again. Elsewhere put the backup of `blobs` back."
        )


async def _sweep_for_ever(kernel: Kernel, pieces: PieceStore, settings: Settings) -> None:
    """Make room at the start and then every few minutes; what fails once may succeed the next time."""
    log = structlog.get_logger("service.sweep")
    while True:
        try:
            swept = await run_in_threadpool(
                sweep_storage,
                kernel,
                pieces,
                idempotency_expiry_s=settings.idempotency_expiry_s,
                keep_revisions=settings.keep_revisions,
            )
            log.info("swept", **asdict(swept))
        except (DomainError, OSError, SQLAlchemyError) as error:
            log.warning("sweep-failed", cause=repr(error))
        await asyncio.sleep(_SWEEP_EVERY_S)


async def _advance_for_ever(kernel: Kernel) -> None:
    """Let roll-outs go on and events go out; what fails once may succeed the next time."""
    log = structlog.get_logger("service.advance")
    while True:
        try:
            await run_in_threadpool(advance_rollouts, kernel)
            await run_in_threadpool(dispatch_webhooks, kernel)
        except (DomainError, SQLAlchemyError) as error:
            log.warning("advance-failed", cause=repr(error))
        await asyncio.sleep(_ADVANCE_EVERY_S)


def create_app(settings: Settings, *, kernel: Kernel | None = None) -> FastAPI:
    """Return the HTTP application on the database and the folder that the settings name.

    Parameters
    ----------
    settings : Settings
        What the operator set.
    kernel : Kernel, optional
        An open kernel, which the caller closes; by default one is opened here and closed with the app.

    Raises
    ------
    SchemaNotCurrent
        If the database has not the schema of this version.
    """
    own = kernel is None
    kernel = kernel or open_kernel(settings)
    require_schema(kernel.db.engine)
    figures = Figures(kernel)
    metrics = Metrics(jobs=figures.jobs_now, spaces=kernel.room.spaces)
    metrics.watch_jobs()
    live = replace(kernel, db=Database(open_engine(kernel.db.engine.url)))
    broadcast = Broadcast(live, max_streams_per_key=settings.max_streams_per_key)

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        tasks = [
            asyncio.create_task(_sweep_for_ever(kernel, app.state.pieces, settings)),
            asyncio.create_task(_advance_for_ever(kernel)),
            asyncio.create_task(broadcast.run()),
        ]
        yield
        broadcast.stop()
        for task in tasks:
            task.cancel()
        live.db.close()
        if own:
            kernel.db.close()

    app = Application(
        title="Groundplan",
        version=version("groundplan"),
        summary="The point-cloud map of a 3D-LiDAR robot, from the building's drawing and tablet scans.",
        lifespan=lifespan,
        max_body_size=JSON_BODY_BYTES,
        redirect_slashes=False,
        docs_url=None,
        redoc_url=None,
        responses=openapi.PROBLEMS,
        generate_unique_id_function=openapi.operation_id,
    )
    app.state.kernel = kernel
    app.state.metrics = metrics
    app.state.polling = Polling(kernel)
    app.state.max_requests_per_minute = settings.max_requests_per_key_per_minute
    app.state.routers = _ROUTERS
    app.state.figures = figures
    app.state.front_prefix = settings.front_prefix
    app.state.addresses = Addresses(settings.public_url, hosts=settings.hosts())
    app.state.broadcast = broadcast
    app.state.limits = Limits(
        max_upload_bytes=settings.max_upload_bytes,
        upload_expiry_s=settings.upload_expiry_s,
        idempotency_expiry_s=settings.idempotency_expiry_s,
        bounds=Bounds(max_pixels=settings.max_pixels, max_points=settings.max_points),
        webhook_networks=settings.networks(),
    )
    app.state.pieces = PieceStore(settings.data_dir)
    app.add_middleware(Drain)
    problems.install(app)
    for router in _ROUTERS:
        app.include_router(router)
    openapi.install(app)
    return app
