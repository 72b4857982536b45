"""Uploads in pieces, by the tus protocol 1.0: a connection that drops costs nothing."""

from __future__ import annotations

from collections.abc import Callable, Coroutine
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from email.utils import format_datetime
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Header, Request, Response
from fastapi.routing import APIRoute
from starlette.concurrency import run_in_threadpool

from service.api import problems
from service.api.auth import TabletActor
from service.api.bodies import UNLIMITED, refuse_by_length
from service.api.deps import IdempotencyKey, KernelDep, Limits, LimitsDep, idempotent, request_digest, respond
from service.api.pieces import PIECE, Piece, append_body, has_piece, require_offset
from service.api.schemas.tus import (
    EXTENSIONS,
    VERSION,
    announced_of,
    count_of,
    invalid_header,
    require_offered,
)
from service.db.models import Upload
from service.db.session import Session
from service.domain.access import Actor
from service.domain.checksum import ALGORITHMS, Checksum
from service.domain.errors import (
    DomainError,
    Rejected,
    StorageFull,
    TusVersionUnsupported,
    UnsupportedMedia,
    UploadBusy,
)
from service.storage.pieces import PieceStore
from service.usecases.answer import Answered, IdempotentRequest, answer_once
from service.usecases.kernel import Kernel
from service.usecases.resumable_upload import (
    Announced,
    begin_upload,
    begun_whole,
    finish_upload,
    own_upload,
    terminate_upload,
)


class _TusRoute(APIRoute):
    """A route whose answers, refusals included, name the version of the protocol.

    Each has a connection of its own: a browser that loses one it has used before sends the whole request
    again by itself, a piece whose bytes are mostly here (Chromium's HttpNetworkTransaction).
    """

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        handle = super().get_route_handler()

        async def speak_tus(request: Request) -> Response:
            try:
                response = await handle(request)
            except DomainError as error:
                response = problems.answer(error, base_url=problems.base_url_of(request))
                if isinstance(error, TusVersionUnsupported):
                    response.headers["Tus-Version"] = VERSION
                if isinstance(error, UploadBusy):
                    response.headers["Retry-After"] = str(error.members["retry_after_s"])
                if "location" in error.members:
                    response.headers["Location"] = error.members["location"]
            response.headers["Tus-Resumable"] = VERSION
            response.headers["Cache-Control"] = "no-store"
            response.headers["Connection"] = "close"
            return response

        return speak_tus


def _require_spoken(
    request: Request,
    tus_resumable: Annotated[
        str | None, Header(description="Version of the protocol.", examples=[VERSION])
    ] = None,
) -> None:
    if request.method != "OPTIONS" and tus_resumable != VERSION:
        raise TusVersionUnsupported(
            f"Send `Tus-Resumable: {VERSION}`; the request has {tus_resumable!r}.", supported=[VERSION]
        )
    require_offered(request.headers)


router = APIRouter(
    prefix="/v1/tus",
    tags=["resumable uploads"],
    route_class=_TusRoute,
    dependencies=[Depends(_require_spoken)],
    max_body_size=UNLIMITED,
)


@dataclass(frozen=True)
class _Desk:
    """What every request here works with: who asks, where pieces and rows lie, and the limits."""

    kernel: Kernel
    actor: Actor
    pieces: PieceStore
    limits: Limits


def _desk(request: Request, kernel: KernelDep, actor: TabletActor, limits: LimitsDep) -> _Desk:
    return _Desk(kernel, actor, request.app.state.pieces, limits)


Desk = Annotated[_Desk, Depends(_desk)]


@dataclass(frozen=True)
class _Creation:
    """The headers that begin an upload."""

    announced: Announced
    size_bytes: int
    once: IdempotentRequest | None


def _creation(
    request: Request,
    limits: LimitsDep,
    upload_length: Annotated[str | None, Header(description="Size of the whole file [bytes].")] = None,
    upload_metadata: Annotated[
        str | None,
        Header(
            description="Keys with base64 values, by commas: `map_id`, `kind` (`drawing` or `scan`),"
            " `filename`, `options` (JSON; of a drawing `scale` and `page`, of a scan `rough_pose`,"
            " `up`, `unit`). Other keys are passed over."
        ),
    ] = None,
    idempotency_key: IdempotencyKey = None,
) -> _Creation:
    digest = request_digest(request)
    digest.update(f"{upload_length}\n{upload_metadata}".encode())
    return _Creation(
        announced_of(upload_metadata),
        count_of("Upload-Length", upload_length),
        idempotent(idempotency_key, digest=digest, limits=limits),
    )


def _checksum(
    upload_checksum: Annotated[
        str | None,
        Header(
            description="`sha1` or `sha256`, a blank, and the piece's digest in base64.",
            examples=["sha1 Kq5sNclPz7QV2+lfQIuc6R7oRu0="],
        ),
    ] = None,
) -> Checksum | None:
    return None if upload_checksum is None else Checksum(upload_checksum)


def _piece(
    checksum: Annotated[Checksum | None, Depends(_checksum)],
    upload_offset: Annotated[str | None, Header(description="Where the piece begins [bytes].")] = None,
) -> Piece:
    return Piece(count_of("Upload-Offset", upload_offset), checksum)


@router.options("", status_code=204)
@router.options("/{upload_id}", status_code=204, include_in_schema=False)
def describe_tus(limits: LimitsDep) -> Response:
    """Tell what this server speaks of tus: version, extensions, largest upload, checksums. Needs no key."""
    headers = {
        "Tus-Version": VERSION,
        "Tus-Extension": ",".join(EXTENSIONS),
        "Tus-Max-Size": str(limits.max_upload_bytes),
        "Tus-Checksum-Algorithm": ",".join(ALGORITHMS),
    }
    return Response(status_code=204, headers=headers)


@router.post("", status_code=201, response_class=Response)
async def create_upload(
    request: Request,
    desk: Desk,
    creation: Annotated[_Creation, Depends(_creation)],
    checksum: Annotated[Checksum | None, Depends(_checksum)],
) -> Response:
    """Begin an upload in pieces; `Location` (a path) is where the pieces go, `Upload-Expires` until when.

    The body may be the first piece, or all of the file, of the content type
    `application/offset+octet-stream`: `Upload-Offset` tells how much of it is stored, and the rest of the
    answer is as that to a piece. Where it is refused, the upload has begun all the same: `Location` has it.
    """
    brings_piece = has_piece(request)
    if brings_piece:
        refuse_by_length(request, max_bytes=creation.size_bytes)
    done = await run_in_threadpool(_begin, desk, creation)
    answer = respond(done)
    if brings_piece:
        location = done.headers["Location"]
        try:
            upload = await run_in_threadpool(_find, desk, location.rpartition("/")[2])
            first = Piece(0, checksum)
            answer.headers.update(await _take_first(request, desk, upload, first))
        except DomainError as error:
            error.members["location"] = location
            raise
    return answer


@router.head("/{upload_id}", status_code=200)
def find_offset(desk: Desk, upload_id: str) -> Response:
    """Tell how many bytes are safely on disk: `Upload-Offset`, from where the next piece goes on.

    When all are there, `Groundplan-Result` names the drawing or scan that the upload has become and
    `Groundplan-Job` the job that reads it, also when the answer to the last piece was lost. Where neither
    comes, an empty last piece is answered with the reason. While a piece is being written, also one whose
    connection has fallen unnoticed, the answer is 423: an offset told then would make its reader send
    bytes that are already here.
    """
    upload = _find(desk, upload_id)
    offset = _offset(desk, upload)
    headers = {"Upload-Length": str(upload.size_bytes)}
    if metadata := upload.meta.get("metadata"):
        headers["Upload-Metadata"] = metadata
    if offset == upload.size_bytes:
        with suppress(UploadBusy, Rejected, StorageFull):
            headers |= _finish(desk, upload)
    return _at(offset, upload, headers)


@router.patch("/{upload_id}", status_code=204)
async def append_piece(
    request: Request, desk: Desk, piece: Annotated[Piece, Depends(_piece)], upload_id: str
) -> Response:
    """Append a piece of any size, from `Upload-Offset` on: the body, as `application/offset+octet-stream`.

    Without `Upload-Checksum` every byte counts that arrives, also of a piece that breaks off; with it the
    piece counts when its digest fits, or not at all (460). The answer to the last piece names in
    `Groundplan-Result` the drawing or scan that the upload has become, and in `Groundplan-Job` its job.
    """
    if not has_piece(request):
        raise UnsupportedMedia(f"A piece has the content type {PIECE}.")
    upload = await run_in_threadpool(_find, desk, upload_id)
    offset = upload.size_bytes
    if upload.result is None:
        offset = await append_body(request, desk.pieces, upload, piece, room=desk.kernel.room)
    else:
        require_offset(piece.offset, offset)
        refuse_by_length(request, max_bytes=0)
    headers = await run_in_threadpool(_finished, desk, upload, offset)
    return _at(offset, upload, headers, status=204)


@router.delete("/{upload_id}", status_code=204)
def give_up_upload(desk: Desk, upload_id: str) -> Response:
    """Forget an upload and what has come of it; a drawing or scan that it has already become stays."""
    upload = _find(desk, upload_id)
    with ExitStack() as stack:
        if upload.result is None:
            stack.enter_context(desk.pieces.append(upload_id, max_bytes=upload.size_bytes))
        with desk.kernel.db.writing("terminate-upload") as session:
            terminate_upload(desk.kernel, session, desk.actor, upload_id=upload_id)
        desk.pieces.remove(upload_id)
    return Response(status_code=204)


@router.post("/{upload_id}", status_code=204, include_in_schema=False)
async def override_method(request: Request, desk: Desk, upload_id: str) -> Response:
    """Do as PATCH or DELETE, for clients that can only POST and say so in `X-HTTP-Method-Override`."""
    method = request.headers.get("x-http-method-override", "").upper()
    if method == "PATCH":
        checksum = _checksum(request.headers.get("upload-checksum"))
        piece = _piece(checksum, request.headers.get("upload-offset"))
        return await append_piece(request, desk, piece, upload_id)
    if method == "DELETE":
        return await run_in_threadpool(give_up_upload, desk, upload_id)
    raise invalid_header(
        "X-HTTP-Method-Override", "A POST to an upload needs X-HTTP-Method-Override: PATCH or DELETE."
    )


def _begin(desk: _Desk, creation: _Creation) -> Answered:
    def act(session: Session) -> Answered:
        upload = begin_upload(
            desk.kernel,
            session,
            desk.actor,
            pieces=desk.pieces,
            announced=creation.announced,
            size_bytes=creation.size_bytes,
            max_bytes=desk.limits.max_upload_bytes,
            expiry_s=desk.limits.upload_expiry_s,
        )
        begun.append(upload.id)
        return Answered(201, {"Location": f"{router.prefix}/{upload.id}", **_expiry(upload)})

    with begun_whole(desk.kernel, desk.pieces) as begun:
        return answer_once(desk.kernel, desk.actor, point="create-upload", request=creation.once, act=act)


async def _take_first(request: Request, desk: _Desk, upload: Upload, piece: Piece) -> dict[str, str]:
    """Return what is told of the piece that came with the creation; of a repeated one, what is stored."""
    offset = await run_in_threadpool(_offset, desk, upload)
    if offset == 0:
        offset = await append_body(request, desk.pieces, upload, piece, room=desk.kernel.room)
    finished = await run_in_threadpool(_finished, desk, upload, offset)
    return {"Upload-Offset": str(offset), **finished}


def _find(desk: _Desk, upload_id: str) -> Upload:
    with desk.kernel.db.reading() as session:
        return own_upload(desk.kernel, session, desk.actor, upload_id=upload_id)


def _offset(desk: _Desk, upload: Upload) -> int:
    return upload.size_bytes if upload.result is not None else desk.pieces.size_bytes(upload.id)


def _finished(desk: _Desk, upload: Upload, offset: int) -> dict[str, str]:
    return _finish(desk, upload) if offset == upload.size_bytes else {}


def _finish(desk: _Desk, upload: Upload) -> dict[str, str]:
    result = finish_upload(
        desk.kernel, desk.actor, pieces=desk.pieces, upload_id=upload.id, bounds=desk.limits.bounds
    )
    return {
        "Groundplan-Result": f"/v1/{result['kind']}s/{result['id']}",
        "Groundplan-Job": f"/v1/jobs/{result['job_id']}",
    }


def _expiry(upload: Upload) -> dict[str, str]:
    return {"Upload-Expires": format_datetime(upload.expires_at, usegmt=True)}


def _at(offset: int, upload: Upload, headers: dict[str, str], *, status: int = 200) -> Response:
    return Response(status_code=status, headers={"Upload-Offset": str(offset), **_expiry(upload), **headers})
