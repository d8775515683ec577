"""The fusion node in space in lockstep: it waits for all that belongs to a tick, also after time went back."""

from __future__ import annotations

from typing import Any

import numpy as np

from snnav_core.area.camera_network import CameraNetwork
from snnav_ros.convert import no_cloud_to_message
from support.camera_site import BEE, EYES, FUSION, MIDDLE, SECOND, Steps, cloud, inner, odometry, seen, state

HALF = SECOND // 2


def test_it_waits_for_the_word_that_nothing_more_comes(graph: Any) -> None:
    steps = Steps(graph, clock_tolerance=0.1)
    core = CameraNetwork(list(EYES.values()), FUSION, [BEE])
    steps.tick(HALF)
    steps.odom.publish(odometry(HALF))
    core.add_state(state(HALF))
    steps.eyes["high"].publish(cloud("high", HALF))
    core.add_image("high", seen("high", HALF))
    for stamp in (200_000_000, 400_000_000):
        steps.eyes["low"].publish(cloud("low", stamp))
        core.add_image("low", seen("low", stamp))
    graph.work(0.2)
    assert not steps.areas
    steps.eyes["low"].publish(no_cloud_to_message("low", HALF))
    area, expected = steps.area(0.5), core.area(0.5)
    np.testing.assert_allclose(area.moving, expected.moving, rtol=0.0, atol=1e-5)  # one looks by angles
    graph.until(lambda: steps.is_done(HALF))
    steps.tick(SECOND)
    steps.odom.publish(odometry(SECOND))
    steps.eyes["high"].publish(cloud("high", SECOND))
    steps.eyes["low"].publish(cloud("low", SECOND + HALF))  # from the future, whose tick would be the next
    steps.eyes["low"].publish(no_cloud_to_message("low", SECOND))
    graph.until(lambda: steps.is_done(SECOND))
    assert steps.node._rejected == {"low": 1, "high": 0}


def test_it_waits_for_the_odometry_of_robots_also_after_time_went_back(graph: Any) -> None:
    steps = Steps(graph)
    for stamp in (HALF, SECOND, HALF):
        done = len(steps.done)
        steps.tick(stamp)
        for name in EYES:
            steps.eyes[name].publish(cloud(name, stamp, MIDDLE))
        graph.work(0.1)
        assert len(steps.done) == done
        steps.odom.publish(odometry(stamp))
        graph.until(lambda done=done: len(steps.done) > done, f"the tick {stamp}")
        assert inner(steps.area(stamp / SECOND)) > 0.4
    assert steps.node._rejected == {"low": 0, "high": 0}
