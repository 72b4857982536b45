"""Where the frame of a drawing's reading lies in the drawing file's own coordinates."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

from service.domain.recipe import Recipe
from service.domain.transform import Transform


@dataclass(frozen=True)
class DrawingFrame:
    """Hold what takes a file's coordinates to frame `drawing`.

    Parameters
    ----------
    origin : tuple of 2 float
        What is taken off the file's coordinates [m].
    top : float or None
        Where y = 0 of the file lies in frame `drawing` [m], if its y runs downwards; None where it runs up.
    """

    origin: tuple[float, float]
    top: float | None = None

    def T_map_drawing(self, recipe: Recipe) -> Transform:
        """Return what takes the file's own coordinates [m] to frame `map`; where y runs down, -y is taken."""
        x, y = self.origin
        pose = recipe.map_from_drawing
        T_map_reading = Transform.from_xyz_yaw(pose.x_m, pose.y_m, 0.0, pose.yaw_rad)
        return T_map_reading @ Transform.from_xyz_yaw(-x, -y if self.top is None else self.top, 0.0, 0.0)

    def to_json(self) -> dict[str, Any]:
        """Return the frame by the names that a reading has for it."""
        return {"drawing_origin": list(self.origin), "drawing_top": self.top}

    @classmethod
    def of_reading(cls, value: Mapping[str, Any] | None) -> Self | None:
        """Return the frame that a reading in metres tells, or None where it does not.

        The first versions did not say whether y runs up or down: they said nothing of ``drawing_top``.
        """
        if value is None or "drawing_top" not in value or value.get("unit", "m") != "m":
            return None
        origin, top = value.get("drawing_origin"), value["drawing_top"]
        if not isinstance(origin, list | tuple) or [isinstance(x, int | float) for x in origin] != [
            True,
            True,
        ]:
            return None
        if top is not None and not isinstance(top, int | float):
            return None
        return cls((float(origin[0]), float(origin[1])), top)
