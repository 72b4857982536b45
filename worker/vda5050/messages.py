"""Messages of VDA 5050, versions 2.1 and 3.0, as far as they are about maps."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from enum import StrEnum
from typing import Any

from worker.vda5050.schema import ActionEntry, ConnectionMessage, StateMessage, read_message

OURS = "groundplan-"
"""How the ids of actions begin that are asked for here."""

LONGEST_WORDS = 2000
"""Longest sentence of a vehicle that is kept [characters]: as that of a robot's own report."""


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
        """Return whether the vehicle has given it up; one that would try again if told is asked anew."""
        return self.status in {"FAILED", "RETRIABLE"}

    @property
    def has_ended(self) -> bool:
        """Return whether nothing more comes of it."""
        return self.has_failed or self.status == "FINISHED"


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
    is_idle : bool
        Whether it stands, without an order: a map may be enabled only then.
    """

    version: str
    maps: Mapping[tuple[str, str], bool]
    actions: Mapping[str, ActionState]
    is_idle: bool


def read_state(payload: bytes) -> VehicleState:
    """Return what a message of the topic `state` says about maps.

    Raises
    ------
    NoState
        If the message is not what the published schema says.

    Notes
    -----
    Version 2.x has instant actions among `actionStates` with a `resultDescription`; 3.x has
    `instantActionStates` with an `actionResult`. An order is active while nodes or edges are still to be
    driven, or an action that is not ours goes on.
    """
    told = read_message(StateMessage, payload)
    entries = [*told.action_states, *(told.instant_action_states or ())]
    order = {a.action_id: _state_of(a) for a in told.action_states if not a.action_id.startswith(OURS)}
    stands = not told.driving and not told.node_states and not told.edge_states
    return VehicleState(
        told.version,
        {(m.map_id, m.map_version): m.map_status == "ENABLED" for m in told.maps or ()},
        {a.action_id: _state_of(a) for a in entries},
        stands and all(state.has_ended for state in order.values()),
    )


def online_version(payload: bytes) -> str | None:
    """Return the version of a vehicle whose message of the topic `connection` says that it is there, or None.

    Raises
    ------
    NoState
        If the message is not what the published schema says.
    """
    told = read_message(ConnectionMessage, payload)
    return told.version if told.connection_state == "ONLINE" else None


def _state_of(action: ActionEntry) -> ActionState:
    words = action.result_description or action.action_result
    return ActionState(action.action_status, None if words is None else plain(words))


def plain(words: str) -> str:
    """Return the words of a vehicle as they are kept and shown: one line, none too long.

    Control characters (of which a database takes not all) and surrogates become spaces.
    """
    shown = "".join(c if c.isprintable() else " " for c in words[: 2 * LONGEST_WORDS])
    return " ".join(shown.split())[:LONGEST_WORDS]


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
