"""The planner node and time: what is late, ahead, missing, or of a clock that was set back."""

from __future__ import annotations

from typing import Any

import pytest
import shapely
from nav_msgs.msg import Odometry

from snnav_core.area.planar import UnoccupiedArea
from snnav_core.types import Pose2D, StopReason
from snnav_ros.convert import (
    area_to_message,
    odometry_to_message,
    path_from_message,
    stamp_message,
)
from support.planner_site import HALL, SECOND, Site


def test_without_a_new_area_all_robots_are_stopped(graph: Any) -> None:
    site = Site(graph, max_area_age=2.0)
    site.at(SECOND)
    site.drive_to(10.0, 3.0)
    site.stand(SECOND, Pose2D(2.0, 3.0, 0.0))
    message, _ = site.step(SECOND)
    assert message.poses
    for tick in range(11, 30):
        site.at(tick * SECOND // 10)
    graph.work(0.05)
    assert len(site.paths) == 1  # young enough
    count = len(site.paths)
    for tick in range(30, 45):
        site.at(tick * SECOND // 10)
    message, verdict = site.answer(count)
    assert not message.poses
    assert verdict.stop.reason is StopReason.NO_AREA
    assert "s old; check the fusion node" in verdict.stop.message


def test_area_that_comes_too_late_stops_all_robots(graph: Any) -> None:
    site = Site(graph, max_area_age=2.0, **{"cart.target": [10.0, 3.0]})
    site.stand(3 * SECOND, Pose2D(2.0, 3.0, 0.0))
    site.at(3 * SECOND + SECOND // 10)
    site.area.publish(area_to_message(UnoccupiedArea(1.0, HALL)))
    message, verdict = site.answer(0)
    assert not message.poses
    assert verdict.stop.reason is StopReason.NO_AREA
    assert "the unoccupied area is 2.1 s old" in verdict.stop.message
    assert message.header.stamp == stamp_message(3 * SECOND + SECOND // 10)


def test_area_that_comes_late_is_shrunk_to_the_time_of_the_odometry(graph: Any) -> None:
    site = Site(graph, boundary_speed=0.2, **{"cart.target": [10.0, 3.0]})
    site.stand(SECOND * 3 // 2, Pose2D(2.0, 3.0, 0.0))
    site.area.publish(area_to_message(UnoccupiedArea(1.0, HALL)))
    message, verdict = site.answer(0)
    assert message.header.stamp == stamp_message(SECOND * 3 // 2)
    assert verdict.certificate.area_stamp == 1.0
    ends = shapely.Point(path_from_message(message).points[0]).distance(HALL.boundary)
    assert verdict.certificate.least_clearance <= ends - 0.5 * 0.2
    site.area.publish(area_to_message(UnoccupiedArea(1.2, HALL)))  # nothing newer is known of the robot
    graph.until(lambda: site.node._area_stamp == SECOND * 6 // 5)
    assert len(site.paths) == 1


@pytest.mark.parametrize("what", ["area", "odometry"])
def test_what_is_stamped_ahead_is_not_used(graph: Any, capfd: pytest.CaptureFixture[str], what: str) -> None:
    site = Site(graph, **{"cart.target": [10.0, 3.0]})
    site.stand(SECOND, Pose2D(2.0, 3.0, 0.0))
    ahead = SECOND + SECOND // 10
    if what == "area":
        site.area.publish(area_to_message(UnoccupiedArea(ahead / SECOND, HALL)))
    else:
        site.odometry.publish(odometry_to_message("cart", Pose2D(3.0, 3.0, 0.0), 0.0, 0.0, ahead))
    graph.until(lambda: bool(site.node._problems))
    (problem,) = site.node._problems.values()
    assert "stamped 0.100 s ahead of the planner's clock, more than clock_tolerance 0.05 s" in problem
    assert problem in capfd.readouterr().err
    assert not site.paths
    message, _ = site.step(SECOND + SECOND // 5)
    assert path_from_message(message).points[0] == pytest.approx([2.0, 3.0])


def test_planner_that_is_started_in_mid_run_waits_for_its_clock(
    graph: Any, capfd: pytest.CaptureFixture[str]
) -> None:
    site = Site(graph, **{"cart.target": [10.0, 3.0]})
    site.odometry.publish(odometry_to_message("cart", Pose2D(2.0, 3.0, 0.0), 0.0, 0.0, 30 * SECOND))
    site.area.publish(area_to_message(UnoccupiedArea(30.0, HALL)))
    graph.until(lambda: {"cart/odom", "unoccupied_area"} <= site.node._waiting._heard)
    assert not site.paths
    assert "message not used" not in capfd.readouterr().err
    site.stand(31 * SECOND, Pose2D(2.0, 3.0, 0.0))
    message, _ = site.step(31 * SECOND)
    assert message.poses


def test_time_that_jumps_back_starts_afresh(graph: Any) -> None:
    site = Site(graph, **{"cart.target": [10.0, 3.0]})
    site.at(100 * SECOND)
    site.stand(100 * SECOND, Pose2D(2.0, 3.0, 0.0))
    first, _ = site.step(100 * SECOND)
    assert first.poses
    site.at(SECOND)
    assert not site.node._states
    site.stand(SECOND, Pose2D(2.0, 3.0, 0.0))
    again, verdict = site.step(SECOND)
    assert again.poses
    assert verdict.stamp == 1.0
    assert [pose.pose for pose in again.poses] == [pose.pose for pose in first.poses]


VAN = {"robots": ["cart", "van"], "van.radius": 0.3, "van.speed": 0.5, "van.max_turn_rate": 1.0}


def test_who_was_not_heard_yet_may_drive_as_long_as_a_window_lasts(graph: Any) -> None:
    """A planner that begins again in mid-run hears one robot before another."""
    site = Site(graph, time_window=3, **VAN, **{"cart.target": [10.0, 3.0]})
    for second in range(1, 4):
        site.stand(second * SECOND, Pose2D(2.0, 3.0, 0.0))
        site.area.publish(area_to_message(UnoccupiedArea(second, HALL)))
        graph.until(lambda second=second: site.node._decided == second * SECOND, "the area")
        assert not site.paths
        assert "no odometry of robot van yet" in site.node._problems["hold"]
    site.stand(4 * SECOND, Pose2D(2.0, 3.0, 0.0))
    assert site.step(4 * SECOND)[0].poses  # whatever was certified for the other one has ended
    assert "hold" not in site.node._problems


def test_paths_come_as_soon_as_all_were_heard(graph: Any) -> None:
    site = Site(graph, time_window=3, **VAN, **{"cart.target": [10.0, 3.0]})
    site.stand(SECOND, Pose2D(2.0, 3.0, 0.0))
    site.area.publish(area_to_message(UnoccupiedArea(1.0, HALL)))
    graph.until(lambda: site.node._decided == SECOND, "the area")
    assert not site.paths
    van = graph.speak(Odometry, "van/odom")
    van.publish(odometry_to_message("van", Pose2D(2.0, 5.0, 0.0), 0.0, 0.0, SECOND))
    graph.until(lambda: "van" in site.node._states, "odometry of the other one")
    site.stand(2 * SECOND, Pose2D(2.0, 3.0, 0.0))
    assert site.step(2 * SECOND)[0].poses
