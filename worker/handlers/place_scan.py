"""Place a scan on a revision (paper, section 2.3, steps 3 and 4): its pose, the evidence, and a verdict."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from service.db.models import Placement, Scan
from service.db.revisions import find_artifact, find_revision
from service.domain.acceptance import judge
from service.domain.errors import RevisionNotReady
from service.domain.gone import GoneLayer, GoneThing
from service.domain.recipe import Recipe
from service.domain.rough_pose import RoughPose
from service.domain.transform import Transform
from service.usecases.record_placement import PlacementResult, record_placement
from worker.context import JobContext, LayerSource, ScanSource
from worker.formats.reading import load_walls_and_columns
from worker.geometry.cloud.free_space import Sight, things_of
from worker.geometry.cloud.merge import PlacedLayer
from worker.geometry.registration.place_upright import place_upright_scan
from worker.geometry.registration.structure import find_viewpoint
from worker.geometry.registration.target import PlacementTarget
from worker.geometry.scan.upright import UprightScan

_ALL = 0.8
"""From this share of its points on, a layer that has gone is taken off whole."""


@dataclass(frozen=True)
class _Asked:
    """Hold what a placement job is asked, as its rows say."""

    scan: ScanSource
    initial: Transform | None
    ndt_resolution_m: float
    revision_id: str
    recipe: Recipe
    walls_sha256: str


def place_scan(context: JobContext) -> None:
    """Place the scan and record where, how well it fits, and the verdict.

    1. look up the scan, the revision and the rough pose, if there is one
    2. load the scan as its job has read it; load the revision's wall faces, and the layers of other scans
    3. match the scan to them
    4. judge the evidence; a rejected placement is a result as well; see which layers have gone since
    5. keep the labels as a blob
    6. record the placement with the end of the job
    """
    asked = _asked(context)
    context.progress("load", 0.0)
    scan = context.load_scan(asked.scan)
    others = _others(context, asked)
    placed = place_upright_scan(
        scan,
        _target(context, asked, list(others.values())),
        initial=asked.initial,
        ndt_resolution=asked.ndt_resolution_m,
        progress=lambda stage, share: context.progress(stage, 0.1 + 0.8 * share),
    )
    labels = context.folder("placement") / "labels.npy"
    np.save(labels, placed.labels)
    files = {labels.name: context.kernel.blobs.adopt(labels)}
    gone = _gone(scan, placed.T_map_scan, others, top=asked.recipe.wall_height_m)
    result = PlacementResult(
        T_map_scan=placed.T_map_scan,
        judgement=judge(placed.evidence),
        evidence=replace(placed.evidence, gone=gone),
        candidates=placed.candidates,
    )
    with context.kernel.db.writing("record-placement") as session:
        record_placement(context.kernel, session, context.attempt, result=result, files=files)


def _asked(context: JobContext) -> _Asked:
    with context.kernel.db.reading() as session:
        placement = session.get_one(Placement, context.attempt.subject_id)
        scan = session.get_one(Scan, placement.scan_id)
        revision = find_revision(session, placement.map_id, n=placement.revision_n)
        assert revision is not None
        walls = find_artifact(session, revision.id, path="walls.geojson")
        if walls is None:
            raise RevisionNotReady(f"Revision {revision.n} is {revision.status}.", status=revision.status)
        return _Asked(
            scan=ScanSource.of(scan),
            initial=_initial(placement.initial_pose),
            ndt_resolution_m=placement.ndt_resolution_m,
            revision_id=revision.id,
            recipe=Recipe.from_json(revision.recipe),
            walls_sha256=walls.sha256,
        )


def _initial(pose: dict[str, Any] | None) -> Transform | None:
    return None if pose is None else RoughPose.from_json(pose).transform()


def _others(context: JobContext, asked: _Asked) -> dict[LayerSource, PlacedLayer]:
    """Return the revision's layers without the scan itself: it would find its own earlier place."""
    sources = context.layer_sources(asked.revision_id)
    return {one: context.load_layer(one) for one in sources if one.scan.id != asked.scan.id}


def _gone(
    scan: UprightScan, T_map_scan: Transform, others: Mapping[LayerSource, PlacedLayer], *, top: float
) -> tuple[GoneLayer, ...]:
    """Return the things of each layer that the placed scan looked through: they seem to have gone."""
    if not others:
        return ()
    kept = scan.scan.points[~scan.outliers]
    sight = Sight(T_map_scan.apply(kept), T_map_scan.apply(find_viewpoint(kept)[None])[0])
    told = []
    for source, layer in others.items():
        seen = [(thing, sight.of(thing.points)) for thing in things_of(layer.cloud.points, top=top)]
        things = tuple(
            GoneThing(thing.region, it.points, it.still_seen, it.looked_through)
            for thing, it in seen
            if it.is_gone
        )
        if things:
            whole = sum(thing.points for thing in things) >= _ALL * len(layer.cloud)
            told.append(GoneLayer(source.layer_id, source.name, whole, things))
    return tuple(told)


def _target(context: JobContext, asked: _Asked, others: Sequence[PlacedLayer]) -> PlacementTarget:
    """Return the revision to place on: its walls, and the layers of other scans."""
    path = context.kernel.blobs.path(asked.walls_sha256)
    walls, columns = load_walls_and_columns(path, bounds=context.bounds)
    points = [layer.cloud.points for layer in others]
    return PlacementTarget.from_faces(
        walls,
        columns,
        wall_height=asked.recipe.wall_height_m,
        ceiling=asked.recipe.ceiling,
        layers=np.vstack(points) if points else None,
    )
