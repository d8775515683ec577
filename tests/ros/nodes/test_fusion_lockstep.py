"""The fusion node in lockstep: it waits for all that belongs to a tick, and for no more."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from snnav_ros.convert import (
    nothing_to_message,
)
from support.fusion_site import SECOND, Steps, scan


def test_in_lockstep_it_waits_for_the_word_that_nothing_more_comes(graph: Any) -> None:
    steps = Steps(graph)
    steps.tick(500_000_000)
    steps.south.publish(scan("laser", 500_000_000))
    for stamp in (200_000_000, 400_000_000):
        steps.north.publish(scan("north", stamp))
    graph.work(0.2)
    assert not steps.areas
    steps.north.publish(nothing_to_message("north", 500_000_000))
    graph.until(lambda: steps.is_done(500_000_000))
    graph.until(lambda: bool(steps.areas))
    assert steps.node.world.fusion.latest_stamp("north") == 0.4
    assert steps.node._rejected == {"north": 0, "south": 0}
    steps.tick(SECOND)
    steps.south.publish(scan("laser", SECOND))
    steps.north.publish(scan("north", 1_500_000_000))  # from the future, whose tick would be the next
    steps.north.publish(nothing_to_message("north", SECOND))
    graph.until(lambda: steps.is_done(SECOND))
    assert steps.node._rejected["north"] == 1
    steps.tick(1_500_000_000)
    steps.south.publish(scan("laser", 1_500_000_000))
    graph.work(0.2)
    assert not steps.is_done(1_500_000_000), "what came before does not stand for the next tick"
    steps.north.publish(nothing_to_message("north", 1_500_000_000))
    graph.until(lambda: steps.is_done(1_500_000_000))


def test_in_lockstep_no_scan_of_a_fast_scanner_is_left_out(graph: Any) -> None:
    steps = Steps(graph)
    steps.tick(500_000_000)
    for index in range(50):
        steps.north.publish(scan("north", 10_000_000 * index))
    steps.north.publish(nothing_to_message("north", 500_000_000))
    steps.south.publish(scan("laser", 500_000_000))
    graph.until(lambda: steps.is_done(500_000_000))
    assert steps.node._rejected["north"] == 0
    points = np.array([[0.0, 7.0]])
    for index in range(30, 50):  # the last twenty are known to the fusion
        sensor, stamps = steps.node.world.fusion.last_seen(points, 0.01 * index + 0.001)
        assert (sensor[0], stamps[0]) == (0, pytest.approx(0.01 * index))
