"""A drawing or a scan that comes in one request: the same way for both, up to what is made of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Annotated, TypeVar

from fastapi import Depends, Request, Response
from starlette.concurrency import run_in_threadpool

from service.api.auth import TabletActor
from service.api.bodies import ReceivedForm, form_identity, received_file, received_form
from service.api.deps import IdempotencyKey, KernelDep, Limits, LimitsDep, respond
from service.db.session import Session
from service.domain.access import Actor
from service.domain.formats import Purpose
from service.usecases.answer import Answered, answer_once
from service.usecases.bytes_first import bytes_first
from service.usecases.kernel import Kernel
from service.usecases.receive_file import ReceivedFile, require_receiver

T = TypeVar("T")


@dataclass(frozen=True)
class Sending:
    """Hold a request that sends a file, and who sends it."""

    request: Request
    kernel: Kernel
    actor: Actor
    limits: Limits
    idempotency_key: str | None


def _sending(
    request: Request,
    kernel: KernelDep,
    actor: TabletActor,
    limits: LimitsDep,
    idempotency_key: IdempotencyKey = None,
) -> Sending:
    return Sending(request, kernel, actor, limits, idempotency_key)


SendingDep = Annotated[Sending, Depends(_sending)]


async def receive(
    sending: Sending,
    purpose: Purpose,
    *,
    map_id: str,
    point: str,
    said: Callable[[Mapping[str, str]], T],
    record: Callable[[Session, ReceivedFile, T], Answered],
) -> Response:
    """Return the answer to a file that is sent whole; nothing of it is kept where it is refused.

    Parameters
    ----------
    sending : Sending
        The request.
    purpose : Purpose
        As what the file comes.
    map_id : str
        To which map.
    point : str
        Name of the transaction.
    said : callable
        Reads what the form's fields say of the file.
    record : callable
        Writes file, thing and job, in the transaction that also remembers the answer.

    Raises
    ------
    DomainError
        If the sender may not, or form or file is refused.
    """
    kernel, actor = sending.kernel, sending.actor

    def check() -> None:
        with kernel.db.reading() as session:
            require_receiver(session, actor, map_id)

    def keep(form: ReceivedForm) -> Answered:
        with bytes_first(kernel):
            told = said(form.fields)
            file = received_file(form, bounds=sending.limits.bounds)
            key = sending.idempotency_key
            once = form_identity(sending.request, form, file.sha256, key=key, limits=sending.limits)
            return answer_once(
                kernel, actor, point=point, request=once, act=lambda session: record(session, file, told)
            )

    await run_in_threadpool(check)
    async with received_form(
        sending.request,
        kernel.blobs,
        room=kernel.room,
        purpose=purpose,
        max_bytes=sending.limits.max_upload_bytes,
    ) as form:
        return respond(await run_in_threadpool(keep, form))
