"""Make a new revision of a map: its row, its layers and the job that builds it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from sqlalchemy.orm import Session

from service.db import revisions as table
from service.db.jobs import enqueue
from service.db.models import Job, Layer, Placement, Revision
from service.db.placements import find_placements
from service.db.uploads import find_drawing
from service.domain.access import Actor
from service.domain.errors import (
    DrawingNotFound,
    DrawingNotRead,
    InvalidRequest,
    PlacementNotFound,
    RevisionNotFound,
    ScaleUnknown,
    StaleBase,
)
from service.domain.layer_part import LayerPart
from service.domain.lifecycle import JobKind, RevisionStatus, Role
from service.domain.recipe import Recipe
from service.usecases.kernel import Kernel
from service.usecases.maps import covered_map
from service.usecases.placements import require_acceptable
from service.usecases.revisions import Shown, require_ready


@dataclass(frozen=True)
class WantedLayer:
    """Hold a layer that a request asks for.

    Parameters
    ----------
    placement_id : str
        A finished placement of a scan of the same map.
    name : str
        What people call the layer.
    reviewed : bool
        Whether a person has looked at a placement that needs a review.
    part : LayerPart
        Which of the scan's points it holds.
    """

    placement_id: str
    name: str
    reviewed: bool = False
    part: LayerPart = field(default_factory=LayerPart)


@dataclass(frozen=True)
class Wanted:
    """Hold what a revision is asked to be; what is None comes from its base, or from nothing.

    Parameters
    ----------
    base : int, optional
        The revision that is changed; without one nothing is inherited.
    drawing_id : str, optional
        Needed without a base.
    recipe : mapping
        Fields that differ from the base's recipe, or from the defaults.
    layers : sequence of WantedLayer, optional
        All layers, in their order.
    """

    base: int | None = None
    drawing_id: str | None = None
    recipe: Mapping[str, Any] = field(default_factory=dict)
    layers: Sequence[WantedLayer] | None = None


@dataclass(frozen=True)
class Revised:
    """Hold a new revision, building, and the job that builds it."""

    shown: Shown
    job: Job


@dataclass(frozen=True)
class PlannedLayer:
    """Hold a layer as it will stand in the new revision."""

    name: str
    scan_id: str
    placement_id: str
    part: dict[str, Any] | None


@dataclass(frozen=True)
class BaseReading:
    """Hold what a revision keeps of a drawing's reading, whatever is read of the drawing later."""

    drawing_id: str
    walls_sha256: str
    scale: dict[str, Any]


def revise(kernel: Kernel, session: Session, actor: Actor, *, map_id: str, wanted: Wanted) -> Revised:
    """Return a new revision of the map, building, and its job.

    Raises
    ------
    Forbidden
        If the key is a robot's.
    MapNotFound, DrawingNotFound, PlacementNotFound, RevisionNotFound
        If something named does not exist on this map for the key.
    StaleBase
        If the base is not the map's latest revision.
    RevisionNotReady
        If the base is still building.
    DrawingNotRead
        If the drawing's reading has not finished.
    ScaleUnknown
        If the drawing's scale is not known.
    PlacementNotAcceptable
        If a layer's placement is unfinished or rejected, or needs a review that nobody did.
    InvalidRequest
        If the recipe is out of its limits, a layer is named twice, or no drawing is named at all.
    """
    actor.require_role(Role.TABLET, Role.ADMIN)
    covered_map(session, actor, map_id=map_id, lock=True)
    base = None if wanted.base is None else latest_base(session, map_id, base=wanted.base)
    if wanted.drawing_id is not None:
        reading = _reading_of(session, map_id, wanted.drawing_id)
    elif base is not None:
        reading = kept_reading(base)
    else:
        detail = "Name a drawing, or a base revision whose drawing is kept."
        raise InvalidRequest(detail, errors=[{"pointer": "#/drawing_id", "detail": detail}])
    recipe = Recipe.from_json({**(base.recipe if base else {}), **wanted.recipe})
    if wanted.layers is not None:
        layers = _plan(session, map_id, wanted.layers)
    else:
        layers = kept_layers(session, base) if base else []
    parent = base or table.latest_revision(session, map_id, status=RevisionStatus.READY)
    return add_revision(
        kernel,
        session,
        actor,
        parent=parent,
        map_id=map_id,
        reading=reading,
        recipe=recipe,
        layers=layers,
    )


def latest_base(session: Session, map_id: str, *, base: int | None) -> Revision:
    """Return the map's latest revision that did not fail, which has to be `base` if that is given.

    Raises
    ------
    RevisionNotFound
        If the map has no such revision, or none at all.
    StaleBase
        If a later one exists.
    RevisionNotReady
        If it is still building, or the base named has failed.
    """
    if base is not None:
        named = table.find_revision(session, map_id, n=base)
        if named is None:
            raise RevisionNotFound(f"The map {map_id} has no revision {base}.")
        if named.status == RevisionStatus.FAILED:
            require_ready(named)
    latest = table.latest_living_revision(session, map_id)
    if latest is None:
        raise RevisionNotFound(f"The map {map_id} has no revision yet.")
    if base is not None and base != latest.n:
        raise StaleBase(
            f"Revision {base} is no longer the latest: that is {latest.n}, {latest.status}.", latest=latest.n
        )
    require_ready(latest)
    return latest


def kept_layers(session: Session, base: Revision) -> list[PlannedLayer]:
    """Return the layers of a revision, to be taken over by another."""
    rows = table.layers_of(session, [base.id])[base.id]
    return [PlannedLayer(row.name, row.scan_id, row.placement_id, row.part) for row in rows]


def kept_reading(base: Revision) -> BaseReading:
    """Return the reading that a revision is built on, to be taken over by another."""
    return BaseReading(base.drawing_id, base.walls_sha256, base.scale)


def add_revision(
    kernel: Kernel,
    session: Session,
    actor: Actor,
    *,
    parent: Revision | None,
    map_id: str,
    reading: BaseReading,
    recipe: Recipe,
    layers: Sequence[PlannedLayer],
) -> Revised:
    """Return the new revision's rows and job, of a map that this transaction holds."""
    now = kernel.now()
    revision_id = kernel.new_id("rev")
    job = enqueue(
        session,
        JobKind.BUILD_REVISION,
        job_id=kernel.new_id("job"),
        map_id=map_id,
        subject_id=revision_id,
        now=now,
    )
    revision = Revision(
        id=revision_id,
        map_id=map_id,
        n=table.take_number(session, map_id),
        parent_n=None if parent is None else parent.n,
        status=RevisionStatus.BUILDING.value,
        recipe=recipe.to_json(),
        drawing_id=reading.drawing_id,
        walls_sha256=reading.walls_sha256,
        scale=reading.scale,
        job_id=job.id,
        created_at=now,
        created_by=actor.key_id,
    )
    rows = [
        Layer(
            id=kernel.new_id("lay"),
            revision_id=revision_id,
            position=position,
            name=layer.name,
            scan_id=layer.scan_id,
            placement_id=layer.placement_id,
            part=layer.part,
        )
        for position, layer in enumerate(layers)
    ]
    table.add_revision(session, revision, rows)
    return Revised(Shown(revision, rows), job)


def _reading_of(session: Session, map_id: str, drawing_id: str) -> BaseReading:
    drawing = find_drawing(session, drawing_id)
    if drawing is None or drawing.map_id != map_id:
        raise DrawingNotFound(f"The map {map_id} has no drawing {drawing_id}.")
    if drawing.reading is None or drawing.walls_sha256 is None:
        raise DrawingNotRead(
            f"The drawing {drawing_id} has no finished reading; its job is {drawing.job_id}.",
            job_id=drawing.job_id,
        )
    scale: dict[str, Any] = drawing.reading.get("scale", {})
    if scale.get("state", "unknown") == "unknown":
        raise ScaleUnknown(
            f"The scale of drawing {drawing_id} is not known; give it by PATCH /v1/drawings/{drawing_id}."
        )
    return BaseReading(drawing_id, drawing.walls_sha256, scale)


def _plan(session: Session, map_id: str, wanted: Sequence[WantedLayer]) -> list[PlannedLayer]:
    found = find_placements(session, [layer.placement_id for layer in wanted])
    planned: list[PlannedLayer] = []
    for position, layer in enumerate(wanted):
        placement: Placement | None = found.pop(layer.placement_id, None)
        if any(layer.placement_id == other.placement_id for other in planned):
            detail = f"The placement {layer.placement_id} is named twice."
            pointer = f"#/layers/{position}/placement_id"
            raise InvalidRequest(detail, errors=[{"pointer": pointer, "detail": detail}])
        if placement is None or placement.map_id != map_id:
            raise PlacementNotFound(f"The map {map_id} has no placement {layer.placement_id}.")
        require_acceptable(placement, reviewed=layer.reviewed)
        planned.append(PlannedLayer(layer.name, placement.scan_id, placement.id, layer.part.to_json()))
    return planned
