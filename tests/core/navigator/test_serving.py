"""Navigators that share the robots of a workspace, and robots that join and leave."""

from __future__ import annotations

import math

import numpy as np
import pytest

from snnav_core.errors import InvalidInput
from snnav_core.navigator.ground import GroundNavigator
from snnav_core.navigator.settings import NavigatorSettings
from snnav_core.types import (
    HeardPath,
    PlannedPath,
    Pose2D,
    RobotSpec,
    RobotState,
    StepResult,
    Stop,
    StopReason,
    TimedPath,
)
from support.fleet import CONTROL_PERIOD, Fleet, least_separation, ring
from support.hall import area

MARGIN, RADIUS, INTERVAL = 0.4, 0.2, 0.5
APART = MARGIN + RADIUS
SETTINGS = NavigatorSettings(INTERVAL, MARGIN, 4)

Goals = dict[str, tuple[float, float]]
Decision = PlannedPath | Stop


def spec(name: str, radius: float = RADIUS) -> RobotSpec:
    return RobotSpec(name, radius, 0.5, 1.5)


def navigator(names: str, serves: str | None = None) -> GroundNavigator:
    return GroundNavigator([spec(name) for name in names], SETTINGS, serves)


def promise(decision: Decision) -> HeardPath:
    if isinstance(decision, Stop):
        return HeardPath(None)
    return HeardPath(decision.path, decision.certificate.valid_until)


class Team:
    """Navigators that decide one after another and hear each other's promises."""

    def __init__(self, names: str, parts: list[str]) -> None:
        self.navigators = [navigator(names, part) for part in parts]
        self.promises: dict[str, HeardPath] = {}
        self.decisions: dict[str, Decision] = {}

    def step(
        self, time: float, states: dict[str, RobotState], goals: Goals, working: set[int]
    ) -> dict[str, Decision]:
        """Let those that work decide; return what the robots are told."""
        told: dict[str, Decision] = {}
        for index, one in enumerate(self.navigators):
            if index not in working:
                continue
            result = one.step(time, area(stamp=time), states, goals, self.promises)
            told |= result.decisions | result.stop_foreign
            self.promises |= {
                name: promise(decision) for name, decision in (result.decisions | result.stop_foreign).items()
            }
        return told


def drive(
    team: Team,
    poses: dict[str, Pose2D],
    goals: Goals,
    duration: float,
    works: dict[int, tuple[float, float]] | None = None,
) -> dict[str, np.ndarray]:
    """Drive; a navigator of `works` is silent in the given span of time [s]. Return the positions."""
    fleet = Fleet({name: spec(name) for name in poses}, poses)
    positions = {name: [pose.position] for name, pose in poses.items()}
    for tick in range(round(duration / CONTROL_PERIOD)):
        time = round(CONTROL_PERIOD * tick, 9)
        if tick % 10 == 0:
            silent = {index for index, (begin, end) in (works or {}).items() if begin <= time < end}
            working = set(range(len(team.navigators))) - silent
            fleet.tell(team.step(time, fleet.states(time), goals, working))
        fleet.move(time)
        for name, pose in fleet.poses.items():
            positions[name].append(pose.position)
    return {name: np.array(values) for name, values in positions.items()}


@pytest.mark.parametrize("parts", [["ab", "cd"], ["c", "da", "b"]])
def test_navigators_that_share_the_robots_keep_them_apart_and_arrive(parts: list[str]) -> None:
    poses, goals = ring("abcd")
    positions = drive(Team("abcd", parts), poses, goals, 45.0)
    assert least_separation(positions) >= APART - 1e-6
    for name, goal in goals.items():
        assert np.linalg.norm(positions[name][-1] - goal) < 0.3


@pytest.mark.parametrize("parts", [["a", "b"], ["b", "a"]])
@pytest.mark.parametrize("lost", [4.0, 4.5, 5.5])
@pytest.mark.parametrize(
    ("start", "goal"), [((5.2, 6.0, 0.0), (17.0, 6.0)), ((8.0, 3.5, math.pi / 2), (8.0, 10.0))]
)
def test_a_robot_that_its_navigator_stopped_unseen_is_not_run_into(
    parts: list[str], lost: float, start: tuple[float, float, float], goal: tuple[float, float]
) -> None:
    """It obeys, and stands where nobody has measured it."""
    poses = {"a": Pose2D(4.0, 6.0, 0.0), "b": Pose2D(*start)}
    fleet, team = Fleet({name: spec(name) for name in poses}, poses), Team("ab", parts)
    for tick in range(round(12.0 / CONTROL_PERIOD)):
        time = round(CONTROL_PERIOD * tick, 9)
        if tick % 10 == 0:
            seen = {name: one for name, one in fleet.states(time).items() if name == "a" or time < lost}
            fleet.tell(team.step(time, seen, {"a": (15.0, 6.0), "b": goal}, {0, 1}))
        fleet.move(time)
        gap = np.linalg.norm(fleet.poses["a"].position - fleet.poses["b"].position)
        assert gap >= APART - 1e-6


@pytest.mark.parametrize(("silent", "begin"), [(0, 5.0), (1, 7.0)])
def test_a_navigator_that_falls_silent_endangers_nobody(silent: int, begin: float) -> None:
    """Its robots go on to the end of their windows; they go on to their targets when it is back."""
    poses, goals = ring("abcd")
    positions = drive(Team("abcd", ["ab", "cd"]), poses, goals, 50.0, {silent: (begin, begin + 6.0)})
    assert least_separation(positions) >= APART - 1e-6
    for name, goal in goals.items():
        assert np.linalg.norm(positions[name][-1] - goal) < 0.3


def first_step(nav: GroundNavigator, heard: dict[str, HeardPath], **places: float) -> StepResult:
    """Robots on the line y = 6 m; all have goals 5 m ahead."""
    states = {name: RobotState(name, Pose2D(x, 6.0, 0.0), 0.0) for name, x in places.items()}
    goals = {name: (x + 5.0, 6.0) for name, x in places.items()}
    return nav.step(0.0, area(stamp=0.0), states, goals, heard)


def straight(begin: float, end: float, start: float = 0.0, duration: float = 2.0) -> TimedPath:
    count = round(duration / 0.125) + 1
    points = np.column_stack((np.linspace(begin, end, count), np.full(count, 6.0)))
    return TimedPath(start, 0.125, points)


def test_only_served_robots_are_decided_for() -> None:
    nav = navigator("abc", "bd")
    assert nav.served == ["b"]
    assert set(first_step(nav, {}, a=2.0, b=6.0, c=10.0).decisions) == {"b"}
    nav.add_robot(spec("d"))
    assert nav.served == ["b", "d"]


def test_a_path_avoids_what_was_heard_of_others() -> None:
    """The other one comes towards the robot; without that path it would drive straight on."""
    coming = HeardPath(straight(7.0, 6.0), 2.0)
    for heard, free in (({}, False), ({"b": coming}, True)):
        nav = navigator("ab", "a")
        states = {"a": RobotState("a", Pose2D(4.0, 6.0, 0.0), 0.0)}
        decision = nav.step(0.0, area(stamp=0.0), states, {"a": (10.0, 6.0)}, heard).decisions["a"]
        assert isinstance(decision, PlannedPath)
        assert math.isfinite(decision.certificate.least_separation) == free
        times = np.linspace(0.0, decision.certificate.valid_until, 100)
        apart = np.linalg.norm(decision.path.positions_at(times) - coming.path.positions_at(times), axis=1)
        assert not free or apart.min() >= APART - 1e-6


def test_a_promise_that_has_ended_leaves_a_robot_that_stands() -> None:
    nav = navigator("ab", "a")
    ended = {"b": HeardPath(straight(5.0, 7.0, -3.0), -1.0)}
    decision = first_step(nav, ended, a=4.0, b=7.0).decisions["a"]
    assert isinstance(decision, PlannedPath)
    gaps = np.linalg.norm(decision.path.points - np.array([7.0, 6.0]), axis=1)
    assert gaps.min() >= APART - 1e-6


def test_a_robot_that_has_to_stop_stops_the_one_that_counts_on_its_going() -> None:
    """`b` was decided before, right behind where `a` was to go; but `a` loses its goal."""
    nav = navigator("ab", "a")
    behind = {"b": HeardPath(straight(4.0, 5.0), 2.0)}
    states = {name: RobotState(name, Pose2D(x, 6.0, 0.0), 0.0) for name, x in (("a", 5.0), ("b", 4.0))}
    result = nav.step(0.0, area(stamp=0.0), states, {"b": (12.0, 6.0)}, behind)
    assert result.decisions["a"].reason is StopReason.NO_GOAL
    assert result.stop_foreign["b"].reason is StopReason.BLOCKED_BY_ROBOT
    assert "robot a" in result.stop_foreign["b"].message


@pytest.mark.parametrize(("gap", "stops"), [(0.9, True), (1.4, False)])
def test_a_robot_still_to_be_decided_is_stopped_only_for_what_is_soon(gap: float, stops: bool) -> None:
    nav = navigator("ab", "a")
    behind = {"b": HeardPath(straight(4.0 - 0.25, 4.75, -0.5), 1.5)}
    states = {name: RobotState(name, Pose2D(x, 6.0, 0.0), 0.0) for name, x in (("a", 4.0 + gap), ("b", 4.0))}
    result = nav.step(0.0, area(stamp=0.0), states, {}, behind)
    assert ("b" in result.stop_foreign) == stops


def test_what_another_navigator_stopped_is_forgotten() -> None:
    nav = navigator("ab", "a")
    first_step(nav, {}, a=4.0, b=15.0)
    assert nav._memory["a"].plan is not None
    states = {"a": RobotState("a", Pose2D(4.2, 6.0, 0.0), 0.5)}
    nav.step(0.5, area(stamp=0.5), states, {}, {"a": HeardPath(None)})
    assert nav._memory["a"].plan is None


def test_robots_join_and_leave() -> None:
    nav = navigator("a")
    assert set(first_step(nav, {}, a=4.0, b=5.5).decisions) == {"a"}
    nav.add_robot(spec("b"))
    result = first_step(nav, {}, a=4.0, b=5.5)
    assert set(result.decisions) == {"a", "b"}
    with pytest.raises(InvalidInput, match="robot b is there already"):
        nav.add_robot(spec("b"))
    nav.remove_robot("b")
    nav.remove_robot("nobody")
    alone = first_step(nav, {}, a=4.0, b=5.5).decisions["a"]
    assert isinstance(alone, PlannedPath)
    assert math.isinf(alone.certificate.least_separation)


def test_a_robot_that_does_not_fit_is_not_added() -> None:
    nav = navigator("a")
    with pytest.raises(InvalidInput, match=r"safety_margin 0\.4 m is below the radius 0\.5 m of robot b"):
        nav.add_robot(spec("b", 0.5))
    assert list(nav.robots) == ["a"]
