"""Robots that floor-level scanners see are no obstacles to the fusion node where their odometry says."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from nav_msgs.msg import Odometry

from snnav_core.types import Pose2D
from snnav_ros.convert import (
    area_from_message,
    nanoseconds_from_stamp,
    odometry_to_message,
)
from snnav_ros.nodes.fusion import FusionNode
from snnav_ros.parameters import ParameterError
from snnav_ros.qos import LOCKSTEP
from support.fusion_site import FLOOR, SECOND, SITE, Site, Steps, in_front_of_north, scan


def test_a_robot_that_a_floor_level_scanner_sees_is_no_obstacle_where_its_odometry_says(graph: Any) -> None:
    site = Site(graph, **FLOOR)
    odometry = graph.speak(Odometry, "cart/odom")
    middle = np.array([[0.0, 7.0]])
    site.at(100)
    site.send(site.north, in_front_of_north(200_000_000, 2.0))
    assert site.area(500_000_000).clearance(middle)[0] < 0.0
    for stamp, at in ((SECOND, (0.0, 7.0)), (1_500_000_000, (3.0, 7.0))):
        site.at(stamp - 200_000_000)
        odometry.publish(odometry_to_message("cart", Pose2D(*at, 0.0), 0.0, 0.0, stamp - 200_000_000))
        graph.until(lambda: bool(site.node._odometry["cart"]))
        site.send(site.north, in_front_of_north(stamp - 100_000_000, 2.0))
        free = site.area(stamp).clearance(middle)[0] > 0.25
        assert free == (at[0] == 0.0), "a robot somewhere else is not what was seen"
    odometry.publish(odometry_to_message("cart", Pose2D(0.0, 7.0, 0.0), 0.0, 0.0, 9 * SECOND))
    graph.until(lambda: bool(site.node._odometry["cart"]))
    site.area(2 * SECOND)
    assert "ahead of the clock" in site.status("robot cart as seen").message


def test_without_floor_level_scanners_no_odometry_is_heard(graph: Any) -> None:
    Site(graph)
    assert graph.probe.count_subscribers("cart/odom") == 0


def test_in_lockstep_it_waits_for_the_odometry_of_robots_that_are_seen_also_after_a_reset(graph: Any) -> None:
    steps = Steps(graph, **FLOOR)
    odometry = graph.speak(Odometry, "cart/odom", LOCKSTEP)
    for stamp in (500_000_000, SECOND, 500_000_000):  # at last time goes back
        done = len(steps.done)
        if stamp == 500_000_000:  # data may be here before their tick
            odometry.publish(odometry_to_message("cart", Pose2D(0.0, 7.0, 0.0), 0.0, 0.0, stamp))
            graph.until(lambda: bool(steps.node._odometry["cart"]))
        steps.tick(stamp)
        steps.south.publish(scan("laser", stamp))
        steps.north.publish(in_front_of_north(stamp, 2.0))
        if stamp == SECOND:
            graph.work(0.2)
            assert len(steps.done) == done
            odometry.publish(odometry_to_message("cart", Pose2D(0.0, 7.0, 0.0), 0.0, 0.0, stamp))
        graph.until(lambda done=done: len(steps.done) > done, f"the tick {stamp}")
        graph.until(
            lambda stamp=stamp: nanoseconds_from_stamp(steps.areas[-1].header.stamp) == stamp, "the area"
        )
        area = area_from_message(steps.areas[-1])
        assert area.clearance(np.array([[0.0, 7.0]]))[0] > 0.35


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"robots": ["cart", "cart"]}, "names a robot twice"),
        ({"robots": [], "accept_robots": False}, "robots: is empty, but sensor north sees robots"),
        ({"north.sees_robots": False}, "no sensor sees robots; set <sensor>.sees_robots"),
        ({"cart.radius": 0.0}, "cart.radius: value 0.0 lies outside"),
        ({"robot_tolerance": -1.0}, "robot_tolerance: value -1.0 lies outside"),
    ],
)
def test_mistakes_about_robots_end_it_at_its_start(graph: Any, changes: dict[str, Any], text: str) -> None:
    with pytest.raises(ParameterError, match=text):
        graph.add(FusionNode, **{**SITE, **FLOOR, **changes})
