"""What vehicles send, as far as it is read here: the published schemas of VDA 5050 as strict models.

Notes
-----
After `state.schema` and `connection.schema` of versions 2.1.0 and 3.0.0 (github.com/VDA5050/VDA5050): types,
values and what is required are theirs, for the fields that are read; fields that are not read may be
anything. An optional field may also be null, which serializers write for what is absent. The published
schemas bound nothing; here a whole message is bounded by `LARGEST_BYTES`, and with it all that it holds.
"""

from __future__ import annotations

from typing import Annotated, Literal, Self, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator
from pydantic.alias_generators import to_camel

LARGEST_BYTES = 1 << 20
"""Longest message that is read [bytes]: a state of 1,000 nodes, edges and actions takes about a third."""

LONGEST_VERSION = 100
"""Longest protocol version [characters]: it is written into each answer; the published form is `3.0.0`."""

_LAST_WITHOUT_INSTANT_STATES = 2

Read = TypeVar("Read", bound="_Model")

ActionStatus = Literal["WAITING", "INITIALIZING", "RUNNING", "PAUSED", "RETRIABLE", "FINISHED", "FAILED"]


class NoState(ValueError):
    """The message is not what the published schema says; its sentence tells where."""


class _Model(BaseModel):
    model_config = ConfigDict(strict=True, frozen=True, alias_generator=to_camel)


class MapEntry(_Model):
    """A version of a map that a vehicle has."""

    map_id: str
    map_version: str
    map_status: Literal["ENABLED", "DISABLED"]


class ActionEntry(_Model):
    """How far a vehicle is with an action; 2.x tells a `resultDescription`, 3.x an `actionResult`."""

    action_id: str
    action_status: ActionStatus
    result_description: str | None = None
    action_result: str | None = None


class StateMessage(_Model):
    """A message of the topic `state`; what is still to be driven is only counted."""

    version: Annotated[str, Field(max_length=LONGEST_VERSION)]
    driving: bool
    node_states: list[object]
    edge_states: list[object]
    action_states: list[ActionEntry]
    instant_action_states: list[ActionEntry] | None = None
    maps: list[MapEntry] | None = None

    @model_validator(mode="after")
    def _tells_instant_actions(self) -> Self:
        """Hold a vehicle of version 3 to what it alone has; an unknown version is read as what it sends."""
        major, _, _ = self.version.partition(".")
        is_later = major.isascii() and major.isdigit() and len(major) < LONGEST_VERSION
        if is_later and int(major) > _LAST_WITHOUT_INSTANT_STATES and self.instant_action_states is None:
            msg = f"version {self.version} has to tell its instantActionStates"
            raise ValueError(msg)
        return self


class ConnectionMessage(_Model):
    """A message of the topic `connection`; the version 3.0 writes an underscore and can sleep."""

    version: Annotated[str, Field(max_length=LONGEST_VERSION)]
    connection_state: Literal["ONLINE", "OFFLINE", "CONNECTIONBROKEN", "CONNECTION_BROKEN", "HIBERNATING"]


def read_message(model: type[Read], payload: bytes) -> Read:
    """Return a message that is what the published schema says.

    Raises
    ------
    NoState
        If it is not, or is longer than `LARGEST_BYTES`; the sentence tells where.
    """
    if len(payload) > LARGEST_BYTES:
        raise NoState(f"it has {len(payload)} bytes; {LARGEST_BYTES} are read")
    try:
        return model.model_validate_json(payload)
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False, include_input=False)[0]
        where = "".join(f"/{part}" for part in first["loc"])
        raise NoState(f"{where or 'the message'}: {first['msg']}") from error
