"""Several robots, and areas that change while they drive: separation and margin hold at every control period."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pytest
import shapely

from snnav_core.area.planar import UnoccupiedArea
from snnav_core.navigator.ground import GroundNavigator
from snnav_core.navigator.settings import NavigatorSettings
from snnav_core.types import PlannedPath, Pose2D, RobotSpec, RobotState, Stop, StopReason
from support.fleet import CONTROL_PERIOD, Fleet, least_separation, ring
from support.hall import area

MARGIN, RADIUS = 0.4, 0.2
APART = MARGIN + RADIUS


def navigator(names: str, boundary_speed: float = 0.0) -> GroundNavigator:
    settings = NavigatorSettings(0.5, MARGIN, 4, boundary_speed=boundary_speed)
    return GroundNavigator([RobotSpec(name, RADIUS, 0.5, 1.5) for name in names], settings)


def all_arrived(log: Any) -> bool:
    decisions = log.results[-1].decisions.values()
    return all(isinstance(d, Stop) and d.reason is StopReason.ARRIVED for d in decisions)


CROSSINGS: dict[str, tuple[dict[str, Pose2D], dict[str, tuple[float, float]]]] = {
    "at right angles": (
        {"a": Pose2D(4.0, 6.0, 0.0), "b": Pose2D(10.0, 1.5, math.pi / 2)},
        {"a": (16.0, 6.0), "b": (10.0, 10.5)},
    ),
    "head on": (
        {"a": Pose2D(4.0, 6.0, 0.0), "b": Pose2D(16.0, 6.0, math.pi)},
        {"a": (15.0, 6.0), "b": (5.0, 6.0)},
    ),
    "one behind the other": (
        {"a": Pose2D(4.0, 6.0, 0.0), "b": Pose2D(4.9, 6.0, 0.0)},
        {"a": (14.0, 6.0), "b": (15.0, 6.0)},
    ),
    "three at once": ring("abc"),
}


@pytest.mark.parametrize("name", CROSSINGS)
def test_crossing_robots_keep_apart_and_arrive(closed_loop: Callable[..., Any], name: str) -> None:
    poses, goals = CROSSINGS[name]
    log = closed_loop(navigator("".join(poses)), area().restamped, poses, goals, 90.0)
    assert least_separation({name: log.positions(name) for name in log.poses}) >= APART - 1e-6
    assert all_arrived(log), {robot: log.reasons(robot)[-1] for robot in poses}
    for robot in poses:
        assert area().clearance(log.positions(robot)).min() >= MARGIN


def test_two_robots_pass_a_gap_for_one(closed_loop: Callable[..., Any]) -> None:
    wall = area(shapely.box(9.5, 0.0, 10.5, 5.3), shapely.box(9.5, 6.7, 10.5, 12.0))
    poses = {"a": Pose2D(4.0, 6.0, 0.0), "b": Pose2D(14.0, 8.0, math.pi)}
    log = closed_loop(navigator("ab"), wall.restamped, poses, {"a": (16.0, 4.0), "b": (4.0, 9.0)}, 90.0)
    assert least_separation({name: log.positions(name) for name in log.poses}) >= APART - 1e-6
    assert all_arrived(log)
    for robot in poses:
        assert wall.clearance(log.positions(robot)).min() >= MARGIN


@pytest.mark.parametrize("gap", [0.605, 0.65])
def test_robots_that_stand_close_can_part(closed_loop: Callable[..., Any], gap: float) -> None:
    poses = {"a": Pose2D(8.0, 6.0, 0.0), "b": Pose2D(8.0 + gap, 6.0, math.pi)}
    log = closed_loop(navigator("ab"), area().restamped, poses, {"a": (14.0, 8.0), "b": (3.0, 4.0)}, 60.0)
    assert least_separation({name: log.positions(name) for name in log.poses}) >= APART - 1e-6
    assert all_arrived(log)


def test_of_many_robots_in_the_way_the_nearest_few_are_named(closed_loop: Callable[..., Any]) -> None:
    wall = area(shapely.box(9.5, 0.0, 10.5, 5.3), shapely.box(9.5, 6.7, 10.5, 12.0))
    names = "abcdefghij"
    poses = {"a": Pose2D(3.0, 6.0, 0.0)}
    poses |= {name: Pose2D(7.5 + 0.7 * index, 6.0, 0.0) for index, name in enumerate(names[1:7])}
    poses |= {name: Pose2D(3.0 + 2.0 * index, 1.5, 0.0) for index, name in enumerate(names[7:])}
    log = closed_loop(navigator(names), wall.restamped, poses, {"a": (16.0, 6.0)}, 1.0)
    decision = log.last("a")
    assert isinstance(decision, Stop)
    assert "blocked by standing robots (b, c, d, e and 2 more)" in decision.message


def test_a_parked_robot_in_the_only_way_is_named(closed_loop: Callable[..., Any]) -> None:
    wall = area(shapely.box(9.5, 0.0, 10.5, 5.3), shapely.box(9.5, 6.7, 10.5, 12.0))
    poses = {"a": Pose2D(4.0, 6.0, 0.0), "b": Pose2D(10.0, 6.0, 0.0)}
    log = closed_loop(navigator("ab"), wall.restamped, poses, {"a": (16.0, 6.0)}, 3.0)
    decision = log.last("a")
    assert isinstance(decision, Stop)
    assert decision.reason is StopReason.BLOCKED_BY_ROBOT
    assert "blocked by standing robots (b)" in decision.message
    assert log.last("b").reason is StopReason.NO_GOAL


def is_unheard(decision: PlannedPath | Stop) -> bool:
    return isinstance(decision, Stop) and decision.reason is StopReason.NO_STATE


def drive_with_failures(
    nav: GroundNavigator,
    poses: Mapping[str, Pose2D],
    goals: Mapping[str, tuple[float, float]],
    fails: Callable[[str, float], bool],
    heard: Callable[[str, float], bool],
    duration: float,
    obeys: bool = False,
) -> dict[str, np.ndarray]:
    """Like the closed loop, but bases stand still and states are lost at times; return the positions.

    Robots that are not heard of hear nothing themselves, unless they obey and stop at once.
    """
    fleet = Fleet(nav.robots, poses)
    positions: dict[str, list[np.ndarray]] = {name: [] for name in poses}
    for tick in range(round(duration / CONTROL_PERIOD)):
        time = round(CONTROL_PERIOD * tick, 9)
        if tick % 10 == 0:
            states = {name: state for name, state in fleet.states(time).items() if heard(name, time)}
            decisions = nav.step(time, area(stamp=time), states, goals).decisions
            fleet.tell({name: one for name, one in decisions.items() if obeys or not is_unheard(one)})
        fleet.move(time, [name for name in poses if fails(name, time)])
        for name, pose in fleet.poses.items():
            positions[name].append(pose.position)
    return {name: np.array(values) for name, values in positions.items()}


@pytest.mark.parametrize("order", ["ab", "ba"])
@pytest.mark.parametrize("start", [2.0, 5.1])
def test_a_robot_whose_base_fails_is_not_run_into(order: str, start: float) -> None:
    """The one in front is told to drive, says where it is, and does not move for ten seconds."""
    poses = {"a": Pose2D(4.0, 6.0, 0.0), "b": Pose2D(5.2, 6.0, 0.0)}
    positions = drive_with_failures(
        navigator(order),
        poses,
        {"a": (15.0, 6.0), "b": (13.0, 6.0)},
        lambda name, time: name == "b" and start <= time < start + 10.0,
        lambda name, time: True,
        16.0,
    )
    assert np.linalg.norm(positions["a"] - positions["b"], axis=1).min() >= APART - 0.05


@pytest.mark.parametrize("order", ["ab", "ba"])
def test_a_robot_that_is_not_heard_of_any_more_is_not_run_into(order: str) -> None:
    """It follows its last path to the end of its window, as its tracker does, and stands there."""
    poses = {"a": Pose2D(4.0, 6.0, 0.0), "b": Pose2D(9.0, 2.5, math.pi / 2)}
    positions = drive_with_failures(
        navigator(order),
        poses,
        {"a": (15.0, 6.0), "b": (9.0, 10.0)},
        lambda name, time: False,
        lambda name, time: name == "a" or time < 5.0,
        40.0,
    )
    assert np.linalg.norm(positions["a"] - positions["b"], axis=1).min() >= APART - 1e-6
    assert np.linalg.norm(positions["a"][-1] - (15.0, 6.0)) < 0.2


@pytest.mark.parametrize("order", ["ab", "ba"])
@pytest.mark.parametrize(
    ("start", "goal"), [((5.2, 6.0, 0.0), (17.0, 6.0)), ((8.0, 3.5, math.pi / 2), (8.0, 10.0))]
)
def test_a_robot_that_stopped_when_it_was_not_heard_of_any_more_is_not_run_into(
    order: str, start: tuple[float, float, float], goal: tuple[float, float]
) -> None:
    """It was told to stop, and did, short of where its last path would have led it."""
    positions = drive_with_failures(
        navigator(order),
        {"a": Pose2D(4.0, 6.0, 0.0), "b": Pose2D(*start)},
        {"a": (15.0, 6.0), "b": goal},
        lambda name, time: False,
        lambda name, time: name == "a" or time < 5.5,
        12.0,
        obeys=True,
    )
    assert np.linalg.norm(positions["a"] - positions["b"], axis=1).min() >= APART - 1e-6


def test_what_a_later_robot_decides_counts_for_those_before_it_too() -> None:
    """The first robot plans behind the last path of the second, which then loses its goal and stands."""
    nav, goals = navigator("ab"), {"a": (15.0, 6.0), "b": (17.0, 6.0)}
    places = {"a": (4.0, 6.0), "b": (5.3, 6.0)}
    for time, known in ((0.0, goals), (0.5, {"a": goals["a"]})):
        shift = 0.5 * time
        states = {n: RobotState(n, Pose2D(x + shift, y, 0.0), time) for n, (x, y) in places.items()}
        result = nav.step(time, area(stamp=time), states, known)
    assert result.decisions["b"].reason is StopReason.NO_GOAL
    first = result.decisions["a"]
    if isinstance(first, Stop):
        assert first.reason is StopReason.BLOCKED_BY_ROBOT
        assert "robot b" in first.message
    else:
        times = np.linspace(0.5, first.certificate.valid_until, 200)
        gaps = np.linalg.norm(first.path.positions_at(times) - states["b"].pose.position, axis=1)
        assert gaps.min() >= APART - 1e-6
        assert first.certificate.least_separation <= gaps.min() - RADIUS + 1e-6


@pytest.mark.parametrize("closes", [6.0, 9.5, 11.5])
def test_a_door_that_shuts_stops_the_robot_before_it(closed_loop: Callable[..., Any], closes: float) -> None:
    frame = (shapely.box(9.0, 0.0, 10.0, 5.0), shapely.box(9.0, 7.0, 10.0, 12.0))
    door = shapely.box(9.0, 5.0, 10.0, 7.0)

    def free(time: float) -> UnoccupiedArea:
        return area(*frame, *((door,) if time >= closes else ()), stamp=time)

    log = closed_loop(navigator("a"), free, {"a": Pose2D(2.5, 6.0, 0.0)}, {"a": (17.0, 6.0)}, closes + 4.0)
    moving = [isinstance(result.decisions["a"], PlannedPath) for result in log.results]
    assert all(moving[: round(closes / 0.5)])
    assert not any(moving[round(closes / 0.5) :])
    assert log.last("a").reason is StopReason.GOAL_UNREACHABLE
    assert area(*frame, door).clearance(log.positions("a")).min() >= MARGIN


@pytest.mark.parametrize("shape", ["wall", "door"])
def test_a_moving_boundary_no_faster_than_v_max_never_comes_nearer_than_the_margin(
    closed_loop: Callable[..., Any], shape: str
) -> None:
    """The truth moves on between the decisions; it is compared at every control period."""
    speed = 0.2

    def free(time: float) -> UnoccupiedArea:
        if shape == "wall":
            return area(shapely.box(0.0, 0.0, 20.0, min(0.3 + speed * max(time - 4.0, 0.0), 3.0)), stamp=time)
        lower = min(4.0 + speed * time, 7.0)
        return area(shapely.box(9.0, 0.0, 11.0, lower), shapely.box(9.0, 10.0, 11.0, 12.0), stamp=time)

    start = Pose2D(2.0, 1.5, 0.0) if shape == "wall" else Pose2D(2.0, 6.0, 0.0)
    log = closed_loop(navigator("a", speed), free, {"a": start}, {"a": (17.0, 8.0)}, 60.0)
    assert all_arrived(log)
    for tick, position in enumerate(log.positions("a")):
        assert free(0.05 * tick).clearance(position[None])[0] >= MARGIN


def test_two_runs_of_several_robots_are_the_same(closed_loop: Callable[..., Any]) -> None:
    poses, goals = ring("abc")
    logs = [closed_loop(navigator("abc"), area().restamped, poses, goals, 5.0) for _ in range(2)]
    assert logs[0].digests() == logs[1].digests()


@pytest.mark.parametrize("seed", [1, 3, 5])
def test_five_robots_among_obstacles_keep_apart_and_arrive(
    closed_loop: Callable[..., Any], seed: int
) -> None:
    generator = np.random.default_rng(seed)
    free = area(*(shapely.box(x, y, x + 1.2, y + 1.2) for x, y in generator.uniform((3, 2), (16, 9), (4, 2))))
    places = free.region.buffer(-0.5)

    def draw() -> list[tuple[float, float]]:
        """Return five places apart from each other."""
        chosen: list[tuple[float, float]] = []
        for x, y in generator.uniform((0.0, 0.0), (20.0, 12.0), (300, 2)).tolist():
            apart = all(math.dist((x, y), other) > 1.6 for other in chosen)
            if apart and len(chosen) < 5 and places.contains(shapely.Point(x, y)):
                chosen.append((x, y))
        return chosen

    poses = {
        name: Pose2D(x, y, float(generator.uniform(-3, 3)))
        for name, (x, y) in zip("abcde", draw(), strict=True)
    }
    goals = dict(zip("abcde", draw(), strict=True))
    log = closed_loop(navigator("abcde"), free.restamped, poses, goals, 120.0)
    assert least_separation({name: log.positions(name) for name in log.poses}) >= APART - 1e-6
    assert all_arrived(log)
    for robot in poses:
        assert free.clearance(log.positions(robot)).min() >= MARGIN
