"""As what each entity of a vector drawing is taken: by its class, its layer's name, or a person's choice."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from service.domain.errors import InvalidRequest
from service.domain.findings import Finding
from worker.geometry.drawing.linework.layer_names import role_of
from worker.geometry.drawing.linework.linework import Linework

CLASSES = frozenset({"wall", "column", "door", "window", "stair", "slab", "space", "furniture"})
"""Kinds of entity that a building model gives, and no drawing program."""

UNTOLD = "Its name says nothing."
"""The reason of a layer whose name tells no role."""

_LEAST_WALL_LENGTH = 1.5
_MOST_NAMES = 20
_KIND_ROLES = {"dimension": "dimension", "leader": "dimension"}


@dataclass(frozen=True, eq=False)
class Roles:
    """Hold a role for each of L layers and E entities.

    Parameters
    ----------
    layer_role : tuple of str
        Role of each layer; ``other`` where nothing speaks.
    layer_reason : tuple of str
        What decided, as a sentence.
    entity : ndarray of shape (E,), str
        Role of each entity: its layer's, unless its own kind says more.
    walls_known : bool
        Whether a person, a class or a name told which entities are walls.
    findings : tuple of Finding
        Layers that were asked for and are not there.
    """

    layer_role: tuple[str, ...]
    layer_reason: tuple[str, ...]
    entity: NDArray[np.str_]
    walls_known: bool
    findings: tuple[Finding, ...] = ()

    def with_walls(self, walls: NDArray[np.bool_], layers: dict[int, str]) -> Roles:
        """Return the roles with other wall entities and (by layer number) reasons, found by geometry."""
        entity = self.entity.copy()
        entity[entity == "wall"] = "other"
        entity[walls] = "wall"
        role = tuple("wall" if n in layers else r for n, r in enumerate(self.layer_role))
        reason = tuple(layers.get(n, r) for n, r in enumerate(self.layer_reason))
        return replace(self, entity=entity, layer_role=role, layer_reason=reason)


def entity_lengths(linework: Linework) -> NDArray[np.float64]:
    """Return the length of each of the E entities [drawing units]."""
    step = linework.ends[:, 1] - linework.ends[:, 0]
    length = np.hypot(step[:, 0], step[:, 1])
    lengths = np.bincount(linework.entity, weights=length, minlength=len(linework.kind))
    return np.asarray(lengths, dtype=np.float64)


def assign_roles(linework: Linework, *, wall_layers: Sequence[str] | None) -> Roles:
    """Return as what each layer and entity is taken.

    A person's choice of wall layers wins; then classes of a building model; then the layers' names, where
    those that say wall hold enough lines to be a building's.

    Raises
    ------
    InvalidRequest
        If wall layers were chosen and none of them is in the file.
    """
    if wall_layers is not None:
        return _chosen(linework, wall_layers)
    by_class = np.isin(linework.kind, list(CLASSES))
    roles = [role_of(name) for name in linework.layer_names]
    names = [r.role if r is not None else "other" for r in roles]
    reasons = [r.reason if r is not None else UNTOLD for r in roles]
    entity = _entities(linework, names)
    if by_class.any():
        entity[by_class] = np.where(
            np.isin(linework.kind[by_class], ["slab", "space"]), "other", linework.kind[by_class]
        )
        known = bool((entity == "wall").any())
        return Roles(tuple(names), tuple(reasons), entity, known)
    walls = entity == "wall"
    length = entity_lengths(linework)
    extent = _extent(linework)
    known = float(length[walls].sum()) >= _LEAST_WALL_LENGTH * extent or bool(
        (walls & linework.filled).sum() > 3
    )
    return Roles(tuple(names), tuple(reasons), entity, known)


def _extent(linework: Linework) -> float:
    """Return the longer side of what is named walls [drawing units], or infinity where there is nothing."""
    roles = np.array([getattr(role_of(n), "role", "") for n in linework.layer_names] or [""])
    if not len(linework.ends):
        return np.inf
    of = roles[linework.layer[linework.entity]] == "wall"
    points = linework.ends[of].reshape(-1, 2)
    return float(np.ptp(points, axis=0).max()) if len(points) else np.inf


def _entities(linework: Linework, names: Sequence[str]) -> NDArray[np.str_]:
    """Return the role of each entity by its layer's name and its own kind."""
    if not len(linework.kind):
        return np.zeros(0, dtype="<U12")
    entity = np.array(list(names) or ["other"], dtype="<U12")[linework.layer]
    for kind, role in _KIND_ROLES.items():
        entity[linework.kind == kind] = role
    entity[(linework.kind == "hatch") & ~linework.filled] = "hatch"
    return entity


def _chosen(linework: Linework, wall_layers: Sequence[str]) -> Roles:
    wanted = {name.casefold() for name in wall_layers}
    present = {name.casefold() for name in linework.layer_names}
    missing = [name for name in wall_layers if name.casefold() not in present]
    if not wanted & present:
        shown = ", ".join(repr(n) for n in linework.layer_names[:_MOST_NAMES])
        detail = f"None of the chosen wall layers is in the file. Its layers are: {shown or 'none'}."
        raise InvalidRequest(detail, errors=[{"pointer": "#/wall_layers", "detail": detail}])
    names, reasons = [], []
    for name in linework.layer_names:
        told = role_of(name)
        if name.casefold() in wanted:
            column = told is not None and told.role == "column"
            names.append("column-kept" if column else "wall")
            reasons.append("A person chose it.")
        elif told is None or told.role == "wall":
            names.append("other")
            reasons.append("A person chose other layers for the walls.")
        else:
            names.append(told.role)
            reasons.append(told.reason)
    entity = _entities(linework, names)
    shown_names = ["column" if n == "column-kept" else n for n in names]
    findings = [
        Finding(
            "wall-layer-missing",
            "warning",
            f"The file has no layer {name!r}, which was chosen for the walls.",
            {"layer": name},
        )
        for name in missing[:_MOST_NAMES]
    ]
    return Roles(tuple(shown_names), tuple(reasons), entity, walls_known=True, findings=tuple(findings))
