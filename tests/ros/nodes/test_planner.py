"""The planner node: certified paths and typed stops from areas and odometry by hand."""

from __future__ import annotations

from typing import Any

import pytest
import shapely
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry, Path
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import SetBool, Trigger
from visualization_msgs.msg import MarkerArray

from snnav_core.area.planar import LostPart, UnoccupiedArea
from snnav_core.types import Pose2D, StopReason
from snnav_ros.convert import (
    area_to_message,
    lost_to_message,
    odometry_to_message,
    path_from_message,
    stamp_message,
    verdict_from_message,
)
from snnav_ros.convert.seal import seal_of
from snnav_ros.nodes.planner import PlannerNode
from snnav_ros.parameters import ParameterError
from snnav_ros.qos import LATCHED

SECOND = 10**9
SITE = {
    "sampling_interval": 1.0,
    "safety_margin": 0.5,
    "boundary_speed": 0.0,
    "robots": ["cart"],
    "cart.radius": 0.3,
    "cart.speed": 0.5,
    "cart.max_turn_rate": 1.0,
    "use_sim_time": True,
}
HALL = shapely.MultiPolygon([shapely.box(0.0, 0.0, 12.0, 6.0)])


class Site:
    """A planner of one cart in an empty hall."""

    def __init__(self, graph: Any, **changes: Any) -> None:
        self.graph = graph
        self.paths = graph.hear(Path, "cart/path")
        self.verdicts = graph.hear(DiagnosticStatus, "cart/certificate")
        self.diagnostics = graph.hear(DiagnosticArray, "/diagnostics")
        self.node = graph.add(PlannerNode, lean=False, **{**SITE, **changes})
        self.area = graph.speak(PointCloud2, "unoccupied_area", LATCHED)
        self.odometry = graph.speak(Odometry, "cart/odom")
        self.goal = graph.speak(PoseStamped, "cart/goal_pose", 1)
        self.clock = graph.speak(Clock, "/clock", 1)

    def at(self, stamp: int) -> None:
        self.clock.publish(Clock(clock=stamp_message(stamp)))
        self.graph.until(lambda: self.node.get_clock().now().nanoseconds == stamp, "the clock")

    def drive_to(self, x: float, y: float, frame: str = "map") -> None:
        message = PoseStamped()
        message.header.frame_id = frame
        message.pose.position.x, message.pose.position.y = x, y
        self.goal.publish(message)
        if frame == "map":
            self.graph.until(lambda: self.node._goals.get("cart") == (x, y), "the goal")

    def stand(self, stamp: int, pose: Pose2D, frame: str = "map") -> None:
        self.at(stamp)
        message = odometry_to_message("cart", pose, 0.0, 0.0, stamp)
        message.header.frame_id = frame
        self.odometry.publish(message)
        topic = "cart/odom"
        self.graph.until(
            lambda: self.node._states.get("cart", (-1,))[0] == stamp or topic in self.node._problems,
            "odometry",
        )

    def status(self, name: str) -> DiagnosticStatus:
        stamp = self.paths[-1].header.stamp
        self.graph.until(
            lambda: self.diagnostics and self.diagnostics[-1].header.stamp == stamp, "diagnostics"
        )
        return next(one for one in self.diagnostics[-1].status if one.name == name)

    def step(self, stamp: int, region: shapely.MultiPolygon = HALL) -> tuple[Any, Any]:
        """Publish an area; return path and verdict of the step that follows."""
        self.at(stamp)
        count = len(self.paths)
        self.area.publish(area_to_message(UnoccupiedArea(stamp / SECOND, region)))
        return self.answer(count)

    def answer(self, count: int) -> tuple[Any, Any]:
        self.graph.until(lambda: len(self.paths) > count and len(self.verdicts) > count, "a decision")
        return self.paths[-1], verdict_from_message(self.verdicts[-1])


def test_area_odometry_and_goal_give_a_certified_path(graph: Any) -> None:
    site = Site(graph)
    site.drive_to(10.0, 3.0)
    site.stand(SECOND, Pose2D(2.0, 3.0, 0.0))
    message, verdict = site.step(SECOND)
    path = path_from_message(message)
    assert path is not None
    assert message.header.stamp == stamp_message(SECOND)
    assert verdict.certificate.accepted
    assert verdict.certificate.path_digest == path.digest()
    assert verdict.certificate.area_stamp == 1.0
    assert verdict.certificate.valid_until > 1.0
    assert path.points[0] == pytest.approx([2.0, 3.0])
    assert path.points[-1] == pytest.approx([10.0, 3.0], abs=1e-3)
    clearance = shapely.distance(shapely.points(path.points), HALL.boundary).min()
    assert clearance >= 0.5
    values = {pair.key: pair.value for pair in site.status("planner").values}
    assert float(values["step_ms"]) > 0.0
    assert values["deadline_misses"] == ("1" if float(values["step_ms"]) > 1000.0 else "0")


@pytest.mark.parametrize(
    ("place", "goal", "region", "reason"),
    [
        (None, (10.0, 3.0), HALL, StopReason.NO_STATE),
        (Pose2D(2.0, 3.0, 0.0), None, HALL, StopReason.NO_GOAL),
        (Pose2D(2.0, 3.0, 0.0), (10.0, 3.0), shapely.MultiPolygon(), StopReason.NO_AREA),
        (Pose2D(2.0, 3.0, 0.0), (2.0, 3.05), HALL, StopReason.ARRIVED),
        (Pose2D(2.0, 3.0, 0.0), (30.0, 3.0), HALL, StopReason.GOAL_BLOCKED),
        (Pose2D(-2.0, 3.0, 0.0), (10.0, 3.0), HALL, StopReason.START_BLOCKED),
        (
            Pose2D(2.0, 3.0, 0.0),
            (10.0, 3.0),
            shapely.MultiPolygon([shapely.box(0, 0, 5, 6), shapely.box(6, 0, 12, 6)]),
            StopReason.GOAL_UNREACHABLE,
        ),
    ],
)
def test_a_stop_is_an_empty_path_with_its_reason(
    graph: Any,
    place: Pose2D | None,
    goal: tuple[float, float] | None,
    region: shapely.MultiPolygon,
    reason: StopReason,
) -> None:
    site = Site(graph)
    if goal is not None:
        site.drive_to(*goal)
    if place is not None:
        site.stand(SECOND, place)
    message, verdict = site.step(SECOND, region)
    assert not message.poses
    assert message.header.stamp == stamp_message(SECOND)
    assert verdict.stop.reason is reason
    assert verdict.stop.message
    assert verdict.stamp == 1.0


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


def test_reason_of_a_stop_is_said_once_and_again_when_it_changes(
    graph: Any, capfd: pytest.CaptureFixture[str]
) -> None:
    site = Site(graph, **{"cart.target": [10.0, 3.0]})
    said = ""
    for tick, x in enumerate([2.0, 2.0, -2.0, -2.0, 2.0, 9.99], start=1):
        site.stand(tick * SECOND, Pose2D(x, 3.0, 0.0))
        shut = shapely.MultiPolygon([shapely.box(0, 0, 5, 6), shapely.box(6, 0, 12, 6)])
        _, verdict = site.step(tick * SECOND, shut if tick < 3 else HALL)
        said += capfd.readouterr().err
        if tick == 1:
            assert f"cart stops (goal_unreachable): {verdict.stop.message}" in said
            assert site.status("robot cart").message == verdict.stop.message
    lines = [line for line in said.splitlines() if "robot cart " in line]
    assert [line.partition("]")[0].strip("[") for line in lines] == ["WARN", "WARN", "INFO", "INFO"]
    words = ["stops (goal_unreachable)", "stops (start_blocked)", "drives again", "stops (arrived)"]
    assert all(word in line for word, line in zip(words, lines, strict=True))


def test_silent_sensor_is_named_in_a_refusal(graph: Any) -> None:
    site = Site(graph, **{"cart.target": [10.0, 3.0]})
    lost = graph.speak(MarkerArray, "unoccupied_area/lost", LATCHED)
    site.stand(2 * SECOND, Pose2D(2.0, 3.0, 0.0))
    half = shapely.MultiPolygon([shapely.box(0, 0, 5, 6)])
    part = LostPart("lms_east", 1.0, shapely.MultiPolygon([shapely.box(4.9, 0, 12, 6)]))
    lost.publish(lost_to_message(UnoccupiedArea(2.0, half, lost=(part,))))
    graph.until(lambda: bool(site.node._lost))
    _, verdict = site.step(2 * SECOND, half)
    assert "lms_east" in verdict.stop.message
    assert "lms_east" in site.status("robot cart").message
    lost.publish(lost_to_message(UnoccupiedArea(3.0, HALL)))
    graph.until(lambda: not site.node._lost)
    for second in (3, 4):  # a search is repeated every other step
        site.stand(second * SECOND, Pose2D(2.0, 3.0, 0.0))
        message, _ = site.step(second * SECOND)
    assert message.poses


def test_lost_parts_that_lie_are_not_used(graph: Any) -> None:
    site = Site(graph)
    graph.speak(MarkerArray, "unoccupied_area/lost", LATCHED).publish(MarkerArray())
    graph.until(lambda: bool(site.node._problems))
    assert "must delete all" in site.node._problems["unoccupied_area/lost"]


def test_path_and_certificate_bear_one_seal_over_both(graph: Any) -> None:
    site = Site(graph, **{"cart.target": [10.0, 3.0]})
    site.stand(SECOND, Pose2D(2.0, 3.0, 0.0))
    message, verdict = site.step(SECOND)
    assert verdict.seal == seal_of(message, site.verdicts[-1])
    stop, reason = site.step(2 * SECOND)  # its odometry is too old by now
    assert reason.seal == seal_of(stop, site.verdicts[-1])


def test_odometry_that_lies_is_not_used(graph: Any) -> None:
    site = Site(graph)
    site.drive_to(10.0, 3.0)
    site.stand(SECOND, Pose2D(2.0, 3.0, 0.0), frame="base")
    _, verdict = site.step(SECOND)
    assert verdict.stop.reason is StopReason.NO_STATE
    assert "cart/odom: frame_id is 'base', expected 'map'" in site.status("planner").message


def test_frames_that_coincide_with_the_map_are_a_parameter(graph: Any) -> None:
    site = Site(graph, odometry_frames=["map", "{robot}/odom"])
    site.drive_to(10.0, 3.0)
    site.stand(SECOND, Pose2D(2.0, 3.0, 0.0), frame="cart/odom")
    message, _ = site.step(SECOND)
    assert message.poses


def test_area_that_lies_is_not_used(graph: Any) -> None:
    site = Site(graph)
    site.at(SECOND)
    message = area_to_message(UnoccupiedArea(1.0, HALL))
    message.header.frame_id = "odom"
    site.area.publish(message)
    graph.until(lambda: bool(site.node._problems))
    assert not site.paths
    assert "frame_id is 'odom'" in site.node._problems["unoccupied_area"]


def test_goal_of_another_frame_is_not_taken(graph: Any, capfd: pytest.CaptureFixture[str]) -> None:
    site = Site(graph)
    site.drive_to(1.0, 1.0, frame="odom")
    told = ""

    def refused() -> bool:
        nonlocal told
        told += capfd.readouterr().err
        return "goal not taken: cart/goal_pose: frame_id is 'odom'" in told

    graph.until(refused)
    assert not site.node._goals


def test_first_goal_can_be_a_parameter_and_a_new_one_replaces_it(graph: Any) -> None:
    site = Site(graph, **{"cart.target": [10.0, 3.0]})
    site.stand(SECOND, Pose2D(2.0, 3.0, 0.0))
    message, _ = site.step(SECOND)
    assert path_from_message(message).points[-1] == pytest.approx([10.0, 3.0], abs=1e-3)
    site.drive_to(8.0, 4.0)
    site.stand(2 * SECOND, Pose2D(2.0, 3.0, 0.0))
    message, _ = site.step(2 * SECOND)
    assert path_from_message(message).points[-1] == pytest.approx([8.0, 4.0], abs=1e-3)


def test_robot_can_be_switched_off_and_the_planner_reset(graph: Any) -> None:
    site = Site(graph, **{"cart.target": [10.0, 3.0]})
    assert graph.call(SetBool, "planner_node/cart/enable", SetBool.Request(data=False)).success
    site.stand(SECOND, Pose2D(2.0, 3.0, 0.0))
    message, verdict = site.step(SECOND)
    assert not message.poses
    assert verdict.stop.reason is StopReason.NO_GOAL
    graph.call(SetBool, "planner_node/cart/enable", SetBool.Request(data=True))
    assert graph.call(Trigger, "planner_node/reset", Trigger.Request()).success
    site.stand(2 * SECOND, Pose2D(2.0, 3.0, 0.0))
    message, _ = site.step(2 * SECOND)
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


def test_says_what_it_waits_for(graph: Any, capfd: pytest.CaptureFixture[str]) -> None:
    graph.add(PlannerNode, **SITE)
    assert "waiting for: unoccupied_area, cart/odom, cart/goal_pose" in capfd.readouterr().err


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"safety_margin": 0.2}, "safety_margin 0.2 m is below the radius 0.3 m of robot cart"),
        ({"boundary_speed": 0.6}, "boundary_speed 0.6 m/s must be below the speed 0.5 m/s of robot cart"),
        ({"robots": ["cart", "cart"]}, "names a robot twice"),
        ({"cart.target": [1.0]}, r"cart.target: value \[1.0\] is no point"),
        ({"cart.speed": 0.0}, "cart.speed: value 0.0 lies outside"),
        ({"max_area_age": 0.0}, "max_area_age: value 0.0 lies outside"),
        ({"time_window": 0}, "time_window: value 0 lies outside"),
        ({"adjustment.pull": 0.0}, "adjustment.pull: value 0.0 lies outside"),
        ({"adjustment.push": 0.1}, "adjustment.push: is unknown .*did you mean adjustment.pull"),
    ],
)
def test_mistakes_end_it_at_its_start(graph: Any, changes: dict[str, Any], text: str) -> None:
    with pytest.raises(ParameterError, match=text):
        graph.add(PlannerNode, **{**SITE, **changes})


def test_parameters_go_before_the_scene(graph: Any) -> None:
    node = graph.add(PlannerNode, scene="hello", safety_margin=0.6, **{"robot_1.speed": 0.4})
    assert node.navigator_settings.safety_margin == 0.6
    assert node.navigator_settings.sampling_interval == 0.5
    assert node.robots["robot_1"].speed == 0.4
    assert node.robots["robot_1"].max_turn_rate == 1.6
    assert node.get_parameter("robot_1.target").value[0] == 8.8
