"""Robots and their reports as JSON."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Self

from pydantic import Field

from service.api.schemas.base import Identifier, Input, Output, Text
from service.api.schemas.revisions import Channel
from service.domain.lifecycle import RobotState
from service.usecases.robots import Device, Followed, Progress, Vehicle

Group = Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9-]{0,39}$")]
"""A group's name: small letters, digits and hyphens."""


_Level = Annotated[str, Field(min_length=1, max_length=100, pattern=r"^[^/+#$\x00-\x20][^/+#\x00-\x1f]*$")]
"""What can be a level of an MQTT topic."""


class VehicleIn(Input):
    """How a robot is named on an MQTT broker, where it speaks VDA 5050."""

    manufacturer: _Level
    serial_number: _Level


class RobotIn(Input):
    """A robot to be enrolled."""

    name: Text
    map_id: Identifier
    channel: Channel = "stable"
    group: Group | None = None
    vehicle: VehicleIn | None = Field(
        None, description="Its name on the MQTT broker, where it speaks VDA 5050: then it needs no client."
    )

    def device(self) -> Device:
        """Return what is to be enrolled."""
        vehicle = None if self.vehicle is None else Vehicle(**self.vehicle.model_dump())
        return Device(self.name, self.map_id, self.channel, self.group, vehicle)


class RobotChangeIn(Input):
    """What is to be another; what is left out stays."""

    name: Text | None = None
    channel: Channel | None = None
    group: Group | None = None

    def changes(self) -> dict[str, str | None]:
        """Return the fields that were sent; only the group can be taken away by null."""
        sent = self.model_dump(exclude_unset=True)
        return {name: value for name, value in sent.items() if value is not None or name == "group"}


class RobotOut(Output):
    """A robot: what it should run, what it runs, and its latest report."""

    id: str
    name: str
    map_id: str
    channel: str
    group: str | None
    manufacturer: str | None = Field(description="With `serial_number` its name on the MQTT broker.")
    serial_number: str | None
    key_id: str
    created_at: datetime
    wanted_revision: int | None = Field(description="What its channel points to.")
    enabled_revision: int | None = Field(description="What it runs, by its own word.")
    behind: bool
    progress: Progress
    state: RobotState | None = Field(description="Its latest report.")
    reported_revision: int | None
    reported_at: datetime | None
    detail: str | None
    remark: str | None = Field(
        description="What is wrong with what it says over VDA 5050; null when all is well."
    )

    @classmethod
    def of(cls, followed: Followed) -> Self:
        """Return a robot as JSON."""
        return cls(**_fields(followed))


class NewRobotOut(RobotOut):
    """A new robot with the secret of its key."""

    key: str = Field(description="The secret, to be sent as `Authorization: Bearer ...`. Kept nowhere else.")

    @classmethod
    def with_key(cls, followed: Followed, *, key: str) -> Self:
        """Return a new robot as JSON."""
        return cls(**_fields(followed), key=key)


class ReportIn(Input):
    """What a robot did with a revision."""

    revision: Annotated[int, Field(ge=1, le=2**31 - 1)]
    state: RobotState
    sha256: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")] | None = None
    detail: Annotated[str, Field(max_length=2000)] | None = None


class ReportOut(Output):
    """A report as it came."""

    id: str
    revision: int = Field(validation_alias="revision_n")
    state: RobotState
    sha256: str | None
    detail: str | None
    at: datetime


def _fields(followed: Followed) -> dict[str, object]:
    robot = followed.robot
    return {
        "id": robot.id,
        "name": robot.name,
        "map_id": robot.map_id,
        "channel": robot.channel,
        "group": robot.group_name,
        "manufacturer": robot.manufacturer,
        "serial_number": robot.serial_number,
        "key_id": robot.key_id,
        "created_at": robot.created_at,
        "wanted_revision": followed.wanted_n,
        "enabled_revision": robot.enabled_n,
        "behind": followed.is_behind,
        "progress": followed.progress,
        "state": robot.state,
        "reported_revision": robot.reported_n,
        "reported_at": robot.reported_at,
        "detail": robot.detail,
        "remark": robot.remark,
    }
