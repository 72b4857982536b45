"""Maps: one floor of one site each."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query, Response

from service.api.auth import AdminActor, AnyActor
from service.api.deps import KernelDep, MapId, Once, answered, respond
from service.api.paging import PagingDep
from service.api.schemas.base import Page
from service.api.schemas.maps import MapIn, MapOut, MapPatch
from service.db.session import Session
from service.usecases import maps
from service.usecases.answer import Answered, answer_once

router = APIRouter(prefix="/v1/maps", tags=["maps"])


@router.post("", status_code=201, response_model=MapOut)
def create_map(kernel: KernelDep, actor: AdminActor, once: Once, body: MapIn) -> Response:
    """Make a map: one floor of one site, with one frame (metres, z up) that all its revisions share.

    Needs an admin key that covers all maps.
    """

    def act(session: Session) -> Answered:
        row = maps.create_map(kernel, session, actor, site=body.site, name=body.name)
        return answered(MapOut.model_validate(row), status=201, headers={"Location": f"/v1/maps/{row.id}"})

    return respond(answer_once(kernel, actor, point="create-map", request=once, act=act))


@router.get("", response_model=Page[MapOut])
def list_maps(
    kernel: KernelDep,
    actor: AnyActor,
    paging: PagingDep,
    site: Annotated[str | None, Query(max_length=200, description="Only maps of exactly this site.")] = None,
    q: Annotated[
        str | None, Query(max_length=200, description="Only maps whose site or name contains this.")
    ] = None,
) -> Page[MapOut]:
    """List the maps that the key covers, oldest first."""
    with kernel.db.reading() as session:
        rows = maps.list_maps(
            session, actor, site=site, text=q, after=paging.after_id(), limit=paging.limit + 1
        )
        return Page[MapOut](**paging.page(rows, key=lambda row: row.id, show=MapOut.model_validate))


@router.get("/{map_id}", response_model=MapOut)
def get_map(kernel: KernelDep, actor: AnyActor, map_id: MapId) -> MapOut:
    """Show one map: its site, its name, and when they were last changed."""
    with kernel.db.reading() as session:
        return MapOut.model_validate(maps.covered_map(session, actor, map_id=map_id))


@router.patch("/{map_id}", response_model=MapOut)
def change_map(kernel: KernelDep, actor: AdminActor, map_id: MapId, body: MapPatch) -> MapOut:
    """Rename a map or move it to another site; its id and its revisions stay. Needs an admin key."""
    with kernel.db.writing("change-map") as session:
        row = maps.change_map(kernel, session, actor, map_id=map_id, site=body.site, name=body.name)
        return MapOut.model_validate(row)
