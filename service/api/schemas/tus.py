"""What headers of resumable uploads hold, read into values."""

from __future__ import annotations

import base64
import binascii
import json
from collections.abc import Mapping
from typing import Any

from service.api.bodies import clean_name
from service.domain.errors import InvalidRequest, TusExtensionNotOffered
from service.domain.formats import Purpose
from service.usecases.resumable_upload import Announced

VERSION = "1.0.0"
"""The version of the protocol that is spoken here."""

EXTENSIONS = ("creation", "creation-with-upload", "expiration", "termination", "checksum")
"""What of the protocol's extensions is offered."""

_NOT_OFFERED = {
    "Upload-Concat": "concatenation",
    "Upload-Defer-Length": "creation-defer-length",
    "Trailer": "checksum-trailer",
}
_MAX_DIGITS = 18
_MAX_METADATA = 8192


def require_offered(headers: Mapping[str, str]) -> None:
    """Pass when no header asks for an extension that is not offered: without it, it would mean another thing.

    Raises
    ------
    TusExtensionNotOffered
        If one does.
    """
    for name, extension in _NOT_OFFERED.items():
        value = headers.get(name.lower())
        if value is None or (name == "Trailer" and "upload-checksum" not in value.lower()):
            continue
        raise TusExtensionNotOffered(
            f"{name}: {value[:80]} is of the extension {extension}, which is not offered here; "
            f"offered are {', '.join(EXTENSIONS)}.",
            extension=extension,
            offered=list(EXTENSIONS),
        )


def count_of(header: str, text: str | None) -> int:
    """Return the whole number that a header holds.

    Raises
    ------
    InvalidRequest
        If the header is missing or holds something else.
    """
    if text is None or not (text.isascii() and text.isdigit() and len(text) <= _MAX_DIGITS):
        raise invalid_header(header, f"{header} has to be a whole number, not {text!r}.")
    return int(text)


def announced_of(metadata: str | None) -> Announced:
    """Return what ``Upload-Metadata`` announces: ``map_id`` and ``kind``, ``filename`` and ``options``.

    Other keys are the sender's own and are passed over; of these ``name`` is the file's where there is no
    ``filename``.

    Raises
    ------
    InvalidRequest
        If the header breaks the protocol's rules, or one of the four is missing or wrong.
    """
    values = _decode(metadata or "")
    map_id, kind = _text(values, "map_id"), _text(values, "kind")
    if not 0 < len(map_id) <= 40:
        raise _invalid("Upload-Metadata needs map_id, the map that the file is for.")
    if kind not in {str(purpose) for purpose in Purpose}:
        raise _invalid("Upload-Metadata needs kind: drawing or scan.")
    name = clean_name(_text(values, "filename") or _text(values, "name"))
    return Announced(map_id, Purpose(kind), name, _options(_text(values, "options")), metadata)


def invalid_header(header: str, detail: str) -> InvalidRequest:
    """Return the refusal of a header."""
    return InvalidRequest(detail, errors=[{"header": header, "detail": detail}])


def _decode(metadata: str) -> dict[str, bytes]:
    """Return the values by their keys; a value may be empty, or not be there."""
    if len(metadata) > _MAX_METADATA:
        raise _invalid(f"Upload-Metadata has {len(metadata)} characters; at most {_MAX_METADATA} are taken.")
    values: dict[str, bytes] = {}
    for pair in filter(None, (part.strip() for part in metadata.split(","))):
        key, _, encoded = pair.partition(" ")
        if not (key.isascii() and key.isprintable()):
            raise _invalid(f"The key {key!a} in Upload-Metadata is not of printable ASCII, as tus asks for.")
        if key in values:
            raise _invalid(f"Upload-Metadata has the key {key!r} twice.")
        try:
            values[key] = base64.b64decode(encoded.strip(), validate=True)
        except (binascii.Error, ValueError):
            raise _invalid(f"The value of {key!r} in Upload-Metadata is no base64.") from None
    return values


def _text(values: Mapping[str, bytes], key: str) -> str:
    try:
        return values.get(key, b"").decode()
    except UnicodeDecodeError:
        raise _invalid(f"The value of {key!r} in Upload-Metadata is no UTF-8 text.") from None


def _options(text: str) -> dict[str, Any]:
    if not text:
        return {}
    try:
        options = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise _invalid(f"The options in Upload-Metadata are no JSON: {error}.") from None
    if not isinstance(options, dict):
        raise _invalid("The options in Upload-Metadata have to be a JSON object.")
    return options


def _invalid(detail: str) -> InvalidRequest:
    return invalid_header("Upload-Metadata", detail)
