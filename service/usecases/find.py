"""Find things over all maps that a key covers: for people who look for something, not for one map."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from service.db.job_lists import list_jobs
from service.db.models import Job, Placement
from service.db.narrowing import Narrowing
from service.db.placements import narrowed_placements
from service.db.revisions import narrowed_revisions
from service.db.session import Session
from service.db.uploads import DrawingRow, ScanRow, narrowed_drawing_rows, narrowed_scan_rows
from service.domain.access import Actor
from service.domain.lifecycle import Role
from service.usecases.revisions import Shown, with_layers


def find_revisions(session: Session, actor: Actor, wanted: Narrowing) -> Sequence[Shown]:
    """Return revisions of the key's maps with their layers."""
    return with_layers(session, narrowed_revisions(session, _covered(actor, wanted)))


def find_placements(session: Session, actor: Actor, wanted: Narrowing) -> Sequence[Placement]:
    """Return placements on the key's maps.

    Raises
    ------
    Forbidden
        If the key is a robot's.
    """
    actor.require_role(Role.TABLET, Role.ADMIN)
    return narrowed_placements(session, _covered(actor, wanted))


def find_drawings(session: Session, actor: Actor, wanted: Narrowing) -> Sequence[DrawingRow]:
    """Return drawings of the key's maps, each with its file and its latest job."""
    return narrowed_drawing_rows(session, _covered(actor, wanted))


def find_scans(session: Session, actor: Actor, wanted: Narrowing) -> Sequence[ScanRow]:
    """Return scans of the key's maps, each with its file and its latest job."""
    return narrowed_scan_rows(session, _covered(actor, wanted))


def find_jobs(session: Session, actor: Actor, wanted: Narrowing) -> Sequence[Job]:
    """Return jobs of the key's maps."""
    return list_jobs(session, _covered(actor, wanted))


def _covered(actor: Actor, wanted: Narrowing) -> Narrowing:
    return replace(wanted, covered=actor.map_ids)
