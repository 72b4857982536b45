"""What routes are given: the kernel, the public address, the Idempotency-Key, and how they answer."""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass, field
from typing import Annotated

from fastapi import Depends, Header, Path, Request, Response
from pydantic import BaseModel

from service.api.problems import base_url_of
from service.domain.bounds import Bounds
from service.domain.errors import InvalidRequest
from service.domain.outbound import Network
from service.usecases.answer import Answered, IdempotentRequest
from service.usecases.kernel import Kernel

MIB = 1024 * 1024
JSON_BODY_BYTES = MIB
_PRINTABLE = re.compile(r"[\x21-\x7e]{1,255}")


@dataclass(frozen=True)
class Limits:
    """Hold the limits of this service that routes have to know."""

    max_upload_bytes: int
    upload_expiry_s: float
    idempotency_expiry_s: float
    bounds: Bounds = field(default_factory=Bounds)
    webhook_networks: tuple[Network, ...] = ()


def _kernel(request: Request) -> Kernel:
    kernel: Kernel = request.app.state.kernel
    return kernel


def _limits(request: Request) -> Limits:
    limits: Limits = request.app.state.limits
    return limits


KernelDep = Annotated[Kernel, Depends(_kernel)]
LimitsDep = Annotated[Limits, Depends(_limits)]
BaseUrl = Annotated[str, Depends(base_url_of)]
"""The address under which the client reaches this service, without a slash at its end."""

MapId = Annotated[str, Path(description="Id of the map.", examples=["map_01jcz3v3c8a9q0w7d5k2m4x6yz"])]
RevisionN = Annotated[int, Path(ge=1, le=2**31 - 1, description="Number of the revision.")]

IdempotencyKey = Annotated[
    str | None,
    Header(
        description="A name for this very request, 1 to 255 printable ASCII characters, such as a UUID. Sent "
        "again with the same body, the request has no second effect and gets the first answer, also "
        "after a crash; with another body it is refused.",
    ),
]


def idempotent(key: str | None, *, digest: hashlib._Hash, limits: Limits) -> IdempotentRequest | None:
    """Return the request's identity from its Idempotency-Key and the digest of all that it asks.

    For routes that stream their body: they feed `digest` with method, path, fields and file digests.

    Raises
    ------
    InvalidRequest
        If the key is empty, too long, or holds other than printable ASCII characters.
    """
    if key is None:
        return None
    if not _PRINTABLE.fullmatch(key):
        detail = "An Idempotency-Key is 1 to 255 printable ASCII characters without spaces."
        raise InvalidRequest(detail, errors=[{"header": "Idempotency-Key", "detail": detail}])
    return IdempotentRequest(key, digest.hexdigest(), limits.idempotency_expiry_s)


def request_digest(request: Request) -> hashlib._Hash:
    """Return a SHA-256 that has taken the request's method, path and query; the body is still to come."""
    line = f"{request.method} {request.url.path}?{request.url.query}\n"
    return hashlib.sha256(line.encode())


async def _once(
    request: Request, limits: LimitsDep, idempotency_key: IdempotencyKey = None
) -> IdempotentRequest | None:
    if idempotency_key is None:
        return None
    digest = request_digest(request)
    digest.update(await request.body())
    return idempotent(idempotency_key, digest=digest, limits=limits)


Once = Annotated[IdempotentRequest | None, Depends(_once)]
"""The identity of a request with a JSON body or none; hand it to `answer_once`."""


def answered(model: BaseModel, *, status: int, headers: dict[str, str] | None = None) -> Answered:
    """Return a model as the answer of a POST, ready to be sent and to be remembered."""
    return Answered(status, headers or {}, model.model_dump_json())


def respond(answered: Answered) -> Response:
    """Return an answer as HTTP."""
    return Response(
        answered.body or None,
        status_code=answered.status,
        headers=answered.headers,
        media_type="application/json" if answered.body else None,
    )
