"""Do what a POST asks exactly once, however often it is sent."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import timedelta

from service.db.answers import drop_answer, drop_answers, find_answer, reserve_answer
from service.db.models import Answer
from service.db.session import Session
from service.domain.access import Actor
from service.domain.errors import IdempotencyKeyBusy, IdempotencyKeyReused
from service.usecases.kernel import Kernel

_ROUNDS = 3


@dataclass(frozen=True)
class IdempotentRequest:
    """Hold a request's Idempotency-Key and the SHA-256 of all that it asks.

    Parameters
    ----------
    key : str
        The header's value, 1 to 255 printable ASCII characters.
    request_sha256 : str
        SHA-256 (hex) over method, path, query and body; of a file its own SHA-256 goes in.
    expiry_s : float
        Seconds for which the answer is remembered.
    """

    key: str
    request_sha256: str
    expiry_s: float


@dataclass(frozen=True)
class Answered:
    """Hold an answer as it goes out and as it is remembered: status, headers and JSON text."""

    status: int
    headers: dict[str, str] = field(default_factory=dict)
    body: str = ""


class _TakenMeanwhile(Exception):
    """Another transaction committed the same Idempotency-Key first."""


def answer_once(
    kernel: Kernel,
    actor: Actor,
    *,
    point: str,
    request: IdempotentRequest | None,
    act: Callable[[Session], Answered],
) -> Answered:
    """Return what `act` answers, or what it answered when the same request came before.

    The answer is kept in the transaction of the effect, so that after a crash there is either both or
    neither. A refusal that `act` raises rolls everything back and is not remembered.

    Parameters
    ----------
    point : str
        Name of the transaction, for its crash points.
    request : IdempotentRequest, optional
        None when the client sent no Idempotency-Key: then `act` simply runs in a transaction.
    act : callable
        The effect; called at most once per transaction, with its session.

    Raises
    ------
    IdempotencyKeyReused
        If the key was used before with another request.
    IdempotencyKeyBusy
        If requests with the same key keep crossing each other.
    """
    if request is None:
        with kernel.db.writing(point) as session:
            return act(session)
    for _ in range(_ROUNDS):
        try:
            with kernel.db.writing(point) as session:
                return _answer(kernel, session, actor, request=request, act=act)
        except _TakenMeanwhile:
            continue
    raise IdempotencyKeyBusy("Another request with this Idempotency-Key is being worked on; ask again.")


def forget_answers(kernel: Kernel, *, older_than_s: float) -> None:
    """Forget answers that no repeated request can ask for any more."""
    with kernel.db.writing("forget-answers") as session:
        drop_answers(session, before=kernel.now() - timedelta(seconds=older_than_s))


def _answer(
    kernel: Kernel,
    session: Session,
    actor: Actor,
    *,
    request: IdempotentRequest,
    act: Callable[[Session], Answered],
) -> Answered:
    now = kernel.now()
    earlier = find_answer(session, key_id=actor.key_id, idempotency_key=request.key)
    if earlier is not None and earlier.created_at > now - timedelta(seconds=request.expiry_s):
        return _replay(earlier, request)
    if earlier is not None:
        drop_answer(session, earlier)
    kept = reserve_answer(
        session,
        key_id=actor.key_id,
        idempotency_key=request.key,
        request_sha256=request.request_sha256,
        now=now,
    )
    if kept is None:
        raise _TakenMeanwhile
    answered = act(session)
    kept.status, kept.headers, kept.body = answered.status, dict(answered.headers), answered.body
    return answered


def _replay(earlier: Answer, request: IdempotentRequest) -> Answered:
    if earlier.request_sha256 != request.request_sha256:
        raise IdempotencyKeyReused(
            "This Idempotency-Key was sent before with another request; take a new key for a new request."
        )
    return Answered(earlier.status, {**earlier.headers, "Idempotent-Replayed": "true"}, earlier.body)
