"""Create, find, list and rename maps."""

from __future__ import annotations

from collections.abc import Sequence

from service.db import maps as table
from service.db.models import Map
from service.db.session import Session
from service.domain.access import Actor
from service.domain.errors import MapNameTaken, MapNotFound
from service.domain.lifecycle import Role
from service.usecases.audit import record
from service.usecases.kernel import Kernel


def create_map(kernel: Kernel, session: Session, actor: Actor, *, site: str, name: str) -> Map:
    """Return a new map.

    Raises
    ------
    Forbidden
        If `actor` is no admin of all maps.
    MapNameTaken
        If the site has a map of this name.
    """
    actor.require_role(Role.ADMIN)
    actor.require_all_maps()
    now = kernel.now()
    row = Map(id=kernel.new_id("map"), site=site, name=name, created_at=now, updated_at=now, next_revision=1)
    if not table.add_map(session, row):
        raise _taken(site, name)
    named = {"site": site, "name": name}
    record(kernel, session, actor, action="create-map", subject_id=row.id, map_id=row.id, after=named)
    return row


def covered_map(session: Session, actor: Actor, *, map_id: str, lock: bool = False) -> Map:
    """Return a map that exists and that the key covers; with `lock` nobody else changes it meanwhile.

    Raises
    ------
    MapNotFound
        If there is no such map, or the key does not cover it: the two cannot be told apart.
    """
    missing = MapNotFound(f"There is no map {map_id}, or this key does not cover it.")
    actor.require_map(map_id, otherwise=missing)
    row = table.find_map(session, map_id, lock=lock)
    if row is None:
        raise missing
    return row


def list_maps(
    session: Session,
    actor: Actor,
    *,
    site: str | None,
    text: str | None,
    after: str | None,
    limit: int,
) -> Sequence[Map]:
    """Return up to `limit` maps that the key covers, in the order of their making."""
    return table.list_maps(session, covered=actor.map_ids, site=site, text=text, after=after, limit=limit)


def change_map(
    kernel: Kernel, session: Session, actor: Actor, *, map_id: str, site: str | None, name: str | None
) -> Map:
    """Return the map with its new site or name.

    Raises
    ------
    Forbidden
        If `actor` is no admin.
    MapNotFound
        If there is no such map for the key.
    MapNameTaken
        If the site has another map of this name.
    """
    actor.require_role(Role.ADMIN)
    row = covered_map(session, actor, map_id=map_id, lock=True)
    site, name = site or row.site, name or row.name
    before, after = {"site": row.site, "name": row.name}, {"site": site, "name": name}
    if not table.rename_map(session, row, site=site, name=name, now=kernel.now()):
        raise _taken(site, name)
    record(
        kernel,
        session,
        actor,
        action="change-map",
        subject_id=map_id,
        map_id=map_id,
        before=before,
        after=after,
    )
    return row


def _taken(site: str, name: str) -> MapNameTaken:
    return MapNameTaken(f"The site {site!r} already has a map called {name!r}; take another name.")
