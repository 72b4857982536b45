"""Tell whether everything that the service needs is there."""

from __future__ import annotations

from service.db.schema import SchemaNotCurrent, require_schema
from service.db.session import SQLAlchemyError
from service.domain.errors import DomainError, NotReady, StorageFull
from service.usecases.kernel import Kernel


def why_not_started(kernel: Kernel) -> str | None:
    """Return the sentence with which a worker or a bridge refuses to start on this database, else None."""
    try:
        require_schema(kernel.db.engine)
    except SchemaNotCurrent as error:
        return str(error)
    except SQLAlchemyError as error:
        shown = kernel.db.engine.url.render_as_string(hide_password=True)
        return f"the database {shown} cannot be used: {str(error).splitlines()[0]}"
    return None


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
        require_schema(kernel.db.engine)
    except SchemaNotCurrent as error:
        checks["schema"] = f"not this version's: the database {error.what}"
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
