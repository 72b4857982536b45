"""What headers of resumable uploads hold, read into values."""

from __future__ import annotations

import base64
import binascii
import json
from typing import Any

from service.api.streams import clean_name
from service.domain.errors import InvalidRequest
from service.domain.media import Purpose
from service.usecases.resumable_upload import Announced

_KNOWN = ("filename", "filetype", "map_id", "kind", "options")
_MAX_DIGITS = 18


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

    Raises
    ------
    InvalidRequest
        If one is missing, wrong, or unknown.
    """
    values = _decode(metadata or "")
    unknown = set(values) - set(_KNOWN)
    if unknown:
        raise _invalid(f"Upload-Metadata has a key {min(unknown)!r}; known are {', '.join(_KNOWN)}.")
    if not values.get("map_id") or len(values["map_id"]) > 40:
        raise _invalid("Upload-Metadata needs map_id, the map that the file is for.")
    if values.get("kind") not in {str(purpose) for purpose in Purpose}:
        raise _invalid("Upload-Metadata needs kind: drawing or scan.")
    name = clean_name(values.get("filename", ""))
    return Announced(values["map_id"], Purpose(values["kind"]), name, _options(values.get("options", "")))


def invalid_header(header: str, detail: str) -> InvalidRequest:
    """Return the refusal of a header."""
    return InvalidRequest(detail, errors=[{"header": header, "detail": detail}])


def _decode(metadata: str) -> dict[str, str]:
    values: dict[str, str] = {}
    for pair in filter(None, (part.strip() for part in metadata.split(","))):
        key, _, encoded = pair.partition(" ")
        if key in values:
            raise _invalid(f"Upload-Metadata has the key {key!r} twice.")
        try:
            values[key] = base64.b64decode(encoded.strip(), validate=True).decode()
        except (binascii.Error, ValueError):
            raise _invalid(f"The value of {key!r} in Upload-Metadata is no base64 of UTF-8 text.") from None
    return values


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
