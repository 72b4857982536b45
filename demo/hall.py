"""A factory hall generated from a seed: its walls, its columns, its machines, and the whole as a 3-D scene.

One frame serves all, the sheet's: metres, x right, y up, origin at the sheet's lower left corner, z up from
the floor. A map whose drawing lies as drawn (`T_map_drawing` is the identity) has the same frame, so every
position here is the truth of frame `map` as well.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from worker.geometry.lidar.scene import Scene, box, cylinder, slab, turned_box

METRES_PER_PX = 0.02
MARGIN_LEFT, MARGIN_BOTTOM, MARGIN_RIGHT, MARGIN_TOP = 4.4, 6.0, 2.4, 2.6
OUTER, INNER, COLUMN = 0.30, 0.16, 0.40
WALL_HEIGHT, DOOR_HEIGHT = 3.6, 2.1
NEW_MACHINE = "press"


@dataclass(frozen=True)
class Rectangle:
    """Hold an axis-aligned rectangle on the floor: two opposite corners [m]."""

    x0: float
    y0: float
    x1: float
    y1: float

    @property
    def size(self) -> tuple[float, float]:
        """Return its extent along x and y [m]."""
        return self.x1 - self.x0, self.y1 - self.y0

    @property
    def centre(self) -> tuple[float, float]:
        """Return its middle [m]."""
        return (self.x0 + self.x1) / 2, (self.y0 + self.y1) / 2

    def contains(self, points: NDArray[np.float64], *, margin: float = 0.0) -> NDArray[np.bool_]:
        """Return which of (N, 2 or 3) points lie inside, up to `margin` [m] outside of its edges."""
        inside: NDArray[np.bool_] = (
            (points[:, 0] >= self.x0 - margin)
            & (points[:, 0] <= self.x1 + margin)
            & (points[:, 1] >= self.y0 - margin)
            & (points[:, 1] <= self.y1 + margin)
        )
        return inside


@dataclass(frozen=True)
class Door:
    """Hold an opening in a straight wall: the rectangle it cuts out, and whether it lies along x."""

    opening: Rectangle
    along_x: bool


@dataclass(frozen=True)
class Room:
    """Hold a room's name as lettered on the drawing, and its floor between the wall faces."""

    name: str
    floor: Rectangle


@dataclass(frozen=True)
class Machine:
    """Hold a machine: where it stands, how it is turned, how large it is, and whether the drawing shows it.

    Parameters
    ----------
    name : str
        Name of its object in the scene.
    x, y, yaw : float
        Middle of its base [m], and its turn about z [rad].
    length, width, height : float
        Its extent [m].
    """

    name: str
    x: float
    y: float
    yaw: float
    length: float
    width: float
    height: float

    def scene(self) -> Scene:
        """Return its surface: a bed, a tower upon it, a cabinet beside, a tank on top."""
        along = np.array([np.cos(self.yaw), np.sin(self.yaw)])
        tower = np.array([self.x, self.y]) - along * self.length * 0.18
        cabinet = np.array([self.x, self.y]) + along * self.length * 0.35
        bed, rest = self.height * 0.4, self.height * 0.6
        tower_size = (self.length * 0.5, self.width * 0.8, rest)
        cabinet_size = (self.length * 0.2, self.width * 0.6, rest * 0.7)
        base = (self.x, self.y, 0.0)
        return Scene.of(
            turned_box(base, (self.length, self.width, bed), yaw=self.yaw, name=self.name),
            turned_box((*tower, bed), tower_size, yaw=self.yaw, name=self.name),
            turned_box((*cabinet, bed), cabinet_size, yaw=self.yaw, name=self.name),
            cylinder((*tower, self.height), self.width * 0.25, height=0.3, name=self.name),
        )

    def holds(self, points: NDArray[np.float64], *, margin: float) -> NDArray[np.bool_]:
        """Return which of (N, 3) points stand above its base, `margin` [m] around it, clear of the floor."""
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        local = (points[:, :2] - (self.x, self.y)) @ np.array([(c, -s), (s, c)])
        inside: NDArray[np.bool_] = (
            (np.abs(local[:, 0]) <= self.length / 2 + margin)
            & (np.abs(local[:, 1]) <= self.width / 2 + margin)
            & (points[:, 2] > 0.15)
            & (points[:, 2] < self.height + 0.3 + margin)
        )
        return inside


@dataclass(frozen=True)
class Hall:
    """Hold a hall: what the drawing shows (walls, doors, columns, rooms) and what it lacks (machines).

    Parameters
    ----------
    seed : int
        What it was made from.
    outline : Rectangle
        Outer faces of the outer walls.
    walls, columns : tuple of Rectangle
        Solid parts; doors are already cut out of the walls.
    doors : tuple of Door
        The openings.
    rooms : tuple of Room
        Named floors.
    machines : tuple of Machine
        None is on the drawing; the one called `NEW_MACHINE` is the one that gets scanned.
    """

    seed: int
    outline: Rectangle
    walls: tuple[Rectangle, ...]
    columns: tuple[Rectangle, ...]
    doors: tuple[Door, ...]
    rooms: tuple[Room, ...]
    machines: tuple[Machine, ...]

    @property
    def sheet_size(self) -> tuple[float, float]:
        """Return width and height of the sheet [m] on the drawing's own scale."""
        return self.outline.x1 + MARGIN_RIGHT, self.outline.y1 + MARGIN_TOP

    @property
    def new_machine(self) -> Machine:
        """Return the machine that the tablet scans."""
        return next(machine for machine in self.machines if machine.name == NEW_MACHINE)

    @property
    def shop(self) -> Room:
        """Return the room in which the new machine stands."""
        return self.rooms[0]

    @cached_property
    def scene(self) -> Scene:
        """Return the hall in 3-D: floor, walls with lintels above their doors, columns, machines."""
        o = self.outline
        return Scene.of(
            slab((o.x0 - 6, o.y0 - 6), (o.x1 + 6, o.y1 + 6), z=0.0, name="floor"),
            *(_solid(wall, 0.0, "wall") for wall in self.walls),
            *(_solid(door.opening, DOOR_HEIGHT, "wall") for door in self.doors),
            *(_solid(column, 0.0, "column") for column in self.columns),
            *(machine.scene() for machine in self.machines),
        )


def synthetic_hall(seed: int) -> Hall:
    """Return the hall of a seed: 24-28 m by 15-18 m, a shop and an office in the west, a bay in the east.

    All wall faces lie on whole pixels of `METRES_PER_PX`, so the drawing is exact.
    """
    rng = np.random.default_rng(seed)
    width, depth = float(rng.integers(48, 57)) / 2, float(rng.integers(30, 37)) / 2
    outline = Rectangle(MARGIN_LEFT, MARGIN_BOTTOM, MARGIN_LEFT + width, MARGIN_BOTTOM + depth)
    inside = Rectangle(outline.x0 + OUTER, outline.y0 + OUTER, outline.x1 - OUTER, outline.y1 - OUTER)
    split_x = inside.x0 + float(rng.integers(14, 18)) / 2
    split_y = inside.y0 + float(rng.integers(12, 16)) / 2
    store_x, store_y = inside.x1 - float(rng.integers(8, 11)) / 2, inside.y1 - float(rng.integers(6, 9)) / 2
    runs = [
        *_outer_runs(outline),
        (
            _upright(split_x, inside.y0, inside.y1),
            (_at(rng, inside.y0, split_y), _at(rng, split_y, inside.y1)),
        ),
        (_lying(split_y, inside.x0, split_x), (_at(rng, inside.x0, split_x),)),
        (_upright(store_x, store_y, inside.y1), ()),
        (_lying(store_y, store_x, inside.x1), (_at(rng, store_x, inside.x1),)),
    ]
    cut = [_cut(run, openings) for run, openings in runs]
    shop = Room("PRESS SHOP", Rectangle(inside.x0, inside.y0, split_x, split_y))
    bay = Room("ASSEMBLY BAY", Rectangle(split_x + INNER, inside.y0, inside.x1, store_y))
    rooms = (
        shop,
        Room("OFFICE", Rectangle(inside.x0, split_y + INNER, split_x, inside.y1)),
        bay,
        Room("STORE", Rectangle(store_x + INNER, store_y + INNER, inside.x1, inside.y1)),
    )
    return Hall(
        seed=seed,
        outline=outline,
        walls=tuple(wall for walls, _ in cut for wall in walls),
        columns=_columns(bay.floor),
        doors=tuple(door for _, doors in cut for door in doors),
        rooms=rooms,
        machines=(_press(shop.floor, rng), *_others(bay.floor, rng)),
    )


def _solid(outline: Rectangle, z_low: float, name: str) -> Scene:
    return box((outline.x0, outline.y0, z_low), (outline.x1, outline.y1, WALL_HEIGHT), name=name)


def _upright(x: float, y0: float, y1: float) -> Rectangle:
    return Rectangle(x, y0, x + INNER, y1)


def _lying(y: float, x0: float, x1: float) -> Rectangle:
    return Rectangle(x0, y, x1, y + INNER)


def _at(rng: np.random.Generator, low: float, high: float) -> tuple[float, float]:
    """Return start and width of a door between two walls, 0.6 m clear of both, on whole pixels [m]."""
    width = float(rng.choice([0.9, 1.0, 1.2]))
    start = low + 0.6 + float(rng.uniform(0.0, high - low - 1.2 - width))
    return round(start / METRES_PER_PX) * METRES_PER_PX, width


def _outer_runs(o: Rectangle) -> list[tuple[Rectangle, tuple[tuple[float, float], ...]]]:
    gate = (round((o.x1 - 7.0) / METRES_PER_PX) * METRES_PER_PX, 3.0)
    return [
        (Rectangle(o.x0, o.y0, o.x1, o.y0 + OUTER), (gate,)),
        (Rectangle(o.x0, o.y1 - OUTER, o.x1, o.y1), ()),
        (Rectangle(o.x0, o.y0 + OUTER, o.x0 + OUTER, o.y1 - OUTER), ()),
        (Rectangle(o.x1 - OUTER, o.y0 + OUTER, o.x1, o.y1 - OUTER), ()),
    ]


def _cut(
    run: Rectangle,
    openings: tuple[tuple[float, float], ...],
) -> tuple[list[Rectangle], list[Door]]:
    """Return what is left of a straight wall when doors (start, width) are cut out, and the doors."""
    along_x = run.size[0] > run.size[1]
    here, end = (run.x0, run.x1) if along_x else (run.y0, run.y1)
    walls, doors = [], []
    for start, width in sorted(openings):
        walls.append(_part(run, here, start, along_x=along_x))
        doors.append(Door(_part(run, start, start + width, along_x=along_x), along_x))
        here = start + width
    walls.append(_part(run, here, end, along_x=along_x))
    return walls, doors


def _part(run: Rectangle, start: float, end: float, *, along_x: bool) -> Rectangle:
    if along_x:
        return Rectangle(start, run.y0, end, run.y1)
    return Rectangle(run.x0, start, run.x1, end)


def _columns(bay: Rectangle) -> tuple[Rectangle, ...]:
    """Return two rows of square columns at even bays of about 5 m."""
    count = max(2, round(bay.size[0] / 5.0))
    xs = np.linspace(bay.x0, bay.x1, count + 2)[1:-1]
    ys = np.linspace(bay.y0, bay.y1, 4)[1:-1]
    low = [
        (round(x / METRES_PER_PX) * METRES_PER_PX, round(y / METRES_PER_PX) * METRES_PER_PX)
        for x in xs
        for y in ys
    ]
    return tuple(Rectangle(x, y, x + COLUMN, y + COLUMN) for x, y in low)


def _press(shop: Rectangle, rng: np.random.Generator) -> Machine:
    """Return the new machine: about in the middle of the shop, at an odd angle."""
    x, y = np.array(shop.centre) + rng.uniform(-0.6, 0.6, 2)
    length, width, height = rng.uniform((1.8, 1.0, 1.5), (2.4, 1.4, 2.0))
    return Machine(NEW_MACHINE, float(x), float(y), float(rng.uniform(-np.pi, np.pi)), length, width, height)


def _others(bay: Rectangle, rng: np.random.Generator) -> tuple[Machine, ...]:
    """Return machines of the bay, one in each of three strips, which no drawing and no scan shows."""
    strips = np.linspace(bay.x0, bay.x1, 4)
    machines = []
    for number, (x0, x1) in enumerate(pairwise(strips), start=1):
        length, width, height = rng.uniform((1.4, 0.8, 1.2), (2.2, 1.3, 2.2))
        x, y = (x0 + x1) / 2, bay.centre[1] + 0.2 + rng.uniform(-0.1, 0.1)
        yaw = float(rng.choice([0.0, np.pi / 2])) + float(rng.normal(0.0, 0.05))
        machines.append(Machine(f"machine-{number}", float(x), float(y), yaw, length, width, height))
    return tuple(machines)
