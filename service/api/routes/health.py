"""Whether the service is alive, ready, and what it is doing."""

from __future__ import annotations

from fastapi import APIRouter, Request, Response

from service.api.auth import AdminActor
from service.api.deps import KernelDep
from service.api.metrics import MEDIA_TYPE
from service.api.schemas.stats import HealthOut, ReadyOut, StatsOut
from service.usecases.readiness import require_ready
from service.usecases.stats import stats

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
def get_stats(kernel: KernelDep, actor: AdminActor) -> StatsOut:
    """Give the whole service's figures. Needs an admin key that covers all maps."""
    with kernel.db.reading() as session:
        return StatsOut.of(stats(kernel, session, actor))
