"""Messages of vehicles, broken at random as by a bug or an enemy: same state and seed, same bytes."""

from __future__ import annotations

import copy
import json
import random
from collections.abc import Callable
from typing import Any

from tests.worker.vehicle_messages import a_connection

LONGEST_BYTES = 3 << 20
"""Longest message that is made: well above what is read, well below what a broker takes."""

WORDS = (
    "\ud800",
    "\udfff\ud800",
    "\x00",
    "disk\x00full\x1b[2J",
    "",
    " ",
    "\u202e\u2028",
    "地図",
    "x" * 100_000,
    "9" * 5000,
    "-1",
    "0",
    "007",
    "1e3",
    "\u0667",
    str(2**31),
    str(2**63),
    "FAILED",
    "ENABLED",
    "../../etc/passwd",
    "groundplan-downloadMap-1-1",
    "groundplan-enableMap-2-999999999",
)
NUMBERS = (0, -1, 1.5, 2**31, 2**63, 10**400, float("nan"), float("inf"), True, False)
STATUSES = ("WAITING", "INITIALIZING", "RUNNING", "PAUSED", "RETRIABLE", "FINISHED", "FAILED", "GONE")
VERSIONS = ("2.1.0", "3.0.0", "1.1.0", "4.0.0", "2", "", "v3", "9" * 200, "\u0663.0")


def _value(rng: random.Random) -> object:
    """Return a value of any JSON type."""
    return rng.choice(
        [
            lambda: rng.choice(WORDS),
            lambda: rng.choice(NUMBERS),
            lambda: None,
            dict,
            list,
            lambda: {"why": rng.choice(WORDS)},
            lambda: [rng.choice(WORDS)] * rng.randint(1, 50),
        ]
    )()


def _places(node: Any) -> list[tuple[Any, Any]]:
    """Return each place of a message: what holds it, and under which key."""
    keys = list(node) if isinstance(node, dict) else range(len(node)) if isinstance(node, list) else []
    found = [(node, key) for key in keys]
    return found + [place for key in keys for place in _places(node[key])]


def _replaced(message: dict[str, Any], rng: random.Random) -> dict[str, Any]:
    holder, key = rng.choice(_places(message))
    holder[key] = _value(rng)
    return message


def _cut(message: dict[str, Any], rng: random.Random) -> dict[str, Any]:
    holder, key = rng.choice(_places(message))
    del holder[key]
    return message


def _more(message: dict[str, Any], rng: random.Random) -> dict[str, Any]:
    """Give a message more of what it has: fields that nobody knows, long lists."""
    lists = [holder[key] for holder, key in _places(message) if isinstance(holder[key], list)]
    if lists and rng.random() < 0.5:
        rng.choice(lists).extend([rng.choice([*WORDS, *NUMBERS, None])] * rng.choice([1, 10, 100]))
    else:
        message[rng.choice(WORDS)] = _value(rng)
    return message


def _actions(message: dict[str, Any], rng: random.Random) -> dict[str, Any]:
    """Tell of actions that nobody asked for, or that went otherwise."""
    known = [one["actionId"] for one in message.get("instantActionStates", message["actionStates"])]
    ids = [*known, *(f"groundplan-{kind}-{n}-{k}" for kind in ("downloadMap", "enableMap", "deleteMap")
                     for n in (1, 2, 3) for k in (1, 2, 99))]  # fmt: skip
    for key in ("actionStates", "instantActionStates"):
        message[key] = [
            {
                "actionId": rng.choice([*ids, *WORDS]),
                "actionStatus": rng.choice(STATUSES[: rng.choice([7, 8])]),
                rng.choice(["resultDescription", "actionResult"]): _value(rng),
            }
            for _ in range(rng.choice([0, 1, 5, 200]))
        ]
    return message


def _maps(message: dict[str, Any], rng: random.Random) -> dict[str, Any]:
    """Tell of versions of the map that there are, were or never will be."""
    ids = [one["mapId"] for one in message["maps"]] or ["map"]
    message["maps"] = [
        {
            "mapId": rng.choice([*ids, *ids, rng.choice(WORDS)]),
            "mapVersion": rng.choice(["1", "2", "3", "4", rng.choice(WORDS), _value(rng)]),
            "mapStatus": rng.choice(["ENABLED", "DISABLED", rng.choice(WORDS)]),
        }
        for _ in range(rng.choice([0, 1, 3, 300]))
    ]
    return message


def _driving(message: dict[str, Any], rng: random.Random) -> dict[str, Any]:
    message["driving"] = rng.choice([True, False, _value(rng)])
    message["nodeStates"] = rng.choice(
        [[], [{"nodeId": "n", "sequenceId": 0, "released": True}], _value(rng)]
    )
    return message


def _version(message: dict[str, Any], rng: random.Random) -> dict[str, Any]:
    message["version"] = rng.choice(VERSIONS)
    return message


CHANGES: tuple[Callable[[dict[str, Any], random.Random], dict[str, Any]], ...] = (
    _replaced, _cut, _more, _actions, _maps, _driving, _version,
)  # fmt: skip


def _flipped(payload: bytes, rng: random.Random) -> bytes:
    changed = bytearray(payload)
    for _ in range(rng.choice([1, 3, 30])):
        changed[rng.randrange(len(changed))] ^= 1 << rng.randrange(8)
    return bytes(changed)


def _shortened(payload: bytes, rng: random.Random) -> bytes:
    return payload[: rng.randrange(len(payload))]


def _deep(payload: bytes, rng: random.Random) -> bytes:
    depth = rng.choice([50, 199, 201, 100_000])
    return payload[:-1] + b', "errors": ' + b"[" * depth + b"]" * depth + b"}"


def _digits(payload: bytes, rng: random.Random) -> bytes:
    return payload[:-1] + b', "%s": %s}' % (
        rng.choice([b"mapVersion", b"headerId", b"version"]),
        b"9" * rng.choice([20, 5000]),
    )


def _no_json(_payload: bytes, rng: random.Random) -> bytes:
    return rng.choice(
        [b"", b"null", b"[]", b"true", b"\xef\xbb\xbf{}", b"\x00" * 9, rng.randbytes(100), b"{" * 9999]
    )


def _twice(payload: bytes, _rng: random.Random) -> bytes:
    return payload[:-1] + b"," + payload[1:]


DAMAGES: tuple[Callable[[bytes, random.Random], bytes], ...] = (
    _flipped, _shortened, _deep, _digits, _no_json, _twice,
)  # fmt: skip


def broken(state: dict[str, Any], rng: random.Random) -> tuple[str, bytes]:
    """Return the subtopic and the bytes of a message that is like a vehicle's state, or like its connection.

    It may still be right: what is right and untrue is a fault, too.
    """
    subtopic, message = "state", copy.deepcopy(state)
    changes = CHANGES
    if rng.random() < 0.1:
        subtopic, changes = "connection", (_replaced, _cut, _version)
        states = ("ONLINE", "OFFLINE", "CONNECTIONBROKEN", "CONNECTION_BROKEN", "HIBERNATING", "ON")
        message = a_connection(state["version"], rng.choice(states))
    for _ in range(rng.choice([0, 1, 1, 2])):
        message = rng.choice(changes)(message, rng)
        if not _places(message) or "maps" not in message or "actionStates" not in message:
            break
        changes = (_replaced, _more, _driving, _version)
    payload = json.dumps(message).encode()[:LONGEST_BYTES]
    return subtopic, rng.choice(DAMAGES)(payload, rng) if rng.random() < 0.3 else payload
