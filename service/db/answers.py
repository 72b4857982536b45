"""What POSTs with an Idempotency-Key were answered."""

from __future__ import annotations

from datetime import datetime

from sqlalchemy import delete
from sqlalchemy.exc import IntegrityError
from sqlalchemy.orm import Session

from service.db.models import Answer

_UNFINISHED = 0


def find_answer(session: Session, *, key_id: str, idempotency_key: str) -> Answer | None:
    """Return what this key's request was answered, or None."""
    return session.get(Answer, (key_id, idempotency_key))


def reserve_answer(
    session: Session, *, key_id: str, idempotency_key: str, request_sha256: str, now: datetime
) -> Answer | None:
    """Return a new row to be completed in this transaction; None when another request took the key.

    On PostgreSQL this waits for a concurrent request with the same key to commit or roll back. After
    None the session can only be rolled back.
    """
    answer = Answer(
        key_id=key_id,
        idempotency_key=idempotency_key,
        request_sha256=request_sha256,
        status=_UNFINISHED,
        headers={},
        body="",
        created_at=now,
    )
    session.add(answer)
    try:
        session.flush()
    except IntegrityError:
        return None
    return answer


def drop_answer(session: Session, answer: Answer) -> None:
    """Forget one answer, so that its Idempotency-Key can be used anew in this transaction."""
    session.delete(answer)
    session.flush()


def drop_answers(session: Session, *, before: datetime) -> None:
    """Forget the answers given before an instant."""
    session.execute(delete(Answer).where(Answer.created_at < before))
