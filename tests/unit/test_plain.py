from __future__ import annotations

import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from service.domain.plain import plain, plain_dumps, plain_loads, plain_text

ANY_TEXT = st.text(alphabet=st.characters())
ANY_JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | ANY_TEXT,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(ANY_TEXT, inner, max_size=4),
    max_leaves=12,
)


@given(ANY_TEXT)
def test_a_plain_text_can_be_sent_and_never_grows(text: str) -> None:
    made = plain_text(text)
    made.encode("utf-8")
    assert len(made) == len(text)
    assert "\0" not in made
    assert plain_text(made) == made


@given(st.text(alphabet=st.characters(exclude_categories=("Cs", "Cc"))))
def test_what_is_plain_already_stays(text: str) -> None:
    assert plain_text(text + "\t\r\n") == text + "\t\r\n"


@pytest.mark.parametrize("bad", ["\udcb0", "\0", "\x1b", "\x7f", "\x9b"])
def test_each_bad_character_is_replaced_one_for_one(bad: str) -> None:
    assert plain_text(f"a{bad}b{bad}") == "a\N{REPLACEMENT CHARACTER}b\N{REPLACEMENT CHARACTER}"


@given(ANY_JSON)
def test_any_json_value_is_stored_as_strict_json_and_comes_back_plain(value: Any) -> None:
    stored = plain_dumps(value)
    back = json.loads(stored, parse_constant=pytest.fail)
    json.dumps(back, ensure_ascii=False, allow_nan=False).encode("utf-8")
    assert plain_loads(stored) == back == plain(value)


@pytest.mark.parametrize(
    "number", [float("nan"), float("inf"), -float("inf"), 2**63, -(2**63), 1 << 20_000], ids=range(6)
)
def test_a_number_that_json_has_not_is_null(number: float) -> None:
    assert plain({"a": [number, 1.5, 2**63 - 1]}) == {"a": [None, 1.5, 2**63 - 1]}


@given(ANY_JSON)
def test_what_an_earlier_version_stored_is_read_plain(value: Any) -> None:
    try:
        stored = json.dumps(value)
    except ValueError:  # whole numbers of thousands of digits could not be stored
        return
    json.dumps(plain_loads(stored), ensure_ascii=False, allow_nan=False).encode("utf-8")


def test_a_pair_of_escapes_is_one_character() -> None:
    assert plain_loads(r'["\ud83d\ude00", "\ud83d"]') == ["\N{GRINNING FACE}", "\N{REPLACEMENT CHARACTER}"]
