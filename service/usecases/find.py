"""Find things over all maps that a key covers: for people who look for something, not for one map."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.db.job_lists import list_jobs
from service.db.models import Drawing, Job, Placement, Revision, Scan
from service.db.narrowing import Narrowing, narrowed
from service.db.uploads import DrawingRow, ScanRow, drawing_rows, scan_rows
from service.domain.access import Actor
from service.domain.lifecycle import Role
from service.usecases.revisions import Shown, with_layers


def find_revisions(session: Session, actor: Actor, wanted: Narrowing) -> Sequence[Shown]:
    """Return revisions of the key's maps with their layers."""
    query = narrowed(select(Revision), Revision, _covered(actor, wanted), prefix="rev")
    return with_layers(session, session.scalars(query).all())


def find_placements(session: Session, actor: Actor, wanted: Narrowing) -> Sequence[Placement]:
    """Return placements on the key's maps.

    Raises
    ------
    Forbidden
        If the key is a robot's.
    """
    actor.require_role(Role.TABLET, Role.ADMIN)
    return session.scalars(
        narrowed(select(Placement), Placement, _covered(actor, wanted), prefix="plc")
    ).all()


def find_drawings(session: Session, actor: Actor, wanted: Narrowing) -> Sequence[DrawingRow]:
    """Return drawings of the key's maps, each with its file and its latest job."""
    query = narrowed(drawing_rows(), Drawing, _covered(actor, wanted), prefix="drw")
    return [(row[0], row[1], row[2]) for row in session.execute(query)]


def find_scans(session: Session, actor: Actor, wanted: Narrowing) -> Sequence[ScanRow]:
    """Return scans of the key's maps, each with its file and its latest job."""
    query = narrowed(scan_rows(), Scan, _covered(actor, wanted), prefix="scn")
    return [(row[0], row[1], row[2]) for row in session.execute(query)]


def find_jobs(session: Session, actor: Actor, wanted: Narrowing) -> Sequence[Job]:
    """Return jobs of the key's maps."""
    return list_jobs(session, _covered(actor, wanted))


def _covered(actor: Actor, wanted: Narrowing) -> Narrowing:
    return replace(wanted, covered=actor.map_ids)
