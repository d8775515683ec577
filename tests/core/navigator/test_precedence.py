"""The order of a step: as given, those who were blocked for long first, nobody before those it waits for."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from snnav_core.navigator.precedence import Precedence


def test_who_was_blocked_for_five_decisions_goes_to_the_front_and_stays_there() -> None:
    precedence = Precedence("abc")
    for _ in range(4):
        precedence.note({"c": True})
        assert precedence.order == ("a", "b", "c")
    precedence.note({"c": True})
    assert precedence.order == ("c", "a", "b")
    precedence.note({})
    assert precedence.order == ("c", "a", "b")


def test_one_free_decision_in_between_starts_the_count_again() -> None:
    precedence = Precedence("ab")
    for blocked in (True, True, True, True, False, True, True, True, True):
        precedence.note({"b": blocked})
    assert precedence.order == ("a", "b")
    assert precedence.blocked("b") == 4


def test_two_that_block_each_other_keep_their_order() -> None:
    precedence = Precedence("abc")
    for _ in range(12):
        precedence.note({"b": True, "c": True})
    assert precedence.order == ("b", "c", "a")


def test_robots_come_last_and_go() -> None:
    precedence = Precedence("a")
    for name in ("b", "b", "c"):
        precedence.add(name)
    precedence.remove("b")
    precedence.remove("b")
    assert precedence.order == ("a", "c")
    assert precedence.blocked("b") == 0


@given(
    st.dictionaries(st.sampled_from("abcdef"), st.lists(st.sampled_from("abcdefgh"), max_size=3), max_size=6)
)
def test_a_step_decides_everybody_once_and_nobody_before_those_it_waits_for(
    waits_for: dict[str, list[str]],
) -> None:
    order = Precedence("abcdef").sequence(waits_for)
    assert sorted(order) == list("abcdef")
    reachable = {name: _all_waited_for(name, waits_for) for name in order}
    for name in order:
        for other in set(waits_for.get(name, ())) & set(order):
            if name not in reachable[other]:  # two that wait for each other have no order
                assert order.index(other) < order.index(name)


def _all_waited_for(name: str, waits_for: dict[str, list[str]]) -> set[str]:
    found: set[str] = set()
    left = [name]
    while left:
        for other in waits_for.get(left.pop(), ()):
            if other not in found:
                found.add(other)
                left.append(other)
    return found
