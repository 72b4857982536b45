"""Files on their way out: ETag from the content, codings, ranges, and a body that streams."""

from __future__ import annotations

import base64
import re
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import anyio
from fastapi import HTTPException, Request
from fastapi.responses import Response, StreamingResponse

from service.api.codings import takes, takes_bare
from service.api.conditions import listed, match, none_match, one_range, range_applies
from service.domain.errors import CodingNotOffered, FileIsAnother
from service.usecases.download import CodedForm, StoredFile

_CHUNK_BYTES = 512 * 1024
_LEFT_TO_THE_SERVICE = {"range", "if-range", "if-match", "if-unmodified-since"}
_UNSAFE = re.compile(r'[^\x20-\x7e]|["\\]')

IMMUTABLE = "private, max-age=31536000, immutable"
"""Caching of files whose address always gives the same bytes."""

REVALIDATE = "private, no-cache"
"""Caching of files whose address may give other bytes later."""


def _told(text: str) -> dict[str, Any]:
    return {"description": text, "schema": {"type": "string"}}


_DIGESTS = {
    "ETag": _told("SHA-256 of the bytes sent, as hex, quoted: without a coding that of the whole file."),
    "Repr-Digest": _told("SHA-256 of the bytes sent, of all of them where a range was cut out (RFC 9530)."),
    "Unencoded-Digest": _told("SHA-256 of the whole file without any coding; not with a part of it."),
    "Vary": _told("The request headers that choose the coding."),
}

DOCUMENTED: dict[int | str, dict[str, Any]] = {
    200: {
        "description": "The file, in the coding that `Content-Encoding` names.",
        "content": {"application/octet-stream": {"schema": {"type": "string", "format": "binary"}}},
        "headers": {
            **_DIGESTS,
            "Use-As-Dictionary": _told(
                "Which later files can be asked for as what they add to this one (RFC 9842)."
            ),
        },
    },
    206: {
        "description": "The part that `Range` asked for; never coded.",
        "content": {"application/octet-stream": {"schema": {"type": "string", "format": "binary"}}},
        "headers": _DIGESTS,
    },
    304: {"description": "The file is the one that `If-None-Match` names."},
}
"""The answers of a download route, for OpenAPI."""


def send_file(
    request: Request, file: StoredFile, *, caching: str, dictionary_for: str | None = None
) -> Response:
    """Return the answer to a GET or HEAD of a file: 200, 206 or 304.

    A request for a range gets the bare file, which alone has ranges; any other the first of the file's
    forms that `Accept-Encoding` takes.

    Parameters
    ----------
    caching : str
        `IMMUTABLE` or `REVALIDATE`.
    dictionary_for : str, optional
        Pattern of the paths (URL Pattern) of which this file is a dictionary, told with every whole file.

    Raises
    ------
    CodingNotOffered
        If `Accept-Encoding` forbids the bare file, and there is no other form.
    FileIsAnother
        If `If-Match` names neither the file nor the form of it that is due.
    HTTPException
        416, if the range asked for lies outside of the file.
    """
    wanted, held = listed(request, "if-match"), listed(request, "if-none-match")
    form = _chosen_form(request, file)
    headers = {
        "Cache-Control": caching,
        "Unencoded-Digest": _digest(file.sha256),
        "Vary": "Accept-Encoding, Available-Dictionary",
    }
    tags = [file.sha256] if form is None else [file.sha256, form.sha256]
    if wanted is not None and not any(match(wanted, tag) for tag in tags):
        raise FileIsAnother("The file is not the one that If-Match names.", etag=f'"{tags[-1]}"')
    for tag in tags:
        if not none_match(held, tag):
            return Response(status_code=304, headers={**headers, **_named(tag)})
    headers |= {
        "Content-Type": file.media_type,
        "Content-Disposition": f'inline; filename="{_UNSAFE.sub("_", file.file_name)}"',
    }
    if form is not None:
        return _send_coded(request, form, headers | _dictionary(file, dictionary_for))
    return _send_bare(request, file, headers, _dictionary(file, dictionary_for))


def _chosen_form(request: Request, file: StoredFile) -> CodedForm | None:
    accepted = listed(request, "accept-encoding")
    forms = () if "range" in request.headers else file.forms
    chosen = next((form for form in forms if takes(accepted, form.coding)), None)
    if chosen is None and not takes_bare(accepted):
        offered = [*(form.coding for form in forms), "identity"]
        raise CodingNotOffered(
            f"Accept-Encoding takes none of {', '.join(offered)}, and there is no other form of this file.",
            offered=offered,
        )
    return chosen


def _send_coded(request: Request, form: CodedForm, headers: dict[str, str]) -> Response:
    headers |= _named(form.sha256) | {
        "Content-Encoding": form.coding,
        "Content-Length": str(form.size_bytes),
        "Accept-Ranges": "none",
    }
    if request.method == "HEAD":
        return Response(headers=headers)
    if not form.head and (front := _front(request)) is not None:
        return _hand_over(front, form.path, headers)
    body = _read(form.path, 0, form.size_bytes - len(form.head), head=form.head)
    return StreamingResponse(body, headers=headers)


def _send_bare(
    request: Request, file: StoredFile, headers: dict[str, str], dictionary: dict[str, str]
) -> Response:
    headers |= _named(file.sha256) | {"Accept-Ranges": "bytes"}
    begin, end, status = 0, file.size_bytes, 200
    asked = _asked_range(request, file)
    if asked is not None:
        (begin, end), status = asked, 206
        headers["Content-Range"] = f"bytes {begin}-{end - 1}/{file.size_bytes}"
        headers.pop("Unencoded-Digest")  # browsers verify it against the part alone, and refuse it
    else:
        headers |= dictionary
    headers["Content-Length"] = str(end - begin)
    if request.method == "HEAD":
        return Response(status_code=status, headers=headers)
    if status == 200 and (front := _front(request)) is not None:
        return _hand_over(front, file.path, headers)
    return StreamingResponse(_read(file.path, begin, end), status_code=status, headers=headers)


def _front(request: Request) -> str | None:
    """Return where the front has the blobs; None where it cannot send the file as it is asked for.

    The front would judge conditions and ranges by itself, and knows no ETags: these are answered here.
    """
    prefix: str | None = request.app.state.front_prefix
    return None if _LEFT_TO_THE_SERVICE & set(request.headers.keys()) else prefix


def _hand_over(prefix: str, path: Path, headers: dict[str, str]) -> Response:
    """Return the answer by which the front sends a blob itself, with what these headers say of it."""
    told = {name: value for name, value in headers.items() if name != "Content-Length"}
    return Response(headers={**told, "X-Accel-Redirect": f"{prefix}{path.parent.name}/{path.name}"})


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


def _named(sha256: str) -> dict[str, str]:
    return {"ETag": f'"{sha256}"', "Repr-Digest": _digest(sha256)}


def _dictionary(file: StoredFile, dictionary_for: str | None) -> dict[str, str]:
    if dictionary_for is None:
        return {}
    return {"Use-As-Dictionary": f'match="{dictionary_for}", id="{file.sha256}"'}


def _digest(sha256: str) -> str:
    return f"sha-256=:{base64.b64encode(bytes.fromhex(sha256)).decode()}:"


async def _read(path: Path, begin: int, end: int, *, head: bytes = b"") -> AsyncIterator[bytes]:
    if head:
        yield head
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
