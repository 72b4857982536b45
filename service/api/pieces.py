"""The body of a request that is a piece of an upload: checked, and safely on disk."""

from __future__ import annotations

import functools
from dataclasses import dataclass

from fastapi import Request
from starlette.concurrency import run_in_threadpool

from service.api.bodies import announced_bytes, batches, refuse_by_length
from service.db.models import Upload
from service.domain.checksum import Checksum
from service.domain.errors import UnsupportedMedia, UploadOffsetMismatch
from service.storage.pieces import Appender, PieceStore
from service.storage.room import PIECES, Room
from service.usecases.resumable_upload import check_beginning

PIECE = "application/offset+octet-stream"
"""The content type of a piece."""

_SILENCE_S = 15.0


@dataclass(frozen=True)
class Piece:
    """Hold the headers of a piece.

    Parameters
    ----------
    offset : int
        Where it begins [bytes].
    checksum : Checksum, optional
        The digest that it has to have.
    """

    offset: int
    checksum: Checksum | None


def has_piece(request: Request) -> bool:
    """Return whether the body is a piece; False where there is none.

    Raises
    ------
    UnsupportedMedia
        If the body is something else.
    """
    kind = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if kind == PIECE:
        return True
    if request.headers.get("content-length", "0") != "0" or "transfer-encoding" in request.headers:
        raise UnsupportedMedia(f"A piece has the content type {PIECE}, not {kind[:100]!r}.")
    return False


async def append_body(
    request: Request, pieces: PieceStore, upload: Upload, piece: Piece, *, room: Room
) -> int:
    """Return the new offset, after all bytes of the piece that count are on disk.

    Raises
    ------
    UploadBusy, UploadExpired
        If somebody else is writing to the upload; if it is gone.
    UploadOffsetMismatch
        If the piece does not begin where the stored bytes end.
    UploadTooLarge, UnsupportedMedia, StorageFull
        If the bytes go past the announced size, are of a wrong kind, or find no room beside the reserve; what
        came before stays.
    UploadInterrupted, ChecksumMismatch
        If the body breaks off, or is not what its checksum says.
    """
    opened = pieces.append(upload.id, max_bytes=upload.size_bytes)
    appender = await run_in_threadpool(opened.__enter__)
    try:
        require_offset(piece.offset, appender.size_bytes)
        check_beginning(upload, appender)
        refuse_by_length(request, max_bytes=upload.size_bytes - piece.offset)
        if piece.offset < upload.size_bytes:  # one that is complete takes no more room
            more_bytes = announced_bytes(request) * (1 if piece.checksum is None else 2)
            await run_in_threadpool(functools.partial(room.require, more_bytes, into=PIECES))
        await _take(request, appender, piece.checksum, room=room)
        check_beginning(upload, appender)
    finally:
        await run_in_threadpool(opened.__exit__, None, None, None)
    return appender.size_bytes


async def _take(request: Request, appender: Appender, checksum: Checksum | None, *, room: Room) -> None:
    def take(batch: bytes) -> None:
        room.require(len(batch), into=PIECES)
        if checksum is None:
            appender.write(batch)
        else:
            checksum.update(batch)
            appender.write_aside(batch)

    async for batch in batches(request, silence_s=_SILENCE_S):
        await run_in_threadpool(take, batch)
    if checksum is not None:
        checksum.verify()
        await run_in_threadpool(appender.accept)


def require_offset(given: int, stored: int) -> None:
    """Pass when a piece begins where the stored bytes end.

    Raises
    ------
    UploadOffsetMismatch
        If it does not.
    """
    if given != stored:
        raise UploadOffsetMismatch(
            f"The piece begins at byte {given}, but {stored} bytes are stored; go on from there.",
            upload_offset=stored,
        )
