"""What a vehicle is asked for next, and by what it is judged."""

from __future__ import annotations

import pytest

from worker.vda5050.course import Course
from worker.vda5050.messages import ActionState, ActionType, VehicleState


def a_state(
    maps: dict[str, bool] | None = None, *, is_idle: bool = True, **actions: ActionState
) -> VehicleState:
    known = {name.replace("_", "-"): state for name, state in actions.items()}
    held = {("map_1", n): on for n, on in (maps or {}).items()}
    return VehicleState("2.1.0", held, known, is_idle)


def test_what_fails_is_asked_again_later_and_later_and_silence_is_not_waited_out() -> None:
    course = Course("map_1")
    first = course.next_step(a_state(), 7, now=0.0)
    assert first is not None
    assert (first.type, first.n, first.action_id) == (ActionType.DOWNLOAD, 7, "groundplan-downloadMap-7-1")
    assert course.next_step(a_state(), 7, now=29.0) is None
    second = course.next_step(a_state(), 7, now=30.0)
    assert second is not None
    failed = a_state(groundplan_downloadMap_7_2=ActionState("FAILED", "disk full"))
    failure = course.failure(failed, 7)
    assert failure is not None
    assert failure.result == "disk full"
    assert course.next_step(failed, 7, now=40.0) is None
    assert course.next_step(failed, 7, now=40.0 + 59.9) is None
    third = course.next_step(failed, 7, now=40.0 + 60.0)
    assert third is not None
    assert third.action_id == "groundplan-downloadMap-7-3"
    again = a_state(groundplan_downloadMap_7_3=ActionState("RETRIABLE", "the network fell"))
    assert course.next_step(again, 7, now=110.0) is None
    assert course.next_step(again, 7, now=110.0 + 119.9) is None
    running = a_state(groundplan_downloadMap_7_3=ActionState("RUNNING", None))
    assert course.next_step(running, 7, now=1e9) is None


def test_a_new_process_goes_on_where_the_vehicle_says() -> None:
    running = a_state(groundplan_downloadMap_7_1=ActionState("RUNNING", None))
    assert Course("map_1").next_step(running, 7, now=0.0) is None
    done = a_state({"7": False}, groundplan_downloadMap_7_1=ActionState("FINISHED", None))
    step = Course("map_1").next_step(done, 7, now=0.0)
    assert step is not None
    assert (step.type, step.n) == (ActionType.ENABLE, 7)
    everything = a_state({"7": True, "6": False, "5": False, "beta": False})
    tidy = Course("map_1").next_step(everything, 7, now=0.0)
    assert tidy is not None
    assert (tidy.type, tidy.n) == (ActionType.DELETE, 5)


def test_what_a_vehicle_remembers_of_an_earlier_try_decides_nothing() -> None:
    old = ActionState("FAILED", "disk full")
    remembers = a_state(groundplan_downloadMap_7_1=old, groundplan_downloadMap_7_4=old)
    course = Course("map_1")
    course.want(7)
    assert course.failure(remembers, 7) is None
    step = course.next_step(remembers, 7, now=0.0)
    assert step is not None
    assert step.action_id == "groundplan-downloadMap-7-5", "asked at once, by an id that it does not know"
    assert course.failure(remembers, 7) is None
    failed = a_state(groundplan_downloadMap_7_4=old, groundplan_downloadMap_7_5=old)
    assert course.failure(failed, 7) == old
    course.want(6)
    course.want(7)
    assert course.failure(failed, 7) is None, "the second roll-out of a revision is a new one"
    anew = course.next_step(failed, 7, now=1.0)
    assert anew is not None
    assert anew.action_id == "groundplan-downloadMap-7-6"


def test_a_map_is_enabled_only_while_the_vehicle_stands_without_an_order() -> None:
    course, held = Course("map_1"), {"6": True, "7": False}
    assert course.next_step(a_state(held, is_idle=False), 7, now=0.0) is None
    assert course.next_step(a_state(held, is_idle=False), 7, now=1e6) is None
    step = course.next_step(a_state(held), 7, now=1e6)
    assert step is not None
    assert step.type is ActionType.ENABLE
    fetched = Course("map_1").next_step(a_state({"6": True}, is_idle=False), 7, now=0.0)
    assert fetched is not None
    assert fetched.type is ActionType.DOWNLOAD, "it may fetch while it drives"


@pytest.mark.parametrize("version", ["9" * 5000, "99", "0", "007", "-7", "7.0", "\u0667", "", "8"])
def test_a_version_that_is_no_revision_is_left_as_it_is(version: str) -> None:
    state = a_state({version: True, "6": False, "5": False})
    step = Course("map_1").next_step(state, 7, now=0.0, below=8)
    assert step is not None
    assert (step.type, step.n) == (ActionType.DOWNLOAD, 7)
    tidy = Course("map_1").next_step(a_state({version: False, "7": True, "6": False}), 7, now=0.0, below=8)
    assert tidy is None, "the latest of ours stays, and what is not ours is not deleted"
