"""Read what a revision is made of from its rows, and write it to rows."""

from __future__ import annotations

from typing import Any

from service.db import revisions as table
from service.db.models import Layer, Placement, Revision
from service.db.placements import find_placements
from service.db.session import Session
from service.db.uploads import find_drawing
from service.domain.drawing_frame import DrawingFrame
from service.domain.errors import DrawingNotFound, DrawingNotRead, ScaleUnknown
from service.domain.map_state import BaseReading, ErasedRegion, LayerState, MapState, Taken, pose_of
from service.domain.recipe import Recipe
from service.usecases.kernel import Kernel


def state_of(session: Session, revision: Revision) -> MapState:
    """Return what a revision is made of."""
    rows = table.layers_of(session, [revision.id])[revision.id]
    unmoved = find_placements(session, [row.placement_id for row in rows if row.T_map_scan is None])
    return MapState(
        reading=BaseReading(
            revision.drawing_id,
            revision.walls_sha256,
            revision.scale,
            DrawingFrame.of_reading(revision.drawing_frame),
        ),
        recipe=Recipe.from_json(revision.recipe),
        layers=tuple(_layer_state(row, unmoved.get(row.placement_id)) for row in rows),
        erased=erased_of(revision),
    )


def erased_of(revision: Revision) -> tuple[ErasedRegion, ...]:
    """Return a revision's erased regions."""
    return tuple(ErasedRegion.from_json(one) for one in revision.erased or ())


def layer_rows(kernel: Kernel, revision_id: str, state: MapState, *, made: Taken) -> list[Layer]:
    """Return the rows of a state's layers, to be added with their revision.

    A layer that no revision held before was taken in by whoever makes this one.
    """
    return [
        Layer(
            id=kernel.new_id("lay"),
            layer_id=layer.layer_id,
            revision_id=revision_id,
            position=position,
            name=layer.name,
            scan_id=layer.scan_id,
            placement_id=layer.placement_id,
            part=layer.part,
            visible=layer.visible,
            T_map_scan=[list(row) for row in layer.T_map_scan],
            accepted_by=(layer.taken or made).by,
            accepted_at=(layer.taken or made).at,
        )
        for position, layer in enumerate(state.layers)
    ]


def reading_of(session: Session, map_id: str, drawing_id: str) -> BaseReading:
    """Return the present reading of a drawing, for a revision to be built on.

    Raises
    ------
    DrawingNotFound
        If the map has no such drawing.
    DrawingNotRead
        If its reading has not finished.
    ScaleUnknown
        If its scale is not known.
    """
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
    frame = DrawingFrame.of_reading(drawing.reading)
    return BaseReading(drawing_id, drawing.walls_sha256, scale, frame)


def _layer_state(row: Layer, placement: Placement | None) -> LayerState:
    rows = row.T_map_scan
    if rows is None:
        assert placement is not None
        rows = placement.T_map_scan
    return LayerState(
        layer_id=row.layer_id,
        name=row.name,
        scan_id=row.scan_id,
        placement_id=row.placement_id,
        part=row.part,
        T_map_scan=pose_of(rows),
        visible=row.visible,
        taken=None
        if row.accepted_by is None or row.accepted_at is None
        else Taken(row.accepted_by, row.accepted_at),
    )
