"""What receiving a drawing and receiving a scan have in common."""

from __future__ import annotations

from dataclasses import dataclass

from service.db.blobs import record_blob
from service.db.session import Session
from service.domain.access import Actor
from service.domain.lifecycle import Role
from service.usecases.kernel import Kernel
from service.usecases.maps import covered_map


@dataclass(frozen=True)
class ReceivedFile:
    """Hold a file whose bytes are in the blob store and whose beginning was looked at.

    Parameters
    ----------
    sha256, size_bytes
        As the store gave them.
    file_name : str
        What the sender called it; shown to people and used for nothing else.
    media_type : str
        What its own bytes say it is.
    """

    sha256: str
    size_bytes: int
    file_name: str
    media_type: str


def require_receiver(session: Session, actor: Actor, map_id: str) -> None:
    """Pass when the actor may upload to the map.

    Raises
    ------
    Forbidden
        If the actor is neither a tablet nor an admin.
    MapNotFound
        If there is no such map, or the actor's key does not cover it.
    """
    actor.require_role(Role.TABLET, Role.ADMIN)
    covered_map(session, actor, map_id=map_id)


def record_file(kernel: Kernel, session: Session, file: ReceivedFile) -> None:
    """Give the file's bytes their row, so that they stay."""
    record_blob(
        session, file.sha256, size_bytes=file.size_bytes, media_type=file.media_type, now=kernel.now()
    )
