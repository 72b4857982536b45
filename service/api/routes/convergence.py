"""How far a fleet has come, at a glance."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query

from service.api.auth import TabletActor
from service.api.deps import KernelDep
from service.api.schemas.convergence import ConvergenceOut
from service.usecases.convergence import show_convergence

router = APIRouter(prefix="/v1", tags=["robots"])


@router.get("/convergence", response_model=ConvergenceOut)
def get_convergence(
    kernel: KernelDep,
    actor: TabletActor,
    map_id: Annotated[str | None, Query(alias="map", description="Only this map.")] = None,
) -> ConvergenceOut:
    """Tell where each channel points, and count its robots by what they run. Needs a tablet or admin key."""
    with kernel.db.reading() as session:
        return ConvergenceOut.of(show_convergence(session, actor, map_id=map_id))
