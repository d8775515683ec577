"""Robots that join a planner by announcing themselves, leave, and are taken out; and what they are told by whom."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
import shapely
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry, Path
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import SetBool, Trigger

from snnav_core.area.planar import UnoccupiedArea
from snnav_core.types import Pose2D, RobotSpec
from snnav_ros.convert import (
    Announcement,
    announcement_from_message,
    announcement_to_message,
    area_to_message,
    odometry_to_message,
    stamp_message,
    verdict_from_message,
)
from snnav_ros.nodes.planner import PlannerNode
from snnav_ros.nodes.robot import RobotNode
from snnav_ros.parameters import ParameterError
from snnav_ros.qos import INBOX, LATCHED

SECOND = 10**9
SITE = {"sampling_interval": 1.0, "safety_margin": 0.5, "boundary_speed": 0.0, "use_sim_time": True}
HALL = shapely.MultiPolygon([shapely.box(0.0, 0.0, 12.0, 6.0)])
CART = RobotSpec("cart", 0.3, 0.5, 1.0)


class Site:
    """A planner that knows no robot at first, and the voices of robots."""

    def __init__(self, graph: Any, **changes: Any) -> None:
        self.graph = graph
        self.node = graph.add(PlannerNode, lean=False, **{**SITE, **changes})
        self.robots = graph.speak(DiagnosticStatus, "robots", LATCHED)
        self.area = graph.speak(PointCloud2, "unoccupied_area", LATCHED)
        self.clock = graph.speak(Clock, "/clock", 1)
        self.paths = graph.hear(Path, "cart/path")
        self.verdicts = graph.hear(DiagnosticStatus, "cart/certificate")

    def announce(self, stamp: int, spec: RobotSpec | None = CART, name: str = "cart") -> None:
        self.robots.publish(announcement_to_message(Announcement(name, stamp, spec)))

    def until_there(self, *names: str) -> None:
        self.graph.until(lambda: set(self.node.robots) == set(names), f"robots {names}")

    def step(self, stamp: int) -> Any:
        """Make one step with the cart at its place and return the verdict."""
        self.clock.publish(Clock(clock=stamp_message(stamp)))
        self.graph.until(lambda: self.node.get_clock().now().nanoseconds == stamp, "the clock")
        odometry = self.graph.speak(Odometry, "cart/odom")
        odometry.publish(odometry_to_message("cart", Pose2D(2.0, 3.0, 0.0), 0.0, 0.0, stamp))
        self.graph.until(lambda: self.node._states.get("cart", (-1,))[0] == stamp, "odometry")
        count = len(self.verdicts)
        self.area.publish(area_to_message(UnoccupiedArea(stamp / SECOND, HALL)))
        self.graph.until(lambda: len(self.verdicts) > count and len(self.paths) > count, "a decision")
        return verdict_from_message(self.verdicts[-1])

    def drive_to(self, x: float, y: float) -> None:
        goal = PoseStamped()
        goal.header.frame_id = "map"
        goal.pose.position.x, goal.pose.position.y = x, y
        self.graph.speak(PoseStamped, "cart/goal_pose", 1).publish(goal)
        self.graph.until(lambda: self.node._goals.get("cart") == (x, y), "the goal")


def test_a_robot_joins_is_planned_for_is_sent_elsewhere_and_leaves(graph: Any) -> None:
    site = Site(graph)
    assert not site.node.robots
    site.announce(SECOND)
    site.until_there("cart")
    site.drive_to(10.0, 3.0)
    assert site.step(2 * SECOND).certificate.accepted
    end = site.paths[-1].poses[-1].pose.position
    assert (end.x, end.y) == pytest.approx((10.0, 3.0), abs=1e-3)
    site.drive_to(9.0, 1.5)
    assert site.step(3 * SECOND).certificate.accepted
    end = site.paths[-1].poses[-1].pose.position
    assert (end.x, end.y) == pytest.approx((9.0, 1.5), abs=1e-3)
    site.announce(4 * SECOND, None)
    site.until_there()
    site.announce(5 * SECOND)
    site.until_there("cart")
    assert site.node._goals == {}, "who comes again has no goal"


def test_words_that_are_older_than_the_last_one_do_not_count(graph: Any) -> None:
    """As they may come when a planner is started again: of the robot, and of who took it out."""
    site = Site(graph)
    site.announce(5 * SECOND, None)
    site.announce(SECOND)
    site.announce(6 * SECOND, replace(CART, id="other"), "other")
    site.until_there("other")


def test_who_is_said_to_leave_in_the_future_is_there(graph: Any, capfd: pytest.CaptureFixture[str]) -> None:
    site = Site(graph)
    site.announce(SECOND)
    site.until_there("cart")
    site.step(2 * SECOND)
    site.announce(1000 * SECOND, None)
    site.announce(2 * SECOND, replace(CART, id="other"), "other")
    site.until_there("cart", "other")
    assert "leaves in 998.0 s; it counts as there, synchronise the clocks" in capfd.readouterr().err
    site.announce(3 * SECOND, None)
    site.until_there("other")


def test_who_joins_with_a_stamp_of_the_future_may_leave(graph: Any) -> None:
    site = Site(graph)
    site.clock.publish(Clock(clock=stamp_message(2 * SECOND)))
    graph.until(lambda: site.node.get_clock().now().nanoseconds == 2 * SECOND)
    site.announce(1000 * SECOND)
    site.until_there("cart")
    site.announce(3 * SECOND, None)
    site.until_there()


def test_who_left_by_the_word_of_another_planner_is_stopped(graph: Any) -> None:
    """That one stopped it as well, but this one may have given it a path in the meantime."""
    site = Site(graph)
    site.announce(SECOND)
    site.until_there("cart")
    site.drive_to(10.0, 3.0)
    assert site.step(2 * SECOND).certificate.accepted
    assert site.paths[-1].poses
    site.announce(2 * SECOND, None)
    site.until_there()
    graph.until(lambda: not site.paths[-1].poses, "a stop")
    assert site.paths[-1].header.stamp == stamp_message(2 * SECOND)


def test_a_robot_is_taken_out_by_a_service_and_all_are_told(graph: Any) -> None:
    site = Site(graph)
    said = graph.hear(DiagnosticStatus, "robots", INBOX)
    site.announce(SECOND)
    site.until_there("cart")
    site.clock.publish(Clock(clock=stamp_message(2 * SECOND)))
    graph.until(lambda: site.node.get_clock().now().nanoseconds == 2 * SECOND)
    assert graph.call(SetBool, "planner_node/cart/enable", SetBool.Request(data=False)).success
    assert graph.call(Trigger, "planner_node/cart/remove", Trigger.Request()).success
    site.until_there()
    graph.until(lambda: len(site.paths) > 0 and len(said) > 1, "a stop and an announcement")
    assert not site.paths[-1].poses
    assert announcement_from_message(said[-1]) == Announcement("cart", 2 * SECOND, None)
    site.announce(SECOND)
    site.announce(3 * SECOND, replace(CART, id="other"), "other")
    site.until_there("other")


@pytest.mark.parametrize(
    ("spec", "name", "text"),
    [
        (replace(CART, radius=0.4), "cart", "robot cart is there as radius 0.3 m, speed 0.5 m/s"),
        (
            replace(CART, id="big", radius=0.9),
            "big",
            "robot big cannot join: safety_margin 0.5 m is below the radius",
        ),
        (replace(CART, id="planners"), "planners", "'planners' is no name for a robot"),
        (replace(CART, id="mill", speed=400.0), "mill", "robot mill: speed is 400, give 0.001 to 50"),
    ],
)
def test_what_cannot_join_is_named(
    graph: Any, capfd: pytest.CaptureFixture[str], spec: RobotSpec, name: str, text: str
) -> None:
    site = Site(graph)
    site.announce(SECOND)
    site.until_there("cart")
    site.announce(2 * SECOND, spec, name)
    site.announce(3 * SECOND, replace(CART, id="next"), "next")
    site.until_there("cart", "next")
    lines = [line for line in capfd.readouterr().err.splitlines() if "WARN" in line]
    assert len(lines) == 1
    assert text in lines[0]
    assert site.node.robots["cart"] == CART


def test_nobody_joins_where_robots_are_not_accepted(graph: Any, capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(ParameterError, match="robots: is empty"):
        graph.add(PlannerNode, **SITE, accept_robots=False)
    body = {"other.radius": 0.3, "other.speed": 0.5, "other.max_turn_rate": 1.0}
    site = Site(graph, accept_robots=False, robots=["other"], **body)
    site.announce(SECOND)
    graph.work(0.3)
    assert set(site.node.robots) == {"other"}
    assert "robot cart announces itself, accept_robots is false" in capfd.readouterr().err


def test_a_robot_node_says_that_it_comes_and_goes(graph: Any) -> None:
    said = graph.hear(DiagnosticStatus, "robots", INBOX)
    odometry = graph.hear(Odometry, "cart/odom")
    body = {"radius": 0.3, "speed": 0.5, "max_turn_rate": 1.0}
    graph.add(RobotNode, "cart", lean=False, robot_id="cart", **body)
    graph.until(lambda: len(said) == 1 and len(odometry) > 2, "the first word")
    assert announcement_from_message(said[0]).spec == CART
    assert graph.call(SetBool, "cart/present", SetBool.Request(data=False)).success
    graph.until(lambda: len(said) == 2, "the second word")
    gone = announcement_from_message(said[1])
    assert gone.spec is None
    graph.work(0.2)
    last = odometry[-1].header.stamp
    assert last.sec * SECOND + last.nanosec < gone.stamp
    assert graph.call(SetBool, "cart/present", SetBool.Request(data=True)).success
    graph.until(lambda: len(said) == 3 and odometry[-1].header.stamp != last, "the third word")
    assert announcement_from_message(said[2]).spec == CART


def test_times_of_a_robot_in_disorder_end_it_at_its_start(graph: Any) -> None:
    with pytest.raises(ParameterError, match=r"leaves_at: value 2.0 is not after joins_at 3\.0"):
        graph.add(RobotNode, robot_id="cart", joins_at=3.0, leaves_at=2.0)
