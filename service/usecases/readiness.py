"""Tell whether everything that the service needs is there."""

from __future__ import annotations

from sqlalchemy.exc import SQLAlchemyError

from service.db.schema import is_current
from service.domain.errors import DomainError, NotReady
from service.usecases.kernel import Kernel


def require_ready(kernel: Kernel) -> dict[str, str]:
    """Return what was looked at, each "ok".

    Raises
    ------
    NotReady
        If the database or the storage cannot be used, or the schema is not this version's.
    """
    checks = {"database": "ok", "schema": "ok", "storage": "ok"}
    try:
        if not is_current(kernel.db.engine):
            checks["schema"] = "not this version's: run `groundplan migrate`"
    except SQLAlchemyError as error:
        checks["database"] = f"cannot be used ({type(error).__name__})"
        checks["schema"] = "unknown"
    try:
        with kernel.blobs.stage(max_bytes=1) as staged:
            staged.write(b"\0")
    except (OSError, DomainError) as error:
        checks["storage"] = f"cannot be written ({type(error).__name__})"
    wrong = [name for name, found in checks.items() if found != "ok"]
    if wrong:
        raise NotReady(f"Not usable: {', '.join(wrong)}.", checks=checks)
    return checks
