"""Tell whether everything that the service needs is there."""

from __future__ import annotations

from service.db.schema import is_current
from service.db.session import SQLAlchemyError
from service.domain.errors import DomainError, NotReady, StorageFull
from service.usecases.kernel import Kernel


def require_ready(kernel: Kernel) -> dict[str, str]:
    """Return what was looked at: "ok", or what is short of it although downloads go on.

    Raises
    ------
    NotReady
        If the database or the storage cannot be used, or the schema is not this version's.
    """
    checks = {"database": "ok", "schema": "ok", "storage": "ok"}
    wrong = []
    try:
        if not is_current(kernel.db.engine):
            checks["schema"] = "not this version's: run `groundplan migrate`"
            wrong.append("schema")
    except SQLAlchemyError as error:
        checks["database"] = f"cannot be used ({type(error).__name__})"
        checks["schema"] = "unknown"
        wrong += ["database", "schema"]
    try:
        _use_storage(kernel)
    except StorageFull as full:
        checks["storage"] = f"{full.slug()}: uploads and jobs wait, downloads go on. {full.detail}"
    except (OSError, DomainError) as error:
        checks["storage"] = f"cannot be written ({type(error).__name__})"
        wrong.append("storage")
    if wrong:
        raise NotReady(f"Not usable: {', '.join(wrong)}.", checks=checks)
    return checks


def _use_storage(kernel: Kernel) -> None:
    with kernel.blobs.stage(max_bytes=1) as staged:
        staged.write(b"\0")
    kernel.room.require()
