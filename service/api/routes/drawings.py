"""Design drawings: uploaded, read, looked at, read again with another scale or page."""

from __future__ import annotations

import functools
from typing import Annotated

from fastapi import APIRouter, Path, Request, Response

from service.api.auth import AnyActor, TabletActor
from service.api.bodies import UNLIMITED
from service.api.deps import BaseUrl, KernelDep, MapId, answered
from service.api.downloads import DOCUMENTED, REVALIDATE, send_file
from service.api.paging import PagingDep
from service.api.receive import SendingDep, receive
from service.api.schemas.base import Page
from service.api.schemas.drawing_form import FORM
from service.api.schemas.drawings import DrawingAccepted, DrawingOut, DrawingPatch
from service.db.session import Session
from service.domain.drawing_options import DrawingOptions
from service.domain.formats import Purpose
from service.usecases.answer import Answered
from service.usecases.drawings import covered_drawing, drawing_file, list_drawings, reread_drawing
from service.usecases.receive_drawing import receive_drawing
from service.usecases.receive_file import ReceivedFile

router = APIRouter(tags=["drawings"])

DrawingId = Annotated[str, Path(description="Id of the drawing.", max_length=40)]


@router.post(
    "/v1/maps/{map_id}/drawings",
    status_code=202,
    response_model=DrawingAccepted,
    openapi_extra=FORM,
    max_body_size=UNLIMITED,
)
async def upload_drawing(sending: SendingDep, base_url: BaseUrl, map_id: MapId) -> Response:
    """Upload a design drawing of a map; a job reads its walls.

    The scale is said in one way: `scale` (JSON), `metres_per_unit`, `ratio` with `dpi`, or `known_length`; it
    may also be said later by `PATCH /v1/drawings/{drawing_id}`. A new issue of a drawing says which one it
    `replaces`: scale, page, layers and corrections of that one are taken over, and a finding of the reading
    names each correction that no longer fits. What the file's own first bytes show to be wrong is refused at
    once; the rest the job finds out, and carries the same kind of problem document.
    """

    def record(session: Session, file: ReceivedFile, options: DrawingOptions) -> Answered:
        kernel, actor = sending.kernel, sending.actor
        received = receive_drawing(kernel, session, actor, map_id=map_id, file=file, options=options)
        row = covered_drawing(session, actor, drawing_id=received.drawing.id)
        shown = DrawingAccepted.of(row, base_url=base_url)
        return answered(shown, status=202, headers={"Location": f"/v1/drawings/{shown.drawing.id}"})

    said = DrawingOptions.from_fields
    return await receive(
        sending, Purpose.DRAWING, map_id=map_id, point="receive-drawing", said=said, record=record
    )


@router.get("/v1/maps/{map_id}/drawings", response_model=Page[DrawingOut])
def list_map_drawings(
    kernel: KernelDep, actor: AnyActor, paging: PagingDep, base_url: BaseUrl, map_id: MapId
) -> Page[DrawingOut]:
    """List the drawings of a map, oldest first."""
    show = functools.partial(DrawingOut.of, base_url=base_url)
    with kernel.db.reading() as session:
        rows = list_drawings(session, actor, map_id=map_id, after=paging.after_id(), limit=paging.limit + 1)
        return Page[DrawingOut](**paging.page(rows, key=lambda row: row[0].id, show=show))


@router.get("/v1/drawings/{drawing_id}", response_model=DrawingOut)
def get_drawing(kernel: KernelDep, actor: AnyActor, base_url: BaseUrl, drawing_id: DrawingId) -> DrawingOut:
    """Show a drawing: its latest finished reading, and its latest job with its state or its problem."""
    with kernel.db.reading() as session:
        return DrawingOut.of(covered_drawing(session, actor, drawing_id=drawing_id), base_url=base_url)


@router.patch("/v1/drawings/{drawing_id}", status_code=202, response_model=DrawingAccepted)
def change_drawing(
    kernel: KernelDep, actor: TabletActor, base_url: BaseUrl, drawing_id: DrawingId, body: DrawingPatch
) -> DrawingAccepted:
    """Say another scale, page, storey or choice of layers, or correct the reading, and have it read again.

    The earlier reading stays until the new one is done; a job that still reads it is cancelled.
    """
    with kernel.db.writing("reread-drawing") as session:
        row = reread_drawing(
            kernel, session, actor, drawing_id=drawing_id, change=lambda now: now.changed(body.said())
        )
        return DrawingAccepted.of(row, base_url=base_url)


@router.head("/v1/drawings/{drawing_id}/{name}", include_in_schema=False)
@router.get("/v1/drawings/{drawing_id}/{name}", response_class=Response, responses=DOCUMENTED)
def get_drawing_file(
    request: Request,
    kernel: KernelDep,
    actor: AnyActor,
    drawing_id: DrawingId,
    name: Annotated[
        str, Path(description="`preview.png`, `walls.geojson`, `removed.geojson`, `sheet.json`, `sheet.bin`.")
    ],
) -> Response:
    """Download a file of the latest finished reading.

    `preview.png` is for people; `walls.geojson` holds the walls in frame `drawing`, and `removed.geojson`
    every stroke that was set aside, with its reason. `sheet.json` and `sheet.bin` have the pixels of a sheet
    in tiles, for viewers.
    """
    with kernel.db.reading() as session:
        file = drawing_file(kernel, session, actor, drawing_id=drawing_id, name=name)
    return send_file(request, file, caching=REVALIDATE)
