"""Every message of a vehicle is held against the published schema, in both versions."""

from __future__ import annotations

import json
from datetime import UTC, datetime
from typing import Any

import pytest
from vda5050.validation import SchemaValidator

from tests.worker.vehicle_messages import MAKER, a_message
from worker.vda5050.faults import QUIET_S, Faults
from worker.vda5050.messages import Action, ActionType, instant_actions, online_version, plain, read_state
from worker.vda5050.schema import LARGEST_BYTES, LONGEST_VERSION, NoState

NODE = {"nodeId": "n1", "sequenceId": 2, "released": True}
EDGE = {"edgeId": "e1", "sequenceId": 1, "released": True}


def an_action(status: str, action_id: str = "order-1") -> dict[str, str]:
    return {"actionId": action_id, "actionType": "pick", "actionStatus": status}


@pytest.mark.parametrize("version", ["2.0.0", "2.1.0", "3.0.0", "4.0.0", "next"])
@pytest.mark.parametrize(
    ("more", "is_idle"),
    [
        ({}, True),
        ({"orderId": "the last one"}, True),
        ({"driving": True}, False),
        ({"nodeStates": [NODE]}, False),
        ({"edgeStates": [EDGE]}, False),
        ({"nodeStates": [NODE], "paused": True}, False),
        ({"actionStates": [an_action("FINISHED"), an_action("FAILED", "b")]}, True),
        ({"actionStates": [an_action("RUNNING")]}, False),
        ({"actionStates": [an_action("WAITING")]}, False),
        ({"actionStates": [an_action("PAUSED")]}, False),
        ({"actionStates": [an_action("RUNNING", "groundplan-downloadMap-7-1")]}, True),
        ({"instantActionStates": [an_action("RUNNING")]}, True),
    ],
)
def test_who_stands_without_an_order_is_idle(version: str, more: dict[str, Any], *, is_idle: bool) -> None:
    assert read_state(json.dumps(a_message(version, **more)).encode()).is_idle is is_idle


def _wrong_actions(key: str) -> list[dict[str, Any]]:
    """Return states that break the published schema at one place of an action or a map."""
    words = "resultDescription" if key == "actionStates" else "actionResult"
    good = an_action("FAILED")
    actions = [
        {**good, words: {"why": "the disk is full"}},
        {**good, words: ["full"]},
        {**good, words: 7},
        {**good, "actionStatus": "BROKEN"},
        {**good, "actionStatus": None},
        {**good, "actionId": 7},
        {"actionId": "a"},
        "groundplan-downloadMap-1-1",
        None,
    ]
    entry = {"mapId": "map_1", "mapVersion": "7", "mapStatus": "ENABLED"}
    maps = [
        {**entry, "mapVersion": 7},
        {**entry, "mapId": None},
        {**entry, "mapStatus": "enabled"},
        {"mapId": "map_1"},
        [],
    ]
    others = [
        {"maps": {}},
        {"driving": "false"},
        {"driving": 0},
        {"nodeStates": None},
        {"edgeStates": {}},
        {"version": 3},
        {"version": "3" * (LONGEST_VERSION + 1)},
        {key: {}},
        {key: "none"},
    ]
    return [{key: [one]} for one in actions] + [{"maps": [one]} for one in maps] + others


@pytest.mark.parametrize(
    ("version", "wrong"),
    [("2.1.0", wrong) for wrong in _wrong_actions("actionStates")]
    + [("3.0.0", wrong) for wrong in _wrong_actions("instantActionStates")]
    + [("3.0.0", {"instantActionStates": None})],
)
def test_a_state_that_breaks_the_published_schema_is_refused(version: str, wrong: dict[str, Any]) -> None:
    read_state(json.dumps(a_message(version)).encode())
    with pytest.raises(NoState) as told:
        read_state(json.dumps({**a_message(version), **wrong}).encode())
    assert next(iter(wrong)) in str(told.value) or "version" in str(told.value)


@pytest.mark.parametrize("left_out", ["version", "driving", "nodeStates", "edgeStates", "actionStates"])
def test_a_state_tells_what_the_published_schema_requires(left_out: str) -> None:
    message = a_message()
    del message[left_out]
    with pytest.raises(NoState, match=left_out):
        read_state(json.dumps(message).encode())
    assert any(left_out in error for error in SchemaValidator().errors("state", message))


def test_the_longest_message_is_read_and_a_longer_one_is_not() -> None:
    message = json.dumps(a_message()).encode()
    assert read_state(message.ljust(LARGEST_BYTES)).is_idle
    with pytest.raises(NoState, match="bytes"):
        read_state(message.ljust(LARGEST_BYTES + 1))
    assert read_state(json.dumps(a_message("2" * LONGEST_VERSION)).encode()).is_idle


def test_the_words_of_a_vehicle_are_one_line_of_text() -> None:
    assert plain("disk\x00 full:\n\t 98\u2028%\x1b[31m") == "disk full: 98 %[31m".replace("%[", "% [")
    assert plain("\ud800 a") == "a"
    assert plain("地図を読めません") == "地図を読めません"
    assert len(plain("x" * 5000)) == 2000
    told = a_message(actionStates=[{**an_action("FAILED"), "resultDescription": "disk\x00 full"}])
    assert read_state(json.dumps(told).encode()).actions["order-1"].result == "disk full"


def test_a_fault_is_told_until_the_vehicle_has_been_right_for_a_while() -> None:
    faults, name = Faults(), (MAKER, "1")
    assert faults.of(name, now=0.0) is None
    faults.wrong(name, "first", now=0.0)
    faults.wrong(name, "second", now=5.0)
    assert faults.of(name, now=1e6) == "first", "it has sent nothing right since"
    faults.right(name)
    assert faults.of(name, now=5.0 + QUIET_S - 0.1) == "first"
    assert faults.of(name, now=5.0 + QUIET_S) is None
    faults.wrong(name, "third", now=20.0)
    assert faults.of(name, now=20.0) == "third"


@pytest.mark.parametrize(
    ("state", "is_there"),
    [
        ("ONLINE", True),
        ("OFFLINE", False),
        ("CONNECTIONBROKEN", False),
        ("CONNECTION_BROKEN", False),
        ("HIBERNATING", False),
    ],
)
def test_a_vehicle_is_there_while_it_is_online(state: str, *, is_there: bool) -> None:
    told = json.dumps({"version": "3.0.0", "connectionState": state}).encode()
    assert online_version(told) == ("3.0.0" if is_there else None)


@pytest.mark.parametrize(
    "payload",
    [b"", b"[]", b"null", b'{"version": "2.1.0", "maps": [1]}', b"\xff", b"{}", b"[" * 9000, b"1" * 9000],
)
def test_what_is_no_state_is_refused(payload: bytes) -> None:
    with pytest.raises(NoState):
        read_state(payload)
    with pytest.raises(NoState):
        online_version(payload)


def test_a_message_is_what_the_published_schema_says() -> None:
    action = Action("a", ActionType.ENABLE, {"mapId": "map_1", "mapVersion": "7"})
    now = datetime(2026, 1, 1, tzinfo=UTC)
    message = instant_actions(
        action, header_id=3, version="2.1.0", manufacturer=MAKER, serial_number="1", now=now
    )
    assert SchemaValidator().errors("instantActions", json.loads(message)) == []
