"""The audit log: who changed what."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Depends, Query
from pydantic import AwareDatetime

from service.api.auth import AdminActor
from service.api.deps import KernelDep
from service.api.paging import PagingDep
from service.api.schemas.audit import AuditEntryOut
from service.api.schemas.base import Identifier, Page
from service.db.audit import AuditFilter
from service.usecases import audit

router = APIRouter(prefix="/v1/audit", tags=["audit"])

Action = Annotated[str, Query(pattern=r"^[a-z][a-z-]{0,39}$", description="Only this kind of change.")]


def _wanted(
    map_id: Annotated[Identifier | None, Query(alias="map", description="Only of this map.")] = None,
    key: Annotated[Identifier | None, Query(description="Only by this key.")] = None,
    action: Action | None = None,
    subject: Annotated[Identifier | None, Query(description="Only about this thing.")] = None,
    since: Annotated[AwareDatetime | None, Query(description="Only from this instant on.")] = None,
    until: Annotated[AwareDatetime | None, Query(description="Only before this instant.")] = None,
) -> AuditFilter:
    return AuditFilter(map_id=map_id, key_id=key, action=action, subject_id=subject, since=since, until=until)


@router.get("", response_model=Page[AuditEntryOut])
def list_entries(
    kernel: KernelDep,
    actor: AdminActor,
    paging: PagingDep,
    wanted: Annotated[AuditFilter, Depends(_wanted)],
) -> Page[AuditEntryOut]:
    """List every change, newest first: who, what, from, before and after.

    An admin key of some maps sees the changes of these. Needs an admin key.
    """
    with kernel.db.reading() as session:
        rows = audit.list_entries(session, actor, wanted, before=paging.after_id(), limit=paging.limit + 1)
        return Page[AuditEntryOut](
            **paging.page(rows, key=lambda row: row.id, show=AuditEntryOut.model_validate)
        )
