"""Triangle scenes: what a simulated sensor looks at."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True, eq=False)
class Scene:
    """Hold a triangle mesh whose triangles know the object they belong to.

    Parameters
    ----------
    vertices : ndarray of shape (V, 3), float64
        Corner positions in the frame that the holder names [m].
    triangles : ndarray of shape (F, 3), int64
        Three indices into `vertices` a row; both sides of a triangle are seen.
    object_ids : ndarray of shape (F,), int64
        Index into `names` of the object that a triangle belongs to.
    names : tuple of str
        One name an object.

    Raises
    ------
    ValueError
        If shapes disagree, a vertex is not finite, or an index points outside.
    """

    vertices: NDArray[np.float64]
    triangles: NDArray[np.int64]
    object_ids: NDArray[np.int64]
    names: tuple[str, ...]

    def __post_init__(self) -> None:
        if self.vertices.ndim != 2 or self.vertices.shape[1] != 3 or not np.isfinite(self.vertices).all():
            msg = f"vertices are (V, 3) and finite, not {self.vertices.shape}"
            raise ValueError(msg)
        if self.triangles.ndim != 2 or self.triangles.shape[1] != 3:
            msg = f"triangles are (F, 3), not {self.triangles.shape}"
            raise ValueError(msg)
        if self.object_ids.shape != (len(self.triangles),):
            msg = f"{len(self.triangles)} triangles need as many object ids, not {self.object_ids.shape}"
            raise ValueError(msg)
        for what, index, size in (
            ("triangle", self.triangles, len(self.vertices)),
            ("object id", self.object_ids, len(self.names)),
        ):
            if index.size and not (index.min() >= 0 and index.max() < size):
                msg = f"a {what} points outside 0..{size - 1}"
                raise ValueError(msg)

    @classmethod
    def of(cls, *parts: Scene) -> Self:
        """Return one scene of all parts; objects of the same name become one object."""
        names = tuple(dict.fromkeys(name for part in parts for name in part.names))
        position = {name: i for i, name in enumerate(names)}
        starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
        return cls(
            vertices=np.concatenate([np.zeros((0, 3)), *(part.vertices for part in parts)]),
            triangles=np.concatenate(
                [
                    np.zeros((0, 3), dtype=np.int64),
                    *(part.triangles + start for part, start in zip(parts, starts, strict=False)),
                ]
            ),
            object_ids=np.concatenate(
                [
                    np.zeros(0, dtype=np.int64),
                    *(
                        np.array([position[name] for name in part.names], dtype=np.int64)[part.object_ids]
                        for part in parts
                    ),
                ]
            ),
            names=names,
        )

    def id_of(self, name: str) -> int:
        """Return the object id of `name`; ``ValueError`` if there is no such object."""
        return self.names.index(name)

    def only(self, *names: str) -> Scene:
        """Return the scene of the named objects alone, with their ids unchanged."""
        keep = np.isin(self.object_ids, [self.id_of(name) for name in names])
        return Scene(self.vertices, self.triangles[keep], self.object_ids[keep], self.names)

    def moved(self, offset: ArrayLike) -> Scene:
        """Return the scene translated by a (3,) offset [m]."""
        shifted = self.vertices + np.asarray(offset, dtype=np.float64)
        return Scene(shifted, self.triangles, self.object_ids, self.names)


def prism(outline: ArrayLike, z_low: float, z_high: float, *, name: str) -> Scene:
    """Return an upright solid over a convex outline.

    Parameters
    ----------
    outline : array of shape (K, 2), K >= 3
        Corners of a *convex* polygon in order, either way round [m].
    z_low, z_high : float
        Heights of its bottom and top faces [m].
    name : str
        Name of the object.

    Returns
    -------
    Scene
        Closed surface of 4 K - 4 triangles.

    Raises
    ------
    ValueError
        If the outline has fewer than three corners or the top is not above the bottom.
    """
    corners = np.asarray(outline, dtype=np.float64)
    count = len(corners)
    if corners.shape != (count, 2) or count < 3:
        msg = f"an outline is (K, 2) with K >= 3, not {corners.shape}"
        raise ValueError(msg)
    if not z_high > z_low:
        msg = f"the top of a prism lies above its bottom: {z_high} <= {z_low}"
        raise ValueError(msg)
    vertices = np.concatenate(
        [np.column_stack([corners, np.full(count, z)]) for z in (z_low, z_high)],
    )
    here = np.arange(count)
    after = (here + 1) % count
    fan = np.column_stack([np.zeros(count - 2, dtype=np.int64), here[1:-1], here[2:]])
    triangles = np.concatenate(
        [
            np.column_stack([here, after, after + count]),
            np.column_stack([here, after + count, here + count]),
            fan[:, ::-1],
            fan + count,
        ],
    ).astype(np.int64)
    return Scene(vertices, triangles, np.zeros(len(triangles), dtype=np.int64), (name,))


def box(low: ArrayLike, high: ArrayLike, *, name: str) -> Scene:
    """Return an axis-aligned box between two opposite (3,) corners [m]."""
    (x0, y0, z0), (x1, y1, z1) = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
    return prism([(x0, y0), (x1, y0), (x1, y1), (x0, y1)], float(z0), float(z1), name=name)


def turned_box(centre: ArrayLike, size: ArrayLike, *, yaw: float, name: str) -> Scene:
    """Return a box that stands on `centre`, turned about the vertical.

    Parameters
    ----------
    centre : array of shape (3,)
        Middle of the bottom face [m].
    size : array of shape (3,)
        Length, width and height [m].
    yaw : float
        Turn about z [rad].
    name : str
        Name of the object.
    """
    cx, cy, z = np.asarray(centre, dtype=np.float64)
    length, width, height = np.asarray(size, dtype=np.float64)
    half = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * (length / 2, width / 2)
    c, s = np.cos(yaw), np.sin(yaw)
    outline = half @ np.array([(c, s), (-s, c)]) + (cx, cy)
    return prism(outline, float(z), float(z + height), name=name)


def cylinder(centre: ArrayLike, radius: float, *, height: float, name: str, sides: int = 32) -> Scene:
    """Return an upright cylinder of `sides` flat faces that stands on the (3,) point `centre` [m]."""
    cx, cy, z = np.asarray(centre, dtype=np.float64)
    angle = np.arange(sides) * (2.0 * np.pi / sides)
    outline = np.column_stack([cx + radius * np.cos(angle), cy + radius * np.sin(angle)])
    return prism(outline, float(z), float(z + height), name=name)


def slab(low: ArrayLike, high: ArrayLike, *, z: float, name: str) -> Scene:
    """Return a horizontal rectangle without thickness between two (2,) corners [m]: a floor or ceiling."""
    (x0, y0), (x1, y1) = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
    vertices = np.array([(x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z)], dtype=np.float64)
    triangles = np.array([(0, 1, 2), (0, 2, 3)], dtype=np.int64)
    return Scene(vertices, triangles, np.zeros(2, dtype=np.int64), (name,))
