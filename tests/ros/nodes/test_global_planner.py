"""The global planner node: timed paths, typed stops and answers by hand from bodies and odometry."""

from __future__ import annotations

import array
from typing import Any

import numpy as np
import pytest
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import SetBool

from snnav_core.obstacles import MovingObstacle
from snnav_core.types import PathSource, Pose2D, StopReason
from snnav_ros.convert import (
    obstacles_to_message,
    path_from_message,
    plans_from_message,
    rings_to_message,
)
from snnav_ros.convert.seal import SEAL_KEY, seal_of
from snnav_ros.nodes.global_planner import GlobalPlannerNode
from snnav_ros.parameters import ParameterError
from snnav_sim.warm_up import warm_up
from support.global_site import HALL, INTERVAL, SECOND, SITE, Site, bodies, started


@pytest.fixture(autouse=True, scope="module")
def _kernels() -> None:
    warm_up()


def test_bodies_odometry_and_goal_give_a_sealed_path_and_all_candidates(graph: Any) -> None:
    site = started(graph)
    message, verdict = site.step(SECOND)
    path = path_from_message(message)
    assert path is not None
    assert verdict.certificate.accepted
    assert verdict.certificate.path_digest == path.digest()
    assert 1.0 < verdict.certificate.valid_until <= 1.0 + 4 * 0.3
    assert verdict.source is PathSource.SPACETIME
    assert verdict.seal == seal_of(message, site.verdicts[-1])
    assert {pair.key for pair in site.verdicts[-1].values} >= {SEAL_KEY}
    assert path.points[-1] == pytest.approx([10.0, 2.0], abs=1e-6)
    graph.until(lambda: bool(site.candidates), "candidates")
    stamp, plan = plans_from_message(site.candidates[-1])["cart"]
    assert stamp == SECOND
    assert plan.path.digest() == path.digest()
    values = {pair.key: pair.value for pair in site.status("planner").values}
    assert values["cart candidates"] == str(len(plan.candidates))
    assert values["candidates_stamp"] == "1.0"
    assert float(values["cart gap"]) >= 0.0


def test_body_in_the_way_is_passed_on_both_sides_and_the_robot_turns_first(graph: Any) -> None:
    site = started(graph, 4.0)
    message, verdict = site.step(SECOND)
    assert verdict.source is PathSource.TURN_IN_PLACE
    graph.until(lambda: bool(site.candidates), "candidates")
    _, plan = plans_from_message(site.candidates[-1])["cart"]
    assert {side for one in plan.candidates for body, side in one.turns if body == "body_1"} == {1, -1}
    assert path_from_message(message).turn_to == pytest.approx(plan.path.headings[0], abs=1e-6)


def test_rest_of_the_path_comes_every_interval_and_candidates_only_when_they_change(graph: Any) -> None:
    site = started(graph)
    _, first = site.step(SECOND)
    whole = path_from_message(site.paths[-1])
    assert whole is not None
    for k in range(1, 4):
        stamp = SECOND + k * INTERVAL
        x, y = whole.positions_at(np.array([stamp / SECOND]))[0]
        site.stand(stamp, Pose2D(x, y, 0.0))
        message, verdict = site.step(stamp)
        rest = path_from_message(message)
        assert rest is not None
        assert rest.points[0] == pytest.approx([x, y], abs=1e-6)
        assert rest.end_time == pytest.approx(whole.end_time, abs=1e-6)
        assert verdict.certificate.valid_until > first.certificate.valid_until
    assert len(site.candidates) == 1


@pytest.mark.parametrize(
    ("place", "goal", "rings", "there", "reason"),
    [
        (None, (10.0, 4.0), (HALL,), None, StopReason.NO_STATE),
        (Pose2D(2.0, 4.0, 0.0), None, (HALL,), None, StopReason.NO_GOAL),
        (Pose2D(2.0, 4.0, 0.0), (2.0, 4.02), (HALL,), None, StopReason.ARRIVED),
        (Pose2D(2.0, 4.0, 0.0), (6.0, 4.0), (HALL,), None, StopReason.GOAL_BLOCKED),
        (Pose2D(5.3, 4.0, 0.0), (10.0, 4.0), (HALL,), None, StopReason.START_BLOCKED),
        (
            Pose2D(2.0, 4.0, 0.0),
            (10.0, 4.0),
            (HALL - [6.5, 0.0], HALL - [-6.0, 0.0]),
            [],
            StopReason.GOAL_UNREACHABLE,
        ),
        (
            Pose2D(2.0, 4.0, 0.0),
            (10.0, 4.0),
            (HALL,),
            [MovingObstacle("body_1", [[5.0, 7.0]], 0.3, stamp=1.0, velocity_deviation=2.0)],
            StopReason.NOT_TRACKED,
        ),
    ],
)
def test_a_stop_is_an_empty_path_with_its_reason(
    graph: Any, place: Any, goal: Any, rings: Any, there: Any, reason: StopReason
) -> None:
    site = Site(graph)
    if goal is not None:
        site.drive_to(*goal)
    if place is not None:
        site.stand(SECOND, place)
    message, verdict = site.step(SECOND, there, rings)
    assert not message.poses
    assert verdict.stop.reason is reason
    assert verdict.seal == seal_of(message, site.verdicts[-1])


def test_nothing_known_to_be_free_is_no_open_plane(graph: Any) -> None:
    site = started(graph)
    message, verdict = site.step(SECOND, [], ())
    assert not message.poses
    assert verdict.stop.reason is StopReason.NO_AREA


def test_body_that_moves_otherwise_leads_to_another_plan(graph: Any) -> None:
    site = started(graph, retry=1)
    site.step(SECOND, bodies(SECOND, 0.05))
    whole = path_from_message(site.paths[-1])
    assert whole is not None
    stamp = SECOND + INTERVAL
    x, y = whole.positions_at(np.array([stamp / SECOND]))[0]
    site.stand(stamp, Pose2D(x, y, 0.0))
    # it turns into the way of the robot
    walker = MovingObstacle("body_2", [[5.0, 3.3]], 0.3, [0.0, -0.3], stamp / SECOND, 0.005, 0.01)
    message, verdict = site.step(stamp, [bodies(stamp)[0], walker])
    assert message.poses, verdict
    graph.until(lambda: len(site.candidates) == 2, "other candidates")
    stamps = [plans_from_message(message)["cart"][0] for message in site.candidates]
    assert stamps == [SECOND, stamp]


def test_silent_tracker_stops_the_robot_with_a_reason(graph: Any) -> None:
    site = started(graph)
    message, _ = site.step(SECOND)
    assert message.poses
    count = len(site.paths)
    for k in range(1, 5):
        site.at(SECOND + k * INTERVAL)
        graph.work(0.02)
    message, verdict = site.answer(count)
    assert not message.poses
    assert verdict.stop.reason is StopReason.NO_AREA
    assert "check the tracker node" in verdict.stop.message
    assert "the obstacles are" in site.status("robot cart").message


def altered(message: PointCloud2, offset: int, value: float) -> PointCloud2:
    data = bytearray(message.data)
    data[offset : offset + 8] = np.float64(value).tobytes()
    message.data = array.array("B", bytes(data))
    return message


def in_frame(message: PointCloud2, frame: str) -> PointCloud2:
    message.header.frame_id = frame
    return message


NEXT = SECOND + INTERVAL
REFUSED = {
    "NaN": ("obstacles", altered(obstacles_to_message(bodies(NEXT), NEXT), 0, np.nan), "contain NaN"),
    "fields": ("obstacles", rings_to_message((HALL,), NEXT), "fields are"),
    "frame": ("obstacles", in_frame(obstacles_to_message(bodies(NEXT), NEXT), "odom"), "frame_id is 'odom'"),
    "back": (
        "obstacles",
        obstacles_to_message([], SECOND // 2),
        "after one stamped 1.000 s; is there another",
    ),
    "ahead": ("obstacles", obstacles_to_message([], 3 * SECOND), "1.700 s ahead of the planner's clock"),
    "ring NaN": ("obstacles/workspace", altered(rings_to_message((HALL,), NEXT), 0, np.nan), "ring 0 has 4"),
    "ring of two": ("obstacles/workspace", rings_to_message((HALL[:2],), NEXT), "ring 0 has 2 vertices"),
    "ring frame": ("obstacles/workspace", in_frame(rings_to_message((HALL,), NEXT), "x"), "frame_id is 'x'"),
    "ring back": ("obstacles/workspace", rings_to_message((HALL,), SECOND // 2), "after one stamped 1.000 s"),
}


@pytest.mark.parametrize("kind", REFUSED)
def test_what_cannot_be_used_is_refused_and_said(
    graph: Any, kind: str, capfd: pytest.CaptureFixture[str]
) -> None:
    topic, message, text = REFUSED[kind]
    site = started(graph)
    site.step(SECOND)
    site.at(NEXT)
    count = len(site.paths)
    (site.obstacles if topic == "obstacles" else site.workspace).publish(message)
    graph.until(lambda: bool(site.node._problems), "a refusal")
    (problem,) = site.node._problems.values()
    assert problem.startswith(topic)
    assert text in problem
    assert f"message not used: {topic}" in capfd.readouterr().err
    graph.work(0.05)
    assert len(site.paths) == count
    site.stand(NEXT + 1, Pose2D(2.0, 2.0, 0.0))
    site.step(NEXT + 1)
    assert not site.node._problems


def test_time_that_jumps_back_starts_afresh(graph: Any) -> None:
    site = started(graph)
    site.step(5 * SECOND)
    site.at(SECOND)
    assert not site.node._states
    assert site.node._scene is None
    assert not site.node._navigator.plans
    site.stand(SECOND, Pose2D(2.0, 2.0, 0.0))
    message, verdict = site.step(SECOND)
    assert message.poses
    assert verdict.stamp == 1.0


def test_robot_is_disabled_and_enabled_by_hand(graph: Any) -> None:
    site = started(graph)
    graph.call(SetBool, "global_planner_node/cart/enable", SetBool.Request(data=False))
    _, verdict = site.step(SECOND)
    assert verdict.stop.reason is StopReason.NO_GOAL
    graph.call(SetBool, "global_planner_node/cart/enable", SetBool.Request(data=True))
    site.stand(NEXT, Pose2D(2.0, 2.0, 0.0))
    message, _ = site.step(NEXT)
    assert message.poses


def test_mistakes_end_the_planner_at_its_start(graph: Any) -> None:
    for changes, text in [
        ({"safety_margin": 0.2}, "safety_margin 0.2 m is below the radius"),
        ({"candidates": 0}, "candidates: value 0 lies outside"),
        ({"longest_link": 1.0}, "longest_link is 1.0, must be above 1"),
        ({"robots": ["cart", "cart"]}, "names a robot twice"),
        ({"boundary_speed": 0.1}, "boundary_speed: is unknown"),
    ]:
        with pytest.raises(ParameterError, match=text):
            graph.add(GlobalPlannerNode, **{**SITE, **changes})
    with pytest.raises(ParameterError, match="sampling_interval: is not given"):
        graph.add(GlobalPlannerNode)
