"""Whether the service is alive, ready, and what it is doing."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query, Request, Response
from pydantic import AwareDatetime

from service.api.auth import AdminActor
from service.api.deps import KernelDep
from service.api.metrics import MEDIA_TYPE
from service.api.schemas.stats import HealthOut, ReadyOut, SeriesOut, SeriesPoint, StatsOut
from service.db.series import Bucket, Counted
from service.usecases.readiness import require_ready
from service.usecases.stats import Figures, WantedSeries, series

router = APIRouter(tags=["service"])


@router.get("/healthz", response_model=HealthOut)
async def is_alive() -> HealthOut:
    """Say that the process answers. Needs no key."""
    return HealthOut()


@router.get("/readyz", response_model=ReadyOut)
def is_ready(kernel: KernelDep) -> ReadyOut:
    """Say whether the database, its schema and the storage can be used. Needs no key."""
    return ReadyOut(checks=require_ready(kernel))


@router.get(
    "/metrics",
    response_class=Response,
    responses={200: {"content": {"text/plain": {"schema": {"type": "string"}}}, "description": "Metrics."}},
)
def get_metrics(request: Request) -> Response:
    """Give metrics in Prometheus' text format. Needs no key; a front server keeps it from outside."""
    return Response(request.app.state.metrics.text(), media_type=MEDIA_TYPE)


@router.get("/v1/stats", response_model=StatsOut)
def get_stats(request: Request, kernel: KernelDep, actor: AdminActor) -> StatsOut:
    """Give the whole service's figures. Needs an admin key that covers all maps.

    Counts that take long to find, of millions of rows, may be a few seconds old.
    """
    figures: Figures = request.app.state.figures
    with kernel.db.reading() as session:
        return StatsOut.of(figures.stats(session, actor))


@router.get("/v1/stats/series", response_model=SeriesOut)
def get_series(
    kernel: KernelDep,
    actor: AdminActor,
    what: Annotated[Counted, Query(description="What is counted.")],
    since: Annotated[AwareDatetime, Query(description="From this instant on.")],
    until: Annotated[AwareDatetime, Query(description="Before this instant.")],
    bucket: Annotated[Bucket, Query(description="Length of a step, in UTC.")] = "hour",
) -> SeriesOut:
    """Count what was made in each hour or day of a period, by state. Needs an admin key of all maps."""
    with kernel.db.reading() as session:
        points = series(session, actor, WantedSeries(what, bucket, (since, until)))
        return SeriesOut(
            what=what, bucket=bucket, points=[SeriesPoint.model_validate(point) for point in points]
        )
