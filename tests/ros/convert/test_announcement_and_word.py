"""What robots say of themselves and planners of what they did: exact round trips, and mistakes that are named."""

from __future__ import annotations

import pytest
from diagnostic_msgs.msg import KeyValue
from hypothesis import given
from hypothesis import strategies as st

from snnav_core.errors import InvalidInput
from snnav_core.types import RobotSpec
from snnav_ros.convert import (
    Announcement,
    Word,
    announcement_from_message,
    announcement_to_message,
    word_from_message,
    word_to_message,
)

STAMPS = st.integers(0, 10**13)
NAMES = st.from_regex(r"[A-Za-z](_?[A-Za-z0-9]){0,20}", fullmatch=True).filter(
    lambda name: name not in ("map", "clock")
)
CART = RobotSpec("cart", 0.3, 0.8, 1.5)


@given(NAMES, STAMPS, st.floats(0.001, 1000.0), st.floats(0.001, 50.0), st.floats(0.001, 50.0), st.booleans())
def test_an_announcement_is_read_as_it_was_written(
    name: str, stamp: int, radius: float, speed: float, rate: float, turns: bool
) -> None:
    for spec in (RobotSpec(name, radius, speed, rate, turns), None):
        announcement = Announcement(name, stamp, spec)
        assert announcement_from_message(announcement_to_message(announcement)) == announcement


MISTAKES = {
    "no name": ("name", "9 lives", "'9 lives' is no name"),
    "reserved name": ("name", "sensors", "no reserved name"),
    "name of the length of a book": ("name", "x" * 100 + "!", r"x\.\.\.' is no name"),
    "neither joins nor leaves": ("message", "dances", "message is 'dances', write joins or leaves"),
    "huge": ("radius", "1e9", r"radius is 1e\+09, give 0.001 to 1000"),
    "negative": ("speed", "-1", "speed is -1, give 0.001 to 50"),
    "nan": ("max_turn_rate", "nan", "max_turn_rate is nan"),
    "words": ("radius", "large", "radius is 'large', write a number"),
    "turns perhaps": ("can_turn_in_place", "perhaps", "can_turn_in_place is 'perhaps'"),
    "stamp": ("stamp", "inf", "stamp is inf"),
    "missing": ("speed", None, "key 'speed' is missing"),
    "twice": ("twice", "speed", "a key is there twice"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_in_an_announcement_is_named(mistake: str) -> None:
    key, value, text = MISTAKES[mistake]
    message = announcement_to_message(Announcement("cart", 10**9, CART))
    if key in ("name", "message"):
        setattr(message, key, value)
    elif key == "twice":
        message.values.append(KeyValue(key=value, value="1"))
    else:
        values = {pair.key: pair.value for pair in message.values} | {key: value}
        message.values = [KeyValue(key=k, value=v) for k, v in values.items() if v is not None]
    with pytest.raises(InvalidInput, match=text):
        announcement_from_message(message)


@given(
    NAMES,
    STAMPS,
    st.integers(0, 10**6),
    st.lists(NAMES, unique=True),
    st.dictionaries(NAMES, st.text(max_size=30)),
)
def test_a_word_is_read_as_it_was_written(
    name: str, stamp: int, issue: int, decided: list[str], stops: dict[str, str]
) -> None:
    word = Word(name, stamp, "abc", issue, tuple(decided), tuple(stops.items()))
    assert word_from_message(word_to_message(word)) == word


@pytest.mark.parametrize(
    ("key", "value", "text"),
    [
        ("issue", None, "key 'issue' is missing"),
        ("issue", "many", "invalid literal"),
        ("stamp", "inf", "must be finite"),
    ],
)
def test_a_mistake_in_a_word_is_named(key: str, value: str | None, text: str) -> None:
    message = word_to_message(Word("planner_1", 5, "abc", 1))
    values = {pair.key: pair.value for pair in message.values} | {key: value}
    message.values = [KeyValue(key=k, value=v) for k, v in values.items() if v is not None]
    with pytest.raises(InvalidInput, match=text):
        word_from_message(message)
