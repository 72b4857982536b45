"""Tablet scans: uploaded, read, looked at."""

from __future__ import annotations

import functools
from typing import Annotated

from fastapi import APIRouter, Path, Request, Response

from service.api.auth import AnyActor
from service.api.bodies import UNLIMITED
from service.api.deps import BaseUrl, KernelDep, MapId, answered
from service.api.downloads import DOCUMENTED, REVALIDATE, send_file
from service.api.paging import PagingDep
from service.api.receive import SendingDep, receive
from service.api.schemas.base import Page
from service.api.schemas.scans import FORM, ScanAccepted, ScanOut, said_of
from service.db.session import Session
from service.domain.formats import Purpose
from service.domain.scan_options import SaidOfScan
from service.usecases.answer import Answered
from service.usecases.receive_file import ReceivedFile
from service.usecases.receive_scan import receive_scan
from service.usecases.scans import covered_scan, list_scans, scan_file

router = APIRouter(tags=["scans"])

ScanId = Annotated[str, Path(description="Id of the scan.", max_length=40)]


@router.post(
    "/v1/maps/{map_id}/scans",
    status_code=202,
    response_model=ScanAccepted,
    openapi_extra=FORM,
    max_body_size=UNLIMITED,
)
async def upload_scan(sending: SendingDep, base_url: BaseUrl, map_id: MapId) -> Response:
    """Upload a tablet scan, with or without a rough pose; a job reads its points.

    What the file's own first bytes show to be wrong is refused at once; the rest the job finds out, and
    carries the same kind of problem document. Over a shaky network `POST /v1/tus` takes the file in pieces.
    """

    def record(session: Session, file: ReceivedFile, said: SaidOfScan) -> Answered:
        kernel, actor = sending.kernel, sending.actor
        received = receive_scan(kernel, session, actor, map_id=map_id, file=file, said=said)
        row = covered_scan(session, actor, scan_id=received.scan.id)
        shown = ScanAccepted.of(row, base_url=base_url)
        return answered(shown, status=202, headers={"Location": f"/v1/scans/{shown.scan.id}"})

    return await receive(
        sending, Purpose.SCAN, map_id=map_id, point="receive-scan", said=said_of, record=record
    )


@router.get("/v1/maps/{map_id}/scans", response_model=Page[ScanOut])
def list_map_scans(
    kernel: KernelDep, actor: AnyActor, paging: PagingDep, base_url: BaseUrl, map_id: MapId
) -> Page[ScanOut]:
    """List the scans of a map, oldest first."""
    show = functools.partial(ScanOut.of, base_url=base_url)
    with kernel.db.reading() as session:
        rows = list_scans(session, actor, map_id=map_id, after=paging.after_id(), limit=paging.limit + 1)
        return Page[ScanOut](**paging.page(rows, key=lambda row: row[0].id, show=show))


@router.get("/v1/scans/{scan_id}", response_model=ScanOut)
def get_scan(kernel: KernelDep, actor: AnyActor, base_url: BaseUrl, scan_id: ScanId) -> ScanOut:
    """Show a scan: its reading, and its job with its state or its problem."""
    with kernel.db.reading() as session:
        return ScanOut.of(covered_scan(session, actor, scan_id=scan_id), base_url=base_url)


@router.head("/v1/scans/{scan_id}/preview.png", include_in_schema=False)
@router.get("/v1/scans/{scan_id}/preview.png", response_class=Response, responses=DOCUMENTED)
def get_scan_preview(request: Request, kernel: KernelDep, actor: AnyActor, scan_id: ScanId) -> Response:
    """Download a picture of the scan from above."""
    with kernel.db.reading() as session:
        file = scan_file(kernel, session, actor, scan_id=scan_id, name="preview.png")
    return send_file(request, file, caching=REVALIDATE)


@router.head("/v1/scans/{scan_id}/points", include_in_schema=False)
@router.get("/v1/scans/{scan_id}/points", response_class=Response, responses=DOCUMENTED)
def get_scan_points(request: Request, kernel: KernelDep, actor: AnyActor, scan_id: ScanId) -> Response:
    """Download the scan's points, thinned for viewers, as PCD: metres, z up, frame `scan`."""
    with kernel.db.reading() as session:
        file = scan_file(kernel, session, actor, scan_id=scan_id, name="points")
    return send_file(request, file, caching=REVALIDATE)
