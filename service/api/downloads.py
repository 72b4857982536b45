"""Files on their way out: ETag from the content, ranges, and a body that streams."""

from __future__ import annotations

import base64
import re
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import anyio
from fastapi import HTTPException, Request
from fastapi.responses import Response, StreamingResponse

from service.api.conditions import none_match, one_range, range_applies
from service.usecases.download import StoredFile

_CHUNK_BYTES = 256 * 1024
_UNSAFE = re.compile(r'[^\x20-\x7e]|["\\]')

IMMUTABLE = "private, max-age=31536000, immutable"
"""Caching of files whose address always gives the same bytes."""

REVALIDATE = "private, no-cache"
"""Caching of files whose address may give other bytes later."""

DOCUMENTED: dict[int | str, dict[str, Any]] = {
    200: {
        "description": "The file.",
        "content": {"application/octet-stream": {"schema": {"type": "string", "format": "binary"}}},
        "headers": {
            "ETag": {"description": "SHA-256 of the whole file, quoted.", "schema": {"type": "string"}},
            "Repr-Digest": {
                "description": "SHA-256 of the whole file (RFC 9530).",
                "schema": {"type": "string"},
            },
        },
    },
    206: {
        "description": "The part that `Range` asked for.",
        "content": {"application/octet-stream": {"schema": {"type": "string", "format": "binary"}}},
    },
    304: {"description": "The file is the one that `If-None-Match` names."},
}
"""The answers of a download route, for OpenAPI."""


def send_file(request: Request, file: StoredFile, *, caching: str) -> Response:
    """Return the answer to a GET or HEAD of a file: 200, 206 or 304.

    Parameters
    ----------
    caching : str
        `IMMUTABLE` or `REVALIDATE`.

    Raises
    ------
    HTTPException
        416, if the range asked for lies outside of the file.
    """
    headers = {
        "ETag": f'"{file.sha256}"',
        "Cache-Control": caching,
        "Repr-Digest": f"sha-256=:{base64.b64encode(bytes.fromhex(file.sha256)).decode()}:",
    }
    if not none_match(request.headers.get("if-none-match"), file.sha256):
        return Response(status_code=304, headers=headers)
    headers |= {
        "Accept-Ranges": "bytes",
        "Content-Type": file.media_type,
        "Content-Disposition": f'inline; filename="{_UNSAFE.sub("_", file.file_name)}"',
        "X-Content-Type-Options": "nosniff",
    }
    begin, end, status = 0, file.size_bytes, 200
    asked = _asked_range(request, file)
    if asked is not None:
        (begin, end), status = asked, 206
        headers["Content-Range"] = f"bytes {begin}-{end - 1}/{file.size_bytes}"
    headers["Content-Length"] = str(end - begin)
    if request.method == "HEAD":
        return Response(status_code=status, headers=headers)
    return StreamingResponse(_read(file.path, begin, end), status_code=status, headers=headers)


def _asked_range(request: Request, file: StoredFile) -> tuple[int, int] | None:
    if request.method != "GET" or not range_applies(request.headers.get("if-range"), file.sha256):
        return None
    try:
        return one_range(request.headers.get("range"), file.size_bytes)
    except ValueError as error:
        raise HTTPException(
            416,
            f"The file has {file.size_bytes} bytes; the range asked for lies outside of them.",
            headers={"Content-Range": f"bytes */{file.size_bytes}"},
        ) from error


async def _read(path: Path, begin: int, end: int) -> AsyncIterator[bytes]:
    async with await anyio.open_file(path, "rb") as file:
        await file.seek(begin)
        left = end - begin
        while left:
            chunk = await file.read(min(_CHUNK_BYTES, left))
            if not chunk:
                msg = f"{path.name} is {left} bytes shorter than its record"
                raise RuntimeError(msg)
            left -= len(chunk)
            yield chunk
