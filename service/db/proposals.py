"""Proposals to take a layer off a map, since a later scan looked through it."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from datetime import datetime
from typing import Any

from sqlalchemy import CheckConstraint, ForeignKey, Index, String, UniqueConstraint, select
from sqlalchemy.orm import Mapped, Session, mapped_column

from service.db.models import Base, Id
from service.domain.lifecycle import ProposalState

_STATES = f"IN ({', '.join(repr(str(state)) for state in ProposalState)})"


class Proposal(Base):
    """A layer that a placed scan looked through; `revision_n` is the revision that took it off."""

    __tablename__ = "proposals"
    __table_args__ = (
        CheckConstraint(f"state {_STATES}", name="state"),
        UniqueConstraint("placement_id", "layer_id"),
        Index(None, "map_id", "state", "id"),
        Index(None, "state", "id"),
    )

    id: Mapped[str] = mapped_column(Id, primary_key=True)
    map_id: Mapped[str] = mapped_column(ForeignKey("maps.id"))
    placement_id: Mapped[str] = mapped_column(ForeignKey("placements.id"))
    layer_id: Mapped[str] = mapped_column(Id)
    state: Mapped[str] = mapped_column(String(16))
    evidence: Mapped[dict[str, Any]]
    revision_n: Mapped[int | None]
    created_at: Mapped[datetime]
    decided_at: Mapped[datetime | None]
    decided_by: Mapped[str | None] = mapped_column(ForeignKey("keys.id"))


def find_proposal(session: Session, proposal_id: str, *, lock: bool = False) -> Proposal | None:
    """Return the proposal with this id, or None; with `lock` nobody else decides it meanwhile."""
    return session.get(Proposal, proposal_id, with_for_update=True if lock else None)


def find_about(session: Session, placement_id: str, *, layer_id: str) -> Proposal | None:
    """Return the proposal that a placement made about a layer, or None."""
    wanted = select(Proposal).where(Proposal.placement_id == placement_id, Proposal.layer_id == layer_id)
    return session.scalars(wanted).one_or_none()


def open_proposals(session: Session, map_id: str, *, layer_ids: Collection[str]) -> Sequence[Proposal]:
    """Return the open proposals about these layers, in the order of their making."""
    wanted = select(Proposal).where(
        Proposal.map_id == map_id,
        Proposal.state == ProposalState.OPEN.value,
        Proposal.layer_id.in_(layer_ids),
    )
    return session.scalars(wanted.order_by(Proposal.id)).all()


def list_proposals(
    session: Session,
    *,
    covered: Collection[str] | None,
    state: ProposalState | None,
    before: str | None,
    limit: int,
) -> Sequence[Proposal]:
    """Return up to `limit` proposals of these maps, newest first, with ids before `before`."""
    query = select(Proposal).order_by(Proposal.id.desc()).limit(limit)
    if covered is not None:
        query = query.where(Proposal.map_id.in_(covered))
    if state is not None:
        query = query.where(Proposal.state == state.value)
    if before is not None:
        query = query.where(Proposal.id < before)
    return session.scalars(query).all()
