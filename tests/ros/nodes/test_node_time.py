"""Clocks that are set are found against a steady one."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rclpy.lifecycle import LifecycleNode

from snnav_ros.nodes.node_time import ClockWatch, is_simulated, now_of, watch_time

SECOND = 10**9


class Clocks:
    def __init__(self) -> None:
        self.steady, self.offset, self.nap = 0, 50 * SECOND, 0

    def now(self) -> int:
        self.steady += self.nap  # the process may lose the processor between two looks at clocks
        return self.steady + self.offset


@given(st.lists(st.tuples(st.integers(0, 10 * SECOND), st.integers(-2 * SECOND, 2 * SECOND)), max_size=20))
def test_jumps_are_found_however_long_the_process_sleeps(steps: list[tuple[int, int]]) -> None:
    clocks = Clocks()
    watch = ClockWatch(clocks.now, lambda: clocks.steady)
    for passed, jump in steps:
        clocks.steady += passed
        clocks.offset += jump
        found = watch.jump()
        assert found == (pytest.approx(jump / SECOND) if abs(jump) > SECOND // 10 else 0.0)
        assert watch.jump() == 0.0


def test_nap_between_two_clocks_is_no_jump() -> None:
    clocks = Clocks()
    watch = ClockWatch(clocks.now, lambda: clocks.steady)
    clocks.nap = SECOND
    assert watch.jump() == 0.0
    clocks.nap = 0
    assert watch.jump() == 0.0


def test_nodes_by_the_wall_start_afresh_when_the_clock_is_set_back(
    graph: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    shift, resets = 0, []
    monkeypatch.setattr("snnav_ros.nodes.node_time.now_of", lambda node: now_of(node) + shift)
    node = LifecycleNode("any", context=graph.context)
    graph.executor.add_node(node)
    graph.nodes.append(node)
    assert not is_simulated(node)
    handle = watch_time(node, lambda: resets.append(1))
    assert handle is not None
    shift = SECOND
    graph.work(0.3)
    assert not resets  # forth: what is there only grows old
    shift = 0
    graph.until(lambda: bool(resets), "a reset")
    assert len(resets) == 1
