"""Generated buildings: the walls as drawn, and the building that was made after them, which deviates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from service.domain.transform import Transform
from tests.factories import wall_prism
from worker.geometry.drawing.reading.reading import Wall
from worker.geometry.lidar.scene import Scene, slab, turned_box
from worker.geometry.lidar.tablet import TabletPath, TabletScan, scan_with_tablet

DOOR, INNER, OUTER = 0.95, 0.12, 0.3
LEAST_ROOM = 2.6
Room = tuple[float, float, float, float]
FULL_TURN, THREE_WALLS, CORNER = 2.0 * np.pi, np.deg2rad(200.0), np.deg2rad(75.0)


@dataclass(frozen=True, eq=False)
class Building:
    """Hold a floor of rooms.

    Parameters
    ----------
    drawn : tuple of Wall
        As the drawing has them, in frame `map` [m].
    scene : Scene
        As built: every wall a centimetre or two from where it is drawn, with floor, ceiling, furniture.
    rooms : ndarray of shape (K, 4)
        x0, y0, x1, y1 of the rooms between their walls' centre lines [m].
    doors : ndarray of shape (D, 4)
        Middle of each door, and the unit direction through it.
    height : float
        Of the rooms [m].
    """

    drawn: tuple[Wall, ...]
    scene: Scene
    rooms: NDArray[np.float64]
    doors: NDArray[np.float64]
    height: float

    def room_at(self, place: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the room (4,) that a place (2,) lies in [m]."""
        inside = np.all((self.rooms[:, :2] < place) & (place < self.rooms[:, 2:]), axis=1)
        room: NDArray[np.float64] = self.rooms[int(np.argmax(inside))]
        return room


def a_building(seed: int, *, deviation: float = 0.01) -> Building:
    """Return a building whose floor is split into rooms at random, a door in each wall between two.

    Parameters
    ----------
    seed : int
        The same seed gives the same building.
    deviation : float
        One sigma by which a wall stands beside its drawing [m].
    """
    rng = np.random.default_rng(seed)
    size = rng.uniform((14.0, 9.0), (30.0, 18.0))
    height = float(rng.uniform(2.5, 3.2))
    lines: list[tuple[NDArray[np.float64], float]] = []
    x1, y1 = size
    for a, b in (((0, 0), (x1, 0)), ((x1, 0), (x1, y1)), ((x1, y1), (0, y1)), ((0, y1), (0, 0))):
        lines.append((np.array([a, b], dtype=np.float64), OUTER))
    rooms: list[Room] = []
    doors: list[Room] = []
    _split((0.0, 0.0, float(x1), float(y1)), rng, (lines, rooms, doors))
    drawn = tuple(Wall.of(line, thickness=thickness) for line, thickness in lines)
    parts = [
        slab((-1, -1), size + 1, z=0.0, name="floor"),
        slab((-1, -1), size + 1, z=height, name="ceiling"),
    ]
    for k, (line, thickness) in enumerate(lines):
        along = line[1] - line[0]
        aside = np.array([-along[1], along[0]]) / np.linalg.norm(along) * rng.normal(0.0, deviation)
        parts.append(
            wall_prism(*(line + aside), thickness=thickness, z_low=0.0, z_high=height, name=f"wall {k}")
        )
    for room in rooms:
        parts += _furniture(room, rng)
    return Building(drawn, Scene.of(*parts), np.array(rooms), np.array(doors).reshape(-1, 4), height)


def _split(
    room: Room,
    rng: np.random.Generator,
    into: tuple[list[tuple[NDArray[np.float64], float]], list[Room], list[Room]],
) -> None:
    """Split a room by a wall with a door, until rooms are as large as rooms are."""
    lines, rooms, doors = into
    x0, y0, x1, y1 = room
    wide, high = x1 - x0, y1 - y0
    if max(wide, high) < 2 * LEAST_ROOM or wide * high < rng.uniform(14.0, 45.0):
        rooms.append(room)
        return
    across = wide >= high
    low, long = (x0, wide) if across else (y0, high)
    at = low + float(rng.uniform(LEAST_ROOM, long - LEAST_ROOM))
    begin, end = (y0, y1) if across else (x0, x1)
    door = begin + float(rng.uniform(0.2, end - begin - DOOR - 0.2))
    middle = door + DOOR / 2
    doors.append((at, middle, 1.0, 0.0) if across else (middle, at, 0.0, 1.0))
    for a, b in ((begin, door), (door + DOOR, end)):
        ends = np.array([(at, a), (at, b)] if across else [(a, at), (b, at)])
        lines.append((ends, INNER))
    first = (x0, y0, at, y1) if across else (x0, y0, x1, at)
    second = (at, y0, x1, y1) if across else (x0, at, x1, y1)
    _split(first, rng, into)
    _split(second, rng, into)


def _furniture(room: Room, rng: np.random.Generator) -> list[Scene]:
    """Return tables and cabinets along the walls of a room."""
    low, high = np.array(room[:2]), np.array(room[2:])
    made = []
    for k in range(int(rng.integers(0, 4))):
        size = rng.uniform((0.4, 0.4, 0.6), (1.4, 0.7, 1.9))
        at = rng.uniform(low + 0.6, high - 0.6)
        side = int(rng.integers(2))
        at[side] = (low[side] + 0.45) if rng.random() < 0.5 else (high[side] - 0.45)
        made.append(
            turned_box((*at, 0.0), size, yaw=float(rng.integers(2)) * np.pi / 2, name=f"furniture {k}")
        )
    return made


def a_scan(building: Building, seed: int, *, turn: float = FULL_TURN) -> TabletScan:
    """Return a scan from a free place in one of the building's rooms, with an object that no drawing has."""
    rng = np.random.default_rng(seed)
    x0, y0, x1, y1 = building.rooms[rng.integers(len(building.rooms))]
    place = rng.uniform((x0 + 1.0, y0 + 1.0), (x1 - 1.0, y1 - 1.0))
    ahead = float(rng.uniform(-np.pi, np.pi))
    middle = np.array([(x0 + x1) / 2, (y0 + y1) / 2])
    if turn < FULL_TURN:
        to = middle if turn > CORNER else _a_corner(place, building, rng)
        ahead = float(np.arctan2(*(to - place)[::-1]))
    thing = place + 0.9 * np.array([np.cos(ahead), np.sin(ahead)])
    size = rng.uniform((0.3, 0.3, 0.6), (0.6, 0.6, 1.6))
    made = turned_box((*thing, 0.0), size, yaw=ahead, name="target")
    path = TabletPath.turning(
        place, start_yaw=ahead - turn / 2, turn=turn, frames=max(12, int(48 * turn / FULL_TURN))
    )
    return scan_with_tablet(Scene.of(building.scene, made), path, seed=seed)


def a_walk(building: Building, seed: int) -> TabletScan:
    """Return a scan by someone who looks around, walks through a door, and looks around again."""
    rng = np.random.default_rng(seed)
    x, y, u, v = building.doors[rng.integers(len(building.doors))]
    door, through = np.array([x, y]), np.array([u, v]) * rng.choice([-1.0, 1.0])
    begin, end = door - 1.2 * through, door + 1.2 * through
    ahead = float(np.arctan2(through[1], through[0]))
    path = TabletPath.turning(begin, start_yaw=ahead - FULL_TURN, frames=40)
    path = path.then(TabletPath.walking([begin, end], look_at=end + through, frames=10))
    path = path.then(TabletPath.turning(end, start_yaw=ahead, frames=40))
    return scan_with_tablet(building.scene, path, seed=seed)


def _a_corner(
    place: NDArray[np.float64], building: Building, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Return a corner (2,) of the room that a place lies in [m]."""
    x0, y0, x1, y1 = building.room_at(place)
    return np.array([(x0, x1)[rng.integers(2)], (y0, y1)[rng.integers(2)]])


def rough(truth: Transform, rng: np.random.Generator, *, metres: float, degrees: float) -> Transform:
    """Return a pose up to so far from the truth, upright, as a person would give it."""
    x, y, z = truth.translation
    away, to = rng.uniform(0.0, metres), rng.uniform(-np.pi, np.pi)
    turn = np.deg2rad(rng.uniform(-degrees, degrees))
    return Transform.from_xyz_yaw(
        float(x + away * np.cos(to)), float(y + away * np.sin(to)), float(z), float(truth.rpy[2] + turn)
    )
