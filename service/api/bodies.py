"""Bodies of any size to disk: SHA-256 and limits on the way, memory that does not grow with the file."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import PurePosixPath, PureWindowsPath

from python_multipart import MultipartParser
from python_multipart.exceptions import MultipartParseError
from python_multipart.multipart import parse_options_header
from starlette.concurrency import run_in_threadpool
from starlette.requests import ClientDisconnect, Request

from service.api.deps import Limits, idempotent, request_digest
from service.domain.bounds import Bounds
from service.domain.errors import InvalidRequest, UnsupportedMedia, UploadInterrupted, UploadTooLarge
from service.domain.formats import Media, Purpose
from service.domain.headers import check_header
from service.domain.media import HEAD_BYTES, accept
from service.storage.blobs import BlobStore, StagedFile, Stored
from service.storage.room import Room
from service.usecases.answer import IdempotentRequest
from service.usecases.receive_file import ReceivedFile

UNLIMITED = 1 << 62
"""The framework's own limit on the bodies of routes that limit theirs here."""

_BATCH_BYTES = 1 << 20
_SILENCE_S = 60.0
_MAX_FIELDS = 16
_MAX_FIELD_BYTES = 64 << 10
_FORM_BYTES = 2 * _MAX_FIELDS * _MAX_FIELD_BYTES
_FILE = "file"
_MAX_NAME = 255


@dataclass
class ReceivedForm:
    """Hold a form with one file; the file is on disk and becomes a blob by `keep`.

    Parameters
    ----------
    fields : dict of str to str
        The other fields.
    file_name : str
        What the sender called the file, without folders and control characters.
    head : bytes
        The file's first `HEAD_BYTES`.
    media : Media
        What they say the file is.
    staged : StagedFile
        The bytes.
    """

    fields: dict[str, str]
    file_name: str
    head: bytes
    media: Media
    staged: StagedFile

    @property
    def size_bytes(self) -> int:
        """Return the size of the file."""
        return self.staged.size_bytes

    def keep(self) -> Stored:
        """Make the file a blob; call it in a thread, it waits for the disk."""
        return self.staged.keep()


def received_file(form: ReceivedForm, *, bounds: Bounds) -> ReceivedFile:
    """Return the form's file, checked by its header and made a blob; call it in a thread.

    Raises
    ------
    ImageTooLarge, TooManyPoints, FileEmpty, FileTruncated, FileMalformed
        If the header shows that the file cannot be read.
    StorageFull
        If the disk has no room.
    """
    check_header(form.head, form.media, size_bytes=form.size_bytes, bounds=bounds)
    stored = form.keep()
    return ReceivedFile(stored.sha256, stored.size_bytes, form.file_name, form.media.media_type)


def form_identity(
    request: Request, form: ReceivedForm, sha256: str, *, key: str | None, limits: Limits
) -> IdempotentRequest | None:
    """Return the identity of a request that is a form with a file of this SHA-256.

    Raises
    ------
    InvalidRequest
        If the Idempotency-Key is none.
    """
    digest = request_digest(request)
    said = json.dumps([sorted(form.fields.items()), form.file_name, sha256])
    digest.update(said.encode())
    return idempotent(key, digest=digest, limits=limits)


@asynccontextmanager
async def received_form(
    request: Request, blobs: BlobStore, *, room: Room, purpose: Purpose, max_bytes: int
) -> AsyncIterator[ReceivedForm]:
    """Give the form of a multipart request; its file vanishes at the end of the block unless kept.

    A file of a wrong kind is refused as soon as its first bytes are there, one that is too large as soon as
    its length or its bytes say so.

    Parameters
    ----------
    room : Room
        Where the bytes go; its reserve stays untouched.
    purpose : Purpose
        What the file has to fit.
    max_bytes : int
        The largest file that is taken.

    Raises
    ------
    UnsupportedMedia
        If the body is no form, or the file is of no kind for the purpose.
    UploadTooLarge
        If the file, or the body by its Content-Length, is larger than `max_bytes`.
    FileEmpty
        If the file has no bytes.
    InvalidRequest
        If the form is broken, has no file or two, or too many or too long fields.
    UploadInterrupted
        If the body ends or stops coming before the form does.
    StorageFull
        If the disk has no room beside its reserve: before a byte is read where the length says so.
    """
    boundary = _boundary(request)
    refuse_by_length(request, max_bytes=max_bytes, overhead_bytes=_FORM_BYTES)
    await run_in_threadpool(room.require, announced_bytes(request))
    with blobs.stage(max_bytes=max_bytes) as staged:
        form = _FormReader(boundary, staged, purpose)

        def take(batch: bytes) -> None:
            room.require(len(batch))
            form.feed(batch)

        async for batch in batches(request, silence_s=_SILENCE_S):
            await run_in_threadpool(take, batch)
        yield form.finish()


async def batches(request: Request, *, silence_s: float) -> AsyncIterator[bytes]:
    """Give the body in pieces of about 1 MiB; what came before an interruption is given before its refusal.

    Raises
    ------
    UploadInterrupted
        If the client goes away, or sends nothing for `silence_s` seconds.
    """
    parts: list[bytes] = []
    size = 0
    refusal: UploadInterrupted | None = None
    stream = request.stream()
    while True:
        try:
            async with asyncio.timeout(silence_s):
                chunk = await anext(stream, b"")
        except (ClientDisconnect, TimeoutError) as error:
            refusal = _interrupted(error, silence_s)
            break
        if not chunk:
            break
        parts.append(chunk)
        size += len(chunk)
        if size >= _BATCH_BYTES:
            yield b"".join(parts)
            parts, size = [], 0
    if parts:
        yield b"".join(parts)
    if refusal is not None:
        raise refusal


def refuse_by_length(request: Request, *, max_bytes: int, overhead_bytes: int = 0) -> None:
    """Refuse a body whose Content-Length is more than is taken, before a byte of it is read.

    Raises
    ------
    UploadTooLarge
        If it is.
    """
    announced = announced_bytes(request)
    if announced > max_bytes + overhead_bytes:
        raise UploadTooLarge(
            f"The upload has {announced} bytes; at most {max_bytes} are taken.", max_upload_bytes=max_bytes
        )


def announced_bytes(request: Request) -> int:
    """Return the body's Content-Length; 0 where it has none."""
    announced = request.headers.get("content-length", "")
    return int(announced) if announced.isdecimal() else 0


def clean_name(name: str) -> str:
    """Return the last part of a path as a name to show: printable, at most 255 characters, never empty."""
    last = PureWindowsPath(PurePosixPath(name).name).name
    shown = "".join(character for character in last if character.isprintable()).strip()
    return shown[-_MAX_NAME:] or "unnamed"


@dataclass
class _Part:
    """Hold the part of a form that is being read; `field_name` is None for the file."""

    headers: dict[bytes, bytes] = field(default_factory=dict)
    name: bytes = b""
    value: bytes = b""
    field_name: str | None = None
    text: bytearray = field(default_factory=bytearray)


class _FormReader:
    """Take a form's bytes as they come: fields to memory, within limits, and the one file to disk."""

    def __init__(self, boundary: bytes, staged: StagedFile, purpose: Purpose) -> None:
        self._staged = staged
        self._purpose = purpose
        self._part = _Part()
        self._fields: dict[str, str] = {}
        self._file_name: str | None = None
        self._head = bytearray()
        self._media: Media | None = None
        self._ended = False
        self._parser = MultipartParser(
            boundary,
            {
                "on_part_begin": self._begin,
                "on_header_field": self._header_name,
                "on_header_value": self._header_value,
                "on_header_end": self._header_end,
                "on_headers_finished": self._headers_end,
                "on_part_data": self._take,
                "on_part_end": self._end,
                "on_end": self._end_form,
            },
        )

    def feed(self, batch: bytes) -> None:
        """Take the next bytes of the body."""
        try:
            self._parser.write(batch)
        except MultipartParseError as error:
            raise _invalid("#", f"The form is broken: {error}.") from error

    def finish(self) -> ReceivedForm:
        """Return the form; all bytes of the body were fed."""
        if not self._ended:
            raise _invalid("#", "The form ends before its closing boundary; the request was cut short.")
        if self._file_name is None:
            raise _invalid(
                f"#/{_FILE}", f"The form has no file: send one part named {_FILE!r}, with a filename."
            )
        head = bytes(self._head)
        media = self._media or accept(head, self._purpose)
        return ReceivedForm(self._fields, self._file_name, head, media, self._staged)

    def _begin(self) -> None:
        self._part = _Part()

    def _header_name(self, data: bytes, start: int, end: int) -> None:
        self._part.name += data[start:end]

    def _header_value(self, data: bytes, start: int, end: int) -> None:
        self._part.value += data[start:end]

    def _header_end(self) -> None:
        part = self._part
        part.headers[part.name.lower()] = part.value
        part.name = part.value = b""

    def _headers_end(self) -> None:
        disposition, options = parse_options_header(self._part.headers.get(b"content-disposition", b""))
        name = options.get(b"name", b"").decode(errors="replace")
        if disposition != b"form-data" or not name:
            raise _invalid("#", "A part of the form has no Content-Disposition with a name.")
        if b"filename" not in options:
            self._begin_field(name)
        else:
            self._begin_file(name, options[b"filename"])

    def _begin_field(self, name: str) -> None:
        if name == _FILE:
            raise _invalid(f"#/{_FILE}", f"The part {_FILE!r} has no filename, so it is no file.")
        if name in self._fields:
            raise _invalid(f"#/{name}", f"The field {name!r} is given twice.")
        if len(self._fields) >= _MAX_FIELDS:
            raise _invalid("#", f"The form has more than {_MAX_FIELDS} fields.")
        self._fields[name] = ""
        self._part.field_name = name

    def _begin_file(self, name: str, file_name: bytes) -> None:
        if name != _FILE:
            raise _invalid(f"#/{name}", f"The file has to come in the part {_FILE!r}, not {name!r}.")
        if self._file_name is not None:
            raise _invalid(f"#/{_FILE}", "The form has two files; send them one by one.")
        coding = self._part.headers.get(b"content-transfer-encoding", b"binary").lower()
        if coding not in {b"binary", b"8bit", b"7bit"}:
            raise _invalid(
                f"#/{_FILE}", "The file has to be sent as plain bytes, without a transfer encoding."
            )
        self._file_name = clean_name(file_name.decode(errors="replace"))

    def _take(self, data: bytes, start: int, end: int) -> None:
        part = self._part
        if part.field_name is not None:
            if len(part.text) + end - start > _MAX_FIELD_BYTES:
                raise _invalid(f"#/{part.field_name}", f"The field is longer than {_MAX_FIELD_BYTES} bytes.")
            part.text += data[start:end]
            return
        self._staged.write(data[start:end])
        if self._media is None:
            self._head += data[start : min(end, start + HEAD_BYTES - len(self._head))]
            if len(self._head) == HEAD_BYTES:
                self._media = accept(bytes(self._head), self._purpose)

    def _end(self) -> None:
        if self._part.field_name is not None:
            try:
                self._fields[self._part.field_name] = self._part.text.decode()
            except UnicodeDecodeError:
                raise _invalid(f"#/{self._part.field_name}", "The field is no UTF-8 text.") from None

    def _end_form(self) -> None:
        self._ended = True


def _boundary(request: Request) -> bytes:
    kind, options = parse_options_header(request.headers.get("content-type", ""))
    boundary = options.get(b"boundary", b"")
    if kind != b"multipart/form-data" or not 1 <= len(boundary) <= 200:
        raise UnsupportedMedia(
            "The body has to be a form (`multipart/form-data; boundary=...`) with a part 'file'.",
            found=kind.decode(errors="replace")[:100],
        )
    return boundary


def _interrupted(error: Exception, silence_s: float) -> UploadInterrupted:
    if isinstance(error, TimeoutError):
        return UploadInterrupted(
            f"No byte came for {silence_s:g} seconds; send the rest, or all of it again."
        )
    return UploadInterrupted("The client went away before the end of its request.")


def _invalid(pointer: str, detail: str) -> InvalidRequest:
    return InvalidRequest(detail, errors=[{"pointer": pointer, "detail": detail}])
