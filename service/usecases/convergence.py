"""How far a fleet has come: where each channel points, and what its robots run, counted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from service.db.models import Channel
from service.db.revisions import channels_of
from service.db.robots import RobotGroup, count_robots
from service.db.session import Session
from service.domain.access import Actor
from service.domain.lifecycle import Role


@dataclass(frozen=True)
class Convergence:
    """Hold the channels of maps, by map and name, and their robots, counted."""

    channels: Sequence[Channel]
    robots: Sequence[RobotGroup]


def show_convergence(session: Session, actor: Actor, *, map_id: str | None) -> Convergence:
    """Return the channels and robots of the maps that the key covers, or of one of these.

    Raises
    ------
    Forbidden
        If the key is a robot's.
    """
    actor.require_role(Role.TABLET, Role.ADMIN)
    channels = channels_of(session, covered=actor.map_ids, map_id=map_id)
    return Convergence(channels, count_robots(session, covered=actor.map_ids, map_id=map_id))
