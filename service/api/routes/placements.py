"""Placements: where a scan lies in the map, with evidence and a verdict."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Path, Response

from service.api.auth import TabletActor
from service.api.deps import BaseUrl, KernelDep, Once, answered, respond
from service.api.paging import PagingDep
from service.api.schemas.base import Page
from service.api.schemas.placements import AcceptIn, PlacementIn, PlacementOut, PlacementWithJob
from service.api.schemas.revisions import RevisionWithJob
from service.db.session import Session
from service.usecases import placements
from service.usecases.accept_placement import accept_placement
from service.usecases.answer import Answered, answer_once
from service.usecases.place import place

router = APIRouter(prefix="/v1", tags=["placements"])

ScanId = Annotated[str, Path(description="Id of the scan.")]
PlacementId = Annotated[str, Path(description="Id of the placement.")]


@router.post("/scans/{scan_id}/placements", status_code=202, response_model=PlacementWithJob)
def create_placement(
    kernel: KernelDep,
    actor: TabletActor,
    once: Once,
    base_url: BaseUrl,
    scan_id: ScanId,
    *,
    body: PlacementIn,
) -> Response:
    """Place a scan on a revision, starting from a rough pose.

    The result is in the placement once its job has succeeded: the pose, what was measured, and a
    verdict. A verdict `rejected` is a result too; the job fails when no pose could be computed. Needs a
    tablet or admin key.
    """

    def act(session: Session) -> Answered:
        asked = place(kernel, session, actor, scan_id=scan_id, wanted=body.wanted())
        where = f"/v1/placements/{asked.placement.id}"
        return answered(
            PlacementWithJob.of(asked, base_url=base_url), status=202, headers={"Location": where}
        )

    return respond(answer_once(kernel, actor, point="place-scan", request=once, act=act))


@router.get("/scans/{scan_id}/placements", response_model=Page[PlacementOut])
def list_placements(
    kernel: KernelDep, actor: TabletActor, paging: PagingDep, scan_id: ScanId
) -> Page[PlacementOut]:
    """List the placements of a scan, newest first."""
    with kernel.db.reading() as session:
        rows = placements.list_placements(
            session, actor, scan_id=scan_id, before=paging.after_id(), limit=paging.limit + 1
        )
        return Page[PlacementOut](**paging.page(rows, key=lambda row: row.id, show=PlacementOut.of))


@router.get("/placements/{placement_id}", response_model=PlacementOut)
def get_placement(kernel: KernelDep, actor: TabletActor, placement_id: PlacementId) -> PlacementOut:
    """Show one placement with its evidence and verdict."""
    with kernel.db.reading() as session:
        return PlacementOut.of(placements.covered_placement(session, actor, placement_id=placement_id))


@router.post("/placements/{placement_id}/accept", status_code=202, response_model=RevisionWithJob)
def accept(
    kernel: KernelDep,
    actor: TabletActor,
    once: Once,
    base_url: BaseUrl,
    placement_id: PlacementId,
    *,
    body: AcceptIn | None = None,
) -> Response:
    """Take the placed scan into the map: a new revision, the latest one's layers and this.

    Only what the map does not explain is taken, unless `part` says otherwise. A layer of the same scan
    is replaced. A placement that `needs-review` is taken only with
    `"reviewed": true`. Needs a tablet or admin key.
    """
    wanted = body or AcceptIn()

    def act(session: Session) -> Answered:
        made = accept_placement(
            kernel,
            session,
            actor,
            placement_id=placement_id,
            reviewed=wanted.reviewed,
            name=wanted.name,
            part=wanted.part.part(),
        )
        revision = made.shown.revision
        where = f"/v1/maps/{revision.map_id}/revisions/{revision.n}"
        return answered(RevisionWithJob.of(made, base_url=base_url), status=202, headers={"Location": where})

    return respond(answer_once(kernel, actor, point="accept-placement", request=once, act=act))
