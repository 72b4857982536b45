"""The audit log: every change, with who made it and what it changed, in the change's own transaction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from service.db.audit import AuditEntry, AuditFilter, add_entry
from service.db.audit import list_entries as listed
from service.db.session import Session
from service.domain.access import Actor
from service.domain.lifecycle import Role
from service.usecases.kernel import Kernel


def record(
    kernel: Kernel,
    session: Session,
    actor: Actor | None,
    *,
    action: str,
    subject_id: str,
    map_id: str | None = None,
    before: Mapping[str, Any] | None = None,
    after: Mapping[str, Any] | None = None,
) -> None:
    """Write down a change, in its transaction: there is no change without its entry, and none beside it.

    Parameters
    ----------
    actor : Actor or None
        Who did it; None is the product itself.
    action : str
        What was done, in the words of the API: `publish`, `revoke-key`.
    subject_id : str
        What it was done to.
    before, after : mapping, optional
        What the subject was and is, as far as it changed; never a secret.
    """
    entry = AuditEntry(
        id=kernel.new_id("aud"),
        at=kernel.now(),
        key_id=None if actor is None else actor.key_id,
        action=action,
        map_id=map_id,
        subject_id=subject_id,
        before=None if before is None else dict(before),
        after=None if after is None else dict(after),
    )
    add_entry(session, entry)


def list_entries(
    session: Session, actor: Actor, wanted: AuditFilter, *, before: str | None, limit: int
) -> Sequence[AuditEntry]:
    """Return up to `limit` entries that the key may see, newest first, with ids before `before`.

    A key of some maps sees what happened to these, and nothing of keys or of the service.

    Raises
    ------
    Forbidden
        If the actor is no admin.
    """
    actor.require_role(Role.ADMIN)
    return listed(session, replace(wanted, covered=actor.map_ids), before=before, limit=limit)
