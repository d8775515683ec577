"""The global planner node: timed paths, typed stops and answers by hand from bodies and odometry."""

from __future__ import annotations

import array
import re
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry, Path
from nav_msgs.srv import GetPlan
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import SetBool
from visualization_msgs.msg import MarkerArray

from snnav_core.obstacles import MovingObstacle
from snnav_core.types import PathSource, Pose2D, StopReason
from snnav_ros.convert import (
    obstacles_to_message,
    odometry_to_message,
    path_from_message,
    plans_from_message,
    rings_to_message,
    stamp_message,
    verdict_from_message,
)
from snnav_ros.convert.seal import SEAL_KEY, seal_of
from snnav_ros.nodes.global_planner import GlobalPlannerNode
from snnav_ros.parameters import ParameterError
from snnav_ros.qos import LATCHED
from snnav_sim.warm_up import warm_up

SECOND = 10**9
INTERVAL = 3 * SECOND // 10
SITE = {
    "sampling_interval": 0.3,
    "safety_margin": 0.6,
    "robots": ["cart"],
    "cart.radius": 0.3,
    "cart.speed": 0.5,
    "cart.max_turn_rate": 2.0,
    "lead": 0,
    "use_sim_time": True,
}
HALL = np.array([[0.0, 0.0], [12.0, 0.0], [12.0, 8.0], [0.0, 8.0]])
PILLAR = np.array([[5.5, 3.0], [6.5, 3.0], [6.5, 4.5], [5.5, 4.5]])


@pytest.fixture(autouse=True, scope="module")
def _kernels() -> None:
    warm_up()


def bodies(stamp: int, walker: float = 0.0) -> list[MovingObstacle]:
    """Return a pillar, and a walker far from the way with a speed along x [m/s]."""
    time = stamp / SECOND
    place = [3.0 + walker * time, 7.0]
    walks = MovingObstacle("body_2", [place], 0.3, [walker, 0.0], time, 0.005, 0.01)
    return [MovingObstacle("body_1", PILLAR, 0.0, [0.0, 0.0], time), walks]


class Site:
    """A planner of one cart in a hall with a pillar."""

    def __init__(self, graph: Any, **changes: Any) -> None:
        self.graph = graph
        self.paths = graph.hear(Path, "cart/path")
        self.verdicts = graph.hear(DiagnosticStatus, "cart/certificate")
        self.candidates = graph.hear(MarkerArray, "candidates", LATCHED)
        self.diagnostics = graph.hear(DiagnosticArray, "/diagnostics")
        self.node = graph.add(GlobalPlannerNode, lean=False, **{**SITE, **changes})
        self.obstacles = graph.speak(PointCloud2, "obstacles", LATCHED)
        self.workspace = graph.speak(PointCloud2, "obstacles/workspace", LATCHED)
        self.odometry = graph.speak(Odometry, "cart/odom")
        self.goal = graph.speak(PoseStamped, "cart/goal_pose", 1)
        self.clock = graph.speak(Clock, "/clock", 1)

    def at(self, stamp: int) -> None:
        self.clock.publish(Clock(clock=stamp_message(stamp)))
        self.graph.until(lambda: self.node.get_clock().now().nanoseconds == stamp, "the clock")

    def drive_to(self, x: float, y: float) -> None:
        self.goal.publish(posed(x, y))
        self.graph.until(lambda: self.node._goals.get("cart") == (x, y), "the goal")

    def stand(self, stamp: int, pose: Pose2D) -> None:
        self.at(stamp)
        self.odometry.publish(odometry_to_message("cart", pose, 0.0, 0.0, stamp))
        self.graph.until(lambda: self.node._states.get("cart", (-1,))[0] == stamp, "odometry")

    def step(
        self, stamp: int, there: Sequence[MovingObstacle] | None = None, rings: Any = (HALL,)
    ) -> tuple[Any, Any]:
        """Publish bodies and workspace; return path and verdict of the step that follows."""
        self.at(stamp)
        count = len(self.paths)
        there = bodies(stamp) if there is None else there
        self.workspace.publish(rings_to_message(rings, stamp))
        self.obstacles.publish(obstacles_to_message(there, stamp))
        return self.answer(count)

    def answer(self, count: int) -> tuple[Any, Any]:
        self.graph.until(lambda: len(self.paths) > count and len(self.verdicts) > count, "a decision")
        return self.paths[-1], verdict_from_message(self.verdicts[-1])

    def status(self, name: str) -> DiagnosticStatus:
        def found() -> list[DiagnosticStatus]:
            return [one for array_ in self.diagnostics for one in array_.status if one.name == name]

        self.graph.until(lambda: bool(found()), f"status {name}")
        return found()[-1]

    def ask(self, goal: PoseStamped, start: PoseStamped | None = None, tolerance: float = 0.0) -> Path:
        request = GetPlan.Request(start=start or PoseStamped(), goal=goal, tolerance=tolerance)
        return self.graph.call(GetPlan, "plan", request).plan


def posed(x: float, y: float, frame: str = "map") -> PoseStamped:
    message = PoseStamped()
    message.header.frame_id = frame
    message.pose.position.x, message.pose.position.y = x, y
    return message


def started(graph: Any, y: float = 2.0) -> Site:
    """Return a site whose robot goes straight along the hall: below the pillar, unless `y` says otherwise."""
    site = Site(graph)
    site.drive_to(10.0, y)
    site.stand(SECOND, Pose2D(2.0, y, 0.0))
    return site


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
    assert verdict.stop is not None


def test_body_that_moves_otherwise_leads_to_another_plan(graph: Any) -> None:
    site = started(graph)
    site.step(SECOND, bodies(SECOND, 0.05))
    assert len(site.candidates) == 1
    whole = path_from_message(site.paths[-1])
    assert whole is not None
    stamp = SECOND + INTERVAL
    x, y = whole.positions_at(np.array([stamp / SECOND]))[0]
    site.stand(stamp, Pose2D(x, y, 0.0))
    # it turns into the way of the robot
    walker = MovingObstacle("body_2", [[5.0, 3.8]], 0.3, [0.0, -0.3], stamp / SECOND, 0.005, 0.01)
    site.step(stamp, [bodies(stamp)[0], walker])
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


# the service


def test_plan_by_hand_is_a_path_and_moves_nobody(graph: Any) -> None:
    site = Site(graph)
    site.stand(SECOND, Pose2D(2.0, 4.0, 0.0))
    site.step(SECOND)
    published = len(site.paths)
    start = posed(1.5, 2.0)
    start.header.stamp = stamp_message(4 * SECOND)
    path = path_from_message(site.ask(posed(10.0, 2.0), start))
    assert path is not None
    assert path.start_time == 4.0
    assert path.points[0] == pytest.approx([1.5, 2.0])
    assert path.points[-1] == pytest.approx([10.0, 2.0], abs=1e-6)
    from_here = path_from_message(site.ask(posed(10.0, 2.0)))
    assert from_here is not None
    assert from_here.start_time == 1.0
    assert from_here.points[0] == pytest.approx([2.0, 4.0])
    own = graph.call(GetPlan, "cart/plan", GetPlan.Request(goal=posed(10.0, 2.0))).plan
    assert own == site.ask(posed(10.0, 2.0))
    assert len(site.paths) == published
    values = {pair.key: pair.value for pair in site.status("plan service").values}
    assert (values["outcome"], values["robot"]) == ("planned", "cart")
    assert float(values["travel_time"]) > 16.0


def test_tolerance_moves_a_target_that_is_blocked(graph: Any) -> None:
    site = started(graph)
    site.step(SECOND)
    assert not site.ask(posed(7.0, 4.0)).poses
    path = path_from_message(site.ask(posed(7.0, 4.0), tolerance=0.8))
    assert path is not None
    assert np.hypot(*(path.points[-1] - [7.0, 4.0])) <= 0.8 + 1e-6


@pytest.mark.parametrize(
    ("start", "goal", "tolerance", "outcome", "text"),
    [
        (posed(2.0, 4.0), posed(6.0, 4.0), 0.0, "goal_blocked", "from body_1"),
        (posed(5.3, 4.0), posed(10.0, 4.0), 0.0, "start_blocked", "from body_1"),
        (posed(2.0, 4.0), posed(30.0, 4.0), 0.0, "goal_blocked", "from workspace"),
        (posed(2.0, 4.0), posed(10.0, 4.0, "odom"), 0.0, "invalid_request", "plan: goal: frame_id is 'odom'"),
        (posed(np.nan, 4.0), posed(10.0, 4.0), 0.0, "invalid_request", "plan: start: position .* not finite"),
        (posed(2.0, 4.0), posed(10.0, 4.0), -1.0, "invalid_request", "tolerance is -1.0"),
    ],
)
def test_no_plan_is_an_empty_path_and_a_typed_reason(
    graph: Any,
    capfd: pytest.CaptureFixture[str],
    start: PoseStamped,
    goal: PoseStamped,
    tolerance: float,
    outcome: str,
    text: str,
) -> None:
    site = started(graph)
    site.step(SECOND)
    answer = site.ask(goal, start, tolerance)
    assert not answer.poses
    assert answer.header.frame_id == "map"
    status = site.status("plan service")
    assert {pair.key: pair.value for pair in status.values}["outcome"] == outcome
    assert status.level == DiagnosticStatus.WARN
    assert re.search(text, status.message), status.message
    assert f"no plan ({outcome})" in capfd.readouterr().err


def test_question_before_there_are_bodies_is_answered(graph: Any) -> None:
    site = Site(graph)
    assert not site.ask(posed(10.0, 4.0)).poses
    assert "were not heard yet" in site.status("plan service").message


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
