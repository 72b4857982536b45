"""Messages of VDA 5050, versions 2.1 and 3.0, as far as they are about maps."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from enum import StrEnum
from typing import Any


class ActionType(StrEnum):
    """The instant actions about maps, and that which asks for a state."""

    DOWNLOAD = "downloadMap"
    ENABLE = "enableMap"
    DELETE = "deleteMap"
    STATE = "stateRequest"


@dataclass(frozen=True)
class Action:
    """Hold an instant action: its id, what is to be done, and its parameters."""

    id: str
    type: ActionType
    parameters: Mapping[str, str]


@dataclass(frozen=True)
class ActionState:
    """Hold how far a vehicle is with an action: `status` in its own words, `result` what it says of it."""

    status: str
    result: str | None

    @property
    def has_failed(self) -> bool:
        """Return whether the vehicle has given it up."""
        return self.status == "FAILED"


@dataclass(frozen=True)
class VehicleState:
    """Hold what a vehicle's state says about maps.

    Parameters
    ----------
    version : str
        Of the protocol, as the vehicle writes it.
    maps : mapping of (str, str) to bool
        The maps that it has, by id and version, and whether each is enabled.
    actions : mapping of str to ActionState
        Actions that it knows, by id.
    """

    version: str
    maps: Mapping[tuple[str, str], bool]
    actions: Mapping[str, ActionState]


class NoState(ValueError):
    """The message is no state of a vehicle."""


def read_state(payload: bytes) -> VehicleState:
    """Return what a message of the topic `state` says about maps.

    Raises
    ------
    NoState
        If the message is no JSON object of that kind; what has nothing to do with maps is not looked at.

    Notes
    -----
    Version 2.1 has instant actions among `actionStates` with a `resultDescription`; 3.0 has
    `instantActionStates` with an `actionResult`.
    """
    try:
        told = json.loads(payload)
        states = [*told.get("actionStates", ()), *told.get("instantActionStates", ())]
        return VehicleState(
            str(told["version"]),
            {
                (str(m["mapId"]), str(m["mapVersion"])): m["mapStatus"] == "ENABLED"
                for m in told.get("maps") or ()
            },
            {
                str(a["actionId"]): ActionState(
                    str(a["actionStatus"]), a.get("resultDescription") or a.get("actionResult")
                )
                for a in states
            },
        )
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise NoState(str(error)) from error


def online_version(payload: bytes) -> str | None:
    """Return the version of a vehicle whose message of the topic `connection` says that it is there, or None.

    Raises
    ------
    NoState
        If it is no such message.
    """
    try:
        told = json.loads(payload)
        return str(told["version"]) if told["connectionState"] == "ONLINE" else None
    except (ValueError, TypeError, KeyError) as error:
        raise NoState(str(error)) from error


def instant_actions(
    action: Action, *, header_id: int, version: str, manufacturer: str, serial_number: str, now: datetime
) -> bytes:
    """Return the message of the topic `instantActions` that asks for one action.

    Its blocking type is NONE, the only one that version 3.0 has for instant actions.
    """
    message: dict[str, Any] = {
        "headerId": header_id,
        "timestamp": now.astimezone(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z"),
        "version": version,
        "manufacturer": manufacturer,
        "serialNumber": serial_number,
        "actions": [
            {
                "actionId": action.id,
                "actionType": action.type.value,
                "blockingType": "NONE",
                "actionParameters": [{"key": k, "value": v} for k, v in action.parameters.items()],
            }
        ],
    }
    return json.dumps(message).encode()
