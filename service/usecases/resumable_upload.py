"""Uploads in pieces: begun, found, finished exactly once, given up, and swept when their time is over."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from datetime import timedelta
from pathlib import Path
from typing import Any

from service.db import uploads as table
from service.db.models import Upload
from service.db.session import Session
from service.domain.access import Actor
from service.domain.bounds import Bounds
from service.domain.drawing_options import DrawingOptions
from service.domain.errors import FileEmpty, UploadExpired, UploadNotFound, UploadTooLarge
from service.domain.formats import Purpose
from service.domain.headers import check_header
from service.domain.lifecycle import Role
from service.domain.media import HEAD_BYTES, accept
from service.domain.scan_options import SaidOfScan
from service.storage.pieces import Appender, PieceStore
from service.storage.room import BLOBS, PIECES
from service.usecases.bytes_first import bytes_first, unless_rows_may_come
from service.usecases.kernel import Kernel
from service.usecases.receive_drawing import receive_drawing
from service.usecases.receive_file import ReceivedFile, require_receiver
from service.usecases.receive_scan import receive_scan

_REMEMBERED = timedelta(days=7)


@dataclass(frozen=True)
class Announced:
    """Hold what a sender announces of an upload.

    Parameters
    ----------
    map_id : str
        The map that the file is for.
    purpose : Purpose
        What the file is.
    file_name : str
        What the sender calls it.
    options : dict
        Of a drawing: ``scale`` and ``page``; of a scan: ``rough_pose``, ``up``, ``unit``.
    metadata : str, optional
        All of it as it was sent, told again to whoever asks.
    """

    map_id: str
    purpose: Purpose
    file_name: str
    options: Mapping[str, Any]
    metadata: str | None = None


def begin_upload(
    kernel: Kernel,
    session: Session,
    actor: Actor,
    *,
    pieces: PieceStore,
    announced: Announced,
    size_bytes: int,
    max_bytes: int,
    expiry_s: float,
) -> Upload:
    """Return a new upload with an empty file.

    Raises
    ------
    Forbidden, MapNotFound
        If the actor may not upload to the map.
    UploadTooLarge, FileEmpty
        If `size_bytes` is over `max_bytes`, or 0.
    StorageFull
        If the disk has no room for all of it beside the reserve.
    InvalidRequest
        If the options are wrong.
    """
    require_receiver(session, actor, announced.map_id)
    if size_bytes > max_bytes:
        raise UploadTooLarge(
            f"The upload has {size_bytes} bytes; at most {max_bytes} are taken.", max_upload_bytes=max_bytes
        )
    if size_bytes == 0:
        raise FileEmpty("The file has no bytes; look at it where it comes from, and upload it again.")
    _options(announced.purpose, announced.options)
    kernel.room.require(size_bytes, into=PIECES | BLOBS)
    now = kernel.now()
    upload = Upload(
        id=kernel.new_id("upl"),
        map_id=announced.map_id,
        size_bytes=size_bytes,
        meta={
            "kind": announced.purpose.value,
            "file_name": announced.file_name,
            "options": dict(announced.options),
            "metadata": announced.metadata,
        },
        created_at=now,
        created_by=actor.key_id,
        expires_at=now + timedelta(seconds=expiry_s),
    )
    pieces.create(upload.id)
    session.add(upload)
    session.flush()
    return upload


@contextmanager
def begun_whole(kernel: Kernel, pieces: PieceStore) -> Iterator[list[str]]:
    """Give a list for the ids of uploads that the block begins: without their rows, their files go again."""
    begun: list[str] = []

    def take_back() -> None:
        with kernel.db.reading() as session:
            for upload_id in begun:
                if table.find_upload(session, upload_id) is None:
                    pieces.remove(upload_id)

    with unless_rows_may_come(kernel, take_back):
        yield begun


def own_upload(
    kernel: Kernel, session: Session, actor: Actor, *, upload_id: str, lock: bool = False
) -> Upload:
    """Return an upload that the actor began, or that an admin of its map looks at.

    Raises
    ------
    UploadNotFound
        If there is none for the actor.
    UploadExpired
        If its time is over.
    """
    missing = UploadNotFound(f"There is no upload {upload_id}, or another key began it.")
    upload = table.find_upload(session, upload_id, lock=lock)
    if upload is None or (upload.created_by != actor.key_id and actor.role is not Role.ADMIN):
        raise missing
    actor.require_map(upload.map_id, otherwise=missing)
    if upload.expires_at <= kernel.now():
        raise UploadExpired(
            f"The upload {upload_id} was to be finished by {upload.expires_at.isoformat()}; begin it again."
        )
    return upload


def check_beginning(upload: Upload, appender: Appender) -> None:
    """Pass when the first bytes, as far as they are there, are of a kind that fits the upload.

    Raises
    ------
    UnsupportedMedia
        If they are not.
    """
    if appender.size_bytes >= min(HEAD_BYTES, upload.size_bytes):
        accept(appender.head(HEAD_BYTES), Purpose(upload.meta["kind"]))


def finish_upload(
    kernel: Kernel,
    actor: Actor,
    *,
    pieces: PieceStore,
    upload_id: str,
    bounds: Bounds,
) -> dict[str, Any]:
    """Return what the complete upload has become: `kind`, `id` and `job_id`; made at most once.

    A crash at any instant leaves the file in place until its drawing or scan is there, and calling this again
    ends the work.

    Raises
    ------
    UploadBusy
        If somebody else is writing to the file or finishing it.
    UnsupportedMedia, FileTruncated, ImageTooLarge, TooManyPoints, FileMalformed
        If the file's own beginning shows that it cannot be read.
    """
    with kernel.db.reading() as session:
        upload = own_upload(kernel, session, actor, upload_id=upload_id)
    if upload.result is None:
        with pieces.append(upload_id, max_bytes=upload.size_bytes) as appender:
            if appender.size_bytes != upload.size_bytes:
                msg = "an upload is finished when all its bytes are there"
                raise ValueError(msg)
            head, path = appender.head(HEAD_BYTES), pieces.path(upload_id)
            with bytes_first(kernel):
                file = _store(kernel, upload, head=head, path=path, bounds=bounds)
                result = _receive_once(kernel, actor, upload_id=upload_id, file=file)
    else:
        result = upload.result
    pieces.remove(upload_id)
    return result


def terminate_upload(kernel: Kernel, session: Session, actor: Actor, *, upload_id: str) -> None:
    """Forget an upload; its file is removed by the caller once that is committed. What it became stays.

    Raises
    ------
    UploadNotFound, UploadExpired
        As `own_upload`.
    """
    session.delete(own_upload(kernel, session, actor, upload_id=upload_id, lock=True))


def sweep_uploads(kernel: Kernel, pieces: PieceStore) -> list[str]:
    """Remove the files of uploads that expired or ended, and return their ids; no row is written."""
    now = kernel.now()

    def is_wanted(upload_id: str) -> bool:
        with kernel.db.reading() as session:
            upload = table.find_upload(session, upload_id)
            return upload is not None and upload.result is None and upload.expires_at > now

    return pieces.sweep(is_wanted, now_s=now.timestamp())


def forget_uploads(kernel: Kernel) -> None:
    """Forget uploads a week after they expired: until then their senders are told what became of them."""
    with kernel.db.writing("sweep-uploads") as session:
        for upload in table.expired_uploads(session, before=kernel.now() - _REMEMBERED):
            session.delete(upload)


def _store(kernel: Kernel, upload: Upload, *, head: bytes, path: Path, bounds: Bounds) -> ReceivedFile:
    media = accept(head, Purpose(upload.meta["kind"]))
    check_header(head, media, size_bytes=upload.size_bytes, bounds=bounds)
    stored = kernel.blobs.adopt(path, keep_source=True)
    return ReceivedFile(stored.sha256, stored.size_bytes, upload.meta["file_name"], media.media_type)


def _receive_once(kernel: Kernel, actor: Actor, *, upload_id: str, file: ReceivedFile) -> dict[str, Any]:
    with kernel.db.writing("finish-upload") as session:
        upload = own_upload(kernel, session, actor, upload_id=upload_id, lock=True)
        if upload.result is None:
            upload.result = _receive(kernel, session, actor, upload=upload, file=file)
        return upload.result


def _receive(
    kernel: Kernel, session: Session, actor: Actor, *, upload: Upload, file: ReceivedFile
) -> dict[str, Any]:
    sender = replace(actor, key_id=upload.created_by)
    options = _options(Purpose(upload.meta["kind"]), upload.meta["options"])
    if isinstance(options, DrawingOptions):
        drawing = receive_drawing(
            kernel, session, sender, map_id=upload.map_id, file=file, options=options
        ).drawing
        return {"kind": "drawing", "id": drawing.id, "job_id": drawing.job_id}
    scan = receive_scan(kernel, session, sender, map_id=upload.map_id, file=file, said=options).scan
    return {"kind": "scan", "id": scan.id, "job_id": scan.job_id}


def _options(purpose: Purpose, options: Mapping[str, Any]) -> DrawingOptions | SaidOfScan:
    if purpose is Purpose.DRAWING:
        return DrawingOptions.from_json(options)
    return SaidOfScan.from_json(options)
