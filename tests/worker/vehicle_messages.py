"""Messages as the published schemas of VDA 5050 have them, to be sent, changed and broken in tests."""

from __future__ import annotations

from typing import Any

MAKER = "Works"


def a_message(version: str = "2.1.0", **more: Any) -> dict[str, Any]:
    """Return a state as a version's published schema has it, of a vehicle that stands without an order."""
    is_later = not version.startswith("2")
    power = {"powerSupply": {"stateOfCharge": 80.0, "charging": False}}
    battery = {"batteryState": {"batteryCharge": 80.0, "charging": False}}
    stop = "activeEmergencyStop" if is_later else "eStop"
    return {
        "headerId": 1,
        "timestamp": "2026-01-01T12:00:00.000Z",
        "version": version,
        "manufacturer": MAKER,
        "serialNumber": "1",
        "orderId": "",
        "orderUpdateId": 0,
        "lastNodeId": "",
        "lastNodeSequenceId": 0,
        "nodeStates": [],
        "edgeStates": [],
        "driving": False,
        "actionStates": [],
        "operatingMode": "AUTOMATIC",
        "errors": [],
        "safetyState": {stop: "NONE", "fieldViolation": False},
        **(power if is_later else battery),
        **({"instantActionStates": []} if is_later else {}),
        **more,
    }


def a_connection(version: str = "2.1.0", state: str = "ONLINE") -> dict[str, Any]:
    """Return a message of the topic `connection` as the published schemas have it."""
    return {
        "headerId": 0,
        "timestamp": "2026-01-01T12:00:00.000Z",
        "version": version,
        "manufacturer": MAKER,
        "serialNumber": "1",
        "connectionState": state,
    }
