"""The planner node: certified paths and typed stops from areas and odometry by hand."""

from __future__ import annotations

from typing import Any

import pytest
import shapely
from std_srvs.srv import SetBool, Trigger
from visualization_msgs.msg import MarkerArray

from snnav_core.area.planar import LostPart, UnoccupiedArea
from snnav_core.types import Pose2D, StopReason
from snnav_ros.convert import (
    area_to_message,
    lost_to_message,
    path_from_message,
    stamp_message,
)
from snnav_ros.convert.seal import seal_of
from snnav_ros.nodes.planner import PlannerNode
from snnav_ros.parameters import ParameterError
from snnav_ros.qos import LATCHED
from support.planner_site import HALL, SECOND, SITE, Site


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
