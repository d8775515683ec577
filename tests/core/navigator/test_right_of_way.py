"""Robots in each other's way: who waits where, for whom, and that they all get on, or say why not."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import shapely

from snnav_core.area.planar import UnoccupiedArea, as_multipolygon
from snnav_core.navigator.ground import GroundNavigator
from snnav_core.navigator.settings import NavigatorSettings
from snnav_core.types import PathSource, PlannedPath, Pose2D, RobotSpec, RobotState, Stop, StopReason

MARGIN = 0.4
SETTINGS = NavigatorSettings(0.5, MARGIN, 4)

Rooms = shapely.Geometry
Loop = Callable[..., Any]


def robot(name: str, radius: float = 0.2, speed: float = 0.8) -> RobotSpec:
    return RobotSpec(name, radius, speed, 2.0 * speed)


def boxes(*sides: tuple[float, float, float, float]) -> Rooms:
    return shapely.union_all([shapely.box(*side) for side in sides])


# Two rooms, and a corridor between them in which one robot has room.
ROOMS = boxes((0.0, 0.0, 4.0, 5.0), (3.9, 1.9, 10.1, 3.1), (10.0, 0.0, 14.0, 5.0))
BAY = boxes(
    (0.0, 0.0, 14.0, 1.2), (6.2, 1.1, 7.8, 2.4)
)  # a corridor with dead ends and room for one beside it
TUBE = boxes((0.0, 0.0, 12.0, 1.2))
HALL = boxes((0.0, 0.0, 14.0, 8.0))
CROSS = boxes((0.0, 6.4, 14.0, 7.6), (6.4, 0.0, 7.6, 14.0))


def run(loop: Loop, rooms: Rooms, robots: list[RobotSpec], ends: list[Any], duration: float) -> Any:
    """Drive robots between ends ((x, y), heading, target) on a known area."""
    area = UnoccupiedArea(0.0, as_multipolygon(rooms))
    poses = {one.id: Pose2D(*start, heading) for one, (start, heading, _) in zip(robots, ends, strict=True)}
    goals = {one.id: target for one, (_, _, target) in zip(robots, ends, strict=True) if target is not None}
    log = loop(GroundNavigator(robots, SETTINGS), area.restamped, poses, goals, duration)
    check_separation(log, robots)
    return log


def check_separation(log: Any, robots: list[RobotSpec]) -> None:
    """The margin is kept at every control period, and on the straight line between two of them."""
    for one, other in itertools.combinations(robots, 2):
        apart = log.positions(one.id) - log.positions(other.id)
        begin, change = apart[:-1], np.diff(apart, axis=0)
        share = -np.einsum("ij,ij->i", begin, change) / np.maximum(np.sum(change**2, axis=1), 1e-12)
        gaps = np.linalg.norm(begin + np.clip(share, 0.0, 1.0)[:, None] * change, axis=1)
        assert gaps.min() - max(one.radius, other.radius) >= MARGIN, f"{one.id} and {other.id}"


def all_arrived(log: Any) -> bool:
    decisions = log.results[-1].decisions.values()
    return all(isinstance(d, Stop) and d.reason is StopReason.ARRIVED for d in decisions)


def yielded(log: Any, name: str) -> bool:
    return bool({"yield", "yields"} & set(log.reasons(name)))


def reversals(log: Any, name: str) -> int:
    """How often a robot turned back: its way made a turn by more than 120 degrees within a metre."""
    points = log.positions(name)
    moved = np.linalg.norm(np.diff(points, axis=0), axis=1)
    along = np.concatenate(([0.0], np.cumsum(moved)))
    stations = np.arange(0.0, along[-1], 0.5)
    coarse = np.stack([np.interp(stations, along, points[:, axis]) for axis in range(2)], axis=-1)
    links = np.diff(coarse, axis=0)
    turned = np.einsum("ij,ij->i", links[:-1], links[1:]) < -0.5 * np.prod(
        [np.linalg.norm(links[:-1], axis=1), np.linalg.norm(links[1:], axis=1)], axis=0
    )
    return int(turned.sum())


HEAD_ON = [((1.0, 2.5), 0.0, (13.0, 2.5)), ((13.0, 2.5), math.pi, (1.0, 2.5))]


def test_of_two_who_would_meet_in_a_corridor_one_waits_outside_and_says_for_whom(closed_loop: Loop) -> None:
    log = run(closed_loop, ROOMS, [robot("a"), robot("b")], HEAD_ON, 60.0)
    assert all_arrived(log)
    assert not yielded(log, "a")
    waits = [
        d for r in log.results if isinstance(d := r.decisions["b"], Stop) and d.reason is StopReason.YIELDS
    ]
    assert waits
    assert all("until robot a has passed" in stop.message for stop in waits)
    a, b = log.positions("a")[:, 0], log.positions("b")[:, 0]
    inside = (a > 4.0) & (a < 10.0)
    assert (b[inside] > 10.0).all(), "it does not go in while the other is there"
    assert reversals(log, "b") <= 1


def test_the_same_again_to_the_last_bit(closed_loop: Loop) -> None:
    first, second = (run(closed_loop, ROOMS, [robot("a"), robot("b")], HEAD_ON, 60.0) for _ in range(2))
    assert first.digests() == second.digests()


def test_where_both_are_in_the_corridor_already_one_goes_back(closed_loop: Loop) -> None:
    ends = [((5.0, 2.5), 0.0, (13.0, 2.5)), ((9.0, 2.5), math.pi, (1.0, 2.5))]
    log = run(closed_loop, ROOMS, [robot("a"), robot("b")], ends, 60.0)
    assert all_arrived(log)
    assert reversals(log, "a") + reversals(log, "b") <= 3


def test_one_waits_in_the_bay_of_a_corridor_with_dead_ends(closed_loop: Loop) -> None:
    ends = [((0.6, 0.6), 0.0, (13.4, 0.6)), ((13.4, 0.6), math.pi, (0.6, 0.6))]
    log = run(closed_loop, BAY, [robot("a"), robot("b")], ends, 90.0)
    assert all_arrived(log)
    assert max(log.positions("a")[:, 1].max(), log.positions("b")[:, 1].max()) > 1.3, "in the bay"


def test_where_nobody_can_make_room_both_stop_and_name_each_other(closed_loop: Loop) -> None:
    ends = [((0.6, 0.6), 0.0, (11.4, 0.6)), ((11.4, 0.6), math.pi, (0.6, 0.6))]
    log = run(closed_loop, TUBE, [robot("a"), robot("b")], ends, 25.0)
    for name, other in (("a", "b"), ("b", "a")):
        last = log.last(name)
        assert isinstance(last, Stop)
        assert last.reason is StopReason.BLOCKED_BY_ROBOT
        assert f"robot {other} stands in its way" in last.message
        assert "finds no place to make room" in last.message
    assert log.reasons("a")[-12:] == ["blocked_by_robot"] * 12, "they do not try again and again"


def test_in_the_open_nobody_waits(closed_loop: Loop) -> None:
    ends = [((1.0, 4.0), 0.0, (13.0, 4.0)), ((13.0, 4.0), math.pi, (1.0, 4.0))]
    log = run(closed_loop, HALL, [robot("a"), robot("b")], ends, 40.0)
    assert all_arrived(log)
    assert not yielded(log, "a")
    assert not yielded(log, "b")


def test_four_through_one_door_of_different_size_and_speed(closed_loop: Loop) -> None:
    door = boxes((0.0, 0.0, 5.0, 6.0), (4.9, 2.4, 5.3, 3.6), (5.2, 0.0, 10.0, 6.0))
    robots = [robot("a"), robot("b", 0.3, 0.5), robot("c", 0.15, 1.0), robot("d", 0.25, 0.7)]
    ends = [
        ((1.0, 1.5), 0.0, (9.0, 1.5)),
        ((9.0, 1.5), math.pi, (1.0, 1.5)),
        ((1.0, 4.5), 0.0, (9.0, 4.5)),
        ((9.0, 4.5), math.pi, (1.0, 4.5)),
    ]
    log = run(closed_loop, door, robots, ends, 120.0)
    assert all_arrived(log)
    assert sum(reversals(log, one.id) for one in robots) <= 8


def test_four_meet_where_two_narrow_corridors_cross(closed_loop: Loop) -> None:
    ends = [
        ((0.7, 7.0), 0.0, (13.3, 7.0)),
        ((7.0, 0.7), 0.5 * math.pi, (7.0, 13.3)),
        ((13.3, 7.0), math.pi, (0.7, 7.0)),
        ((7.0, 13.3), -0.5 * math.pi, (7.0, 0.7)),
    ]
    log = run(closed_loop, CROSS, [robot(name) for name in "abcd"], ends, 120.0)
    assert all_arrived(log)


def test_one_that_has_arrived_makes_room_and_comes_back(closed_loop: Loop) -> None:
    ends = [((1.0, 2.5), 0.0, (13.0, 2.5)), ((7.4, 2.5), 0.0, (7.0, 2.5))]
    area = UnoccupiedArea(0.0, as_multipolygon(ROOMS))
    navigator = GroundNavigator([robot("a"), robot("b")], SETTINGS)
    poses = {"a": Pose2D(1.0, 2.5, 0.0), "b": Pose2D(7.0, 2.5, 0.0)}
    goals = {"a": ends[0][2], "b": ends[1][2]}
    log = closed_loop(navigator, area.restamped, poses, goals, 60.0)
    check_separation(log, [robot("a"), robot("b")])
    assert log.reasons("b")[0] == "arrived"
    assert yielded(log, "b")
    assert all_arrived(log)
    assert np.linalg.norm(log.positions("b")[-1] - (7.0, 2.5)) < 0.2


def test_one_without_a_goal_does_not_move_and_is_named(closed_loop: Loop) -> None:
    ends = [((1.0, 2.5), 0.0, (13.0, 2.5)), ((7.0, 2.5), 0.0, None)]
    log = run(closed_loop, ROOMS, [robot("a"), robot("b")], ends, 15.0)
    last = log.last("a")
    assert isinstance(last, Stop)
    assert last.reason is StopReason.BLOCKED_BY_ROBOT
    assert "robot b stands in its way at (7.00, 2.50) and has no goal" in last.message
    assert set(log.reasons("b")) == {"no_goal"}


def test_one_that_has_arrived_where_another_wants_to_is_named_and_stays(closed_loop: Loop) -> None:
    ends = [((1.0, 4.0), 0.0, (7.0, 4.0)), ((8.0, 4.0), math.pi, (7.0, 4.2))]
    log = run(closed_loop, HALL, [robot("a"), robot("b")], ends, 20.0)
    last = log.last("a")
    assert isinstance(last, Stop)
    assert last.reason is StopReason.BLOCKED_BY_ROBOT
    assert "robot b has arrived" in last.message
    assert "give one of them another" in last.message
    assert log.reasons("b")[-1] == "arrived"
    assert not yielded(log, "b")


def test_who_waits_goes_on_at_once_when_the_other_gets_another_goal() -> None:
    area = UnoccupiedArea(0.0, as_multipolygon(ROOMS))
    navigator = GroundNavigator([robot("a"), robot("b")], SETTINGS)
    poses = {"a": Pose2D(5.0, 2.5, 0.0), "b": Pose2D(12.0, 4.2, math.pi)}
    states = {name: RobotState(name, pose, 0.0) for name, pose in poses.items()}
    goals = {"a": (13.0, 2.5), "b": (1.0, 2.5)}
    first = navigator.step(0.0, area, states, goals).decisions["b"]
    assert isinstance(first, Stop) or first.source is PathSource.YIELD
    states = {name: RobotState(name, pose, 0.5) for name, pose in poses.items()}
    second = navigator.step(0.5, area.restamped(0.5), states, {"a": (1.0, 1.0), "b": (13.0, 1.0)}).decisions[
        "b"
    ]
    assert isinstance(second, PlannedPath)
    assert second.source is not PathSource.YIELD


@pytest.mark.parametrize("removed", ["goal", "robot"])
def test_who_waits_goes_on_when_the_other_is_gone(removed: str) -> None:
    area = UnoccupiedArea(0.0, as_multipolygon(ROOMS))
    navigator = GroundNavigator([robot("a"), robot("b")], SETTINGS)
    poses = {"a": Pose2D(1.0, 1.0, 0.0), "b": Pose2D(12.0, 2.5, math.pi)}
    goals = {"a": (13.0, 2.5), "b": (1.0, 2.5)}
    for time in (0.0, 0.5):
        states = {name: RobotState(name, pose, time) for name, pose in poses.items()}
        decision = navigator.step(time, area.restamped(time), states, goals).decisions["b"]
    assert isinstance(decision, Stop) or decision.source is PathSource.YIELD
    del goals["a"]
    if removed == "robot":
        navigator.remove_robot("a")
    states = {name: RobotState(name, pose, 1.0) for name, pose in poses.items() if name in navigator.robots}
    decision = navigator.step(1.0, area.restamped(1.0), states, goals).decisions["b"]
    assert isinstance(decision, PlannedPath)
    assert decision.source is not PathSource.YIELD
