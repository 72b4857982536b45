"""A revision's cloud in other formats, on request."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Path, Request, Response

from service.api.auth import AnyActor, TabletActor
from service.api.deps import BaseUrl, KernelDep, MapId, Once, RevisionN, answered, respond
from service.api.downloads import DOCUMENTED, IMMUTABLE, send_file
from service.api.schemas.exports import AskedExportOut, ExportIn
from service.db.session import Session
from service.domain.lifecycle import ExportFormat
from service.usecases.answer import Answered, answer_once
from service.usecases.exports import ask_for_export, export_file

router = APIRouter(prefix="/v1/maps/{map_id}/revisions/{n}/exports", tags=["downloads"])


@router.post("", status_code=202, response_model=AskedExportOut)
def ask_export(
    kernel: KernelDep,
    actor: TabletActor,
    once: Once,
    base_url: BaseUrl,
    map_id: MapId,
    n: RevisionN,
    body: ExportIn,
) -> Response:
    """Ask for the cloud of a ready revision as LAZ or PLY; a job makes it once.

    Needs a tablet or admin key.
    """

    def act(session: Session) -> Answered:
        asked = ask_for_export(kernel, session, actor, map_id=map_id, n=n, kind=body.format)
        told = AskedExportOut.of(asked, map_id=map_id, n=n, base_url=base_url)
        return answered(told, status=202, headers={"Location": told.export.url})

    return respond(answer_once(kernel, actor, point="ask-export", request=once, act=act))


@router.head("/{kind}", include_in_schema=False)
@router.get("/{kind}", response_class=Response, responses=DOCUMENTED)
def get_export(
    request: Request,
    kernel: KernelDep,
    actor: AnyActor,
    map_id: MapId,
    n: RevisionN,
    kind: Annotated[ExportFormat, Path(description="The format that was asked for.")],
) -> Response:
    """Download an export that was asked for; ETag and ranges as for any file, 503 until it is made."""
    with kernel.db.reading() as session:
        file = export_file(kernel, session, actor, map_id=map_id, n=n, kind=kind)
    return send_file(request, file, caching=IMMUTABLE)
