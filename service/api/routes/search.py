"""Drawings, scans, placements and revisions over all maps that a key covers."""

from __future__ import annotations

import functools
from typing import Annotated, Literal

from fastapi import APIRouter, Query

from service.api.auth import AnyActor, TabletActor
from service.api.deps import BaseUrl, KernelDep
from service.api.schemas.base import Identifier, Page
from service.api.schemas.drawings import DrawingOut
from service.api.schemas.placements import PlacementOut
from service.api.schemas.revisions import RevisionOut
from service.api.schemas.scans import ScanOut
from service.api.searching import SearchDep
from service.domain.lifecycle import RevisionStatus
from service.usecases import find

router = APIRouter(prefix="/v1", tags=["search"])

By = Annotated[Identifier | None, Query(description="Only made by this key.")]
FileName = Annotated[str | None, Query(max_length=200, description="Only whose file name contains this.")]


@router.get("/revisions", response_model=Page[RevisionOut])
def find_revisions(
    kernel: KernelDep,
    actor: AnyActor,
    search: SearchDep,
    *,
    status: Annotated[RevisionStatus | None, Query(description="Only revisions of this status.")] = None,
    drawing: Annotated[Identifier | None, Query(description="Only built on this drawing.")] = None,
    by: By = None,
) -> Page[RevisionOut]:
    """List revisions of all maps that the key covers."""
    wanted = search.wanted({"status": status, "drawing_id": drawing, "created_by": by})
    with kernel.db.reading() as session:
        rows = find.find_revisions(session, actor, wanted)
        return Page[RevisionOut](
            **search.paging.page(rows, key=lambda shown: shown.revision.id, show=RevisionOut.of)
        )


@router.get("/placements", response_model=Page[PlacementOut])
def find_placements(
    kernel: KernelDep,
    actor: TabletActor,
    search: SearchDep,
    *,
    verdict: Annotated[
        Literal["accepted", "needs-review", "rejected"] | None, Query(description="Only of this verdict.")
    ] = None,
    scan: Annotated[Identifier | None, Query(description="Only of this scan.")] = None,
    by: By = None,
) -> Page[PlacementOut]:
    """List placements on all maps that the key covers. Needs a tablet or admin key."""
    wanted = search.wanted({"verdict": verdict, "scan_id": scan, "created_by": by})
    with kernel.db.reading() as session:
        rows = find.find_placements(session, actor, wanted)
        return Page[PlacementOut](**search.paging.page(rows, key=lambda row: row.id, show=PlacementOut.of))


@router.get("/drawings", response_model=Page[DrawingOut])
def find_drawings(
    kernel: KernelDep,
    actor: AnyActor,
    search: SearchDep,
    base_url: BaseUrl,
    *,
    q: FileName = None,
    by: By = None,
) -> Page[DrawingOut]:
    """List drawings of all maps that the key covers."""
    wanted = search.wanted({"created_by": by}, contains=("file_name", q))
    show = functools.partial(DrawingOut.of, base_url=base_url)
    with kernel.db.reading() as session:
        rows = find.find_drawings(session, actor, wanted)
        return Page[DrawingOut](**search.paging.page(rows, key=lambda row: row[0].id, show=show))


@router.get("/scans", response_model=Page[ScanOut])
def find_scans(
    kernel: KernelDep,
    actor: AnyActor,
    search: SearchDep,
    base_url: BaseUrl,
    *,
    q: FileName = None,
    by: By = None,
) -> Page[ScanOut]:
    """List scans of all maps that the key covers."""
    wanted = search.wanted({"created_by": by}, contains=("file_name", q))
    show = functools.partial(ScanOut.of, base_url=base_url)
    with kernel.db.reading() as session:
        rows = find.find_scans(session, actor, wanted)
        return Page[ScanOut](**search.paging.page(rows, key=lambda row: row[0].id, show=show))
