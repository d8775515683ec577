"""Flying robots reach their targets, keep their margins along the way, and hover with a reason where they cannot."""

from __future__ import annotations

import numpy as np
import pytest

from snnav_core.errors import InvalidInput
from snnav_core.flight_types import FlyerState
from snnav_core.navigator.flight import FlightNavigator
from snnav_core.navigator.flight_settings import FlightSettings
from snnav_core.types import FloatArray, PathSource, PlannedPath, RobotSpec, Stop, StopReason
from support.flight_hall import Hall

BEE = RobotSpec("bee", 0.2, 0.7, 2.0)
WALL = np.array([[[3.8, 0.0, 0.0], [4.2, 4.5, 3.0]]])  # a way round at one end


def at(*numbers: float) -> FloatArray:
    return np.array(numbers)


def test_round_a_wall_to_the_target() -> None:
    hall = Hall({"bee": at(1.5, 1.5, 1.5)}, {"bee": at(6.5, 1.5, 1.2)}, WALL)
    hall.run(60.0)
    assert hall.reasons() == {"bee": "arrived"}
    assert hall.least_clearance >= 0.5
    paths = [one.decisions["bee"] for one in hall.results if isinstance(one.decisions["bee"], PlannedPath)]
    assert all(path.certificate.accepted for path in paths)
    assert len(paths) * 0.2 * 0.7 < 13.5  # the way round is 10.8 m long


def test_two_that_meet_keep_their_distance() -> None:
    starts = {"bee": at(1.0, 3.5, 1.5), "wasp": at(7.0, 3.5, 1.5)}
    hall = Hall(starts, {"bee": starts["wasp"], "wasp": starts["bee"]})
    hall.run(20.0)
    assert set(hall.reasons().values()) == {"arrived"}
    assert hall.least_separation >= 0.5
    assert hall.least_clearance >= 0.5


def test_among_boxes_that_move() -> None:
    boxes = np.array([[[3.0, 5.0, 0.0], [3.5, 5.5, 1.8]], [[5.0, 1.0, 0.0], [5.5, 1.5, 1.8]]])
    velocity = np.array([[0.0, -0.15, 0.0], [0.0, 0.15, 0.0]])
    hall = Hall({"bee": at(1.2, 3.5, 1.5)}, {"bee": at(6.8, 3.5, 1.5)}, boxes, velocity, boundary_speed=0.15)
    hall.run(40.0)
    assert hall.reasons() == {"bee": "arrived"}
    assert hall.least_clearance >= 0.5


def test_when_the_cameras_fall_silent_it_hovers_inside_what_was_proved() -> None:
    hall = Hall({"bee": at(1.2, 3.5, 1.5)}, {"bee": at(6.8, 3.5, 1.5)}, boundary_speed=0.4, silent_after=1.0)
    for _ in range(25):
        hall.decide()
        hall.fly(0.2)
    assert hall.states["bee"].speed == 0.0
    decision = hall.results[-1].decisions["bee"]
    assert isinstance(decision, Stop)
    assert decision.reason in (StopReason.START_BLOCKED, StopReason.GOAL_BLOCKED)


def test_when_no_decision_comes_it_hovers_at_the_end_of_its_window() -> None:
    hall = Hall({"bee": at(1.2, 3.5, 1.5)}, {"bee": at(6.8, 3.5, 1.5)})
    hall.decide()
    planned = hall.results[-1].decisions["bee"]
    assert isinstance(planned, PlannedPath)
    hall.fly(planned.certificate.valid_until + 0.5)
    assert hall.states["bee"].speed == 0.0
    assert float(np.linalg.norm(hall.states["bee"].position - at(1.2, 3.5, 1.5))) <= 0.7 * 1.2 + 1e-6


@pytest.mark.parametrize(
    ("goal", "boxes", "reason"),
    [
        (at(4.0, 2.0, 1.5), WALL, StopReason.GOAL_BLOCKED),
        (
            at(6.5, 1.5, 1.5),
            np.array([[[3.8, 0.0, 0.0], [4.2, 7.0, 3.0]]]),
            StopReason.GOAL_UNREACHABLE,
        ),
        (at(6.5, 3.5, 0.2), np.empty((0, 2, 3)), StopReason.GOAL_BLOCKED),
    ],
)
def test_what_cannot_be_reached_is_explained(goal: FloatArray, boxes: FloatArray, reason: StopReason) -> None:
    hall = Hall({"bee": at(1.5, 1.5, 1.5)}, {"bee": goal}, boxes)
    decision = hall.decide().decisions["bee"]
    assert isinstance(decision, Stop)
    assert decision.reason == reason
    assert "margin" in decision.message or "keeps" in decision.message


def test_a_target_where_another_hovers_is_waited_for() -> None:
    starts = {"bee": at(1.5, 1.5, 1.5), "wasp": at(6.0, 5.0, 1.5)}
    hall = Hall(starts, {"bee": starts["wasp"]})
    hall.run(6.0)
    assert hall.reasons()["wasp"] == "no_goal"
    assert hall.reasons()["bee"] == "blocked_by_robot"
    assert hall.least_separation >= 0.5


def test_the_same_seed_flies_the_same_way() -> None:
    ways = []
    for _ in range(2):
        hall = Hall({"bee": at(1.5, 1.5, 1.5)}, {"bee": at(6.5, 1.5, 1.2)}, WALL)
        hall.decide()
        first = hall.results[0].decisions["bee"]
        assert isinstance(first, PlannedPath)
        assert first.source == PathSource.ROADMAP
        ways.append(first.path.digest())
    assert ways[0] == ways[1]


def test_missing_things_are_stops_with_reasons() -> None:
    navigator = FlightNavigator([BEE], FlightSettings(0.2, 0.5))
    state = FlyerState("bee", np.ones(3), at(1.0, 0.0, 0.0), 0.0)
    area = Hall({"bee": np.ones(3)}, {}).fusion.area(0.0)
    for arguments, reason in (
        ((None, {"bee": state}, {"bee": np.ones(3)}), StopReason.NO_AREA),
        ((area, {}, {"bee": np.ones(3)}), StopReason.NO_STATE),
        ((area, {"bee": state}, {}), StopReason.NO_GOAL),
        ((area, {"bee": state}, {"bee": np.full(3, np.nan)}), StopReason.NO_GOAL),
    ):
        decision = navigator.step(0.0, *arguments).decisions["bee"]
        assert isinstance(decision, Stop)
        assert decision.reason == reason
        assert "bee" in decision.message or reason == StopReason.NO_AREA


def test_settings_that_do_not_fit_the_robot_are_refused() -> None:
    with pytest.raises(InvalidInput, match="turning radius"):
        FlightNavigator([BEE], FlightSettings(0.2, 0.3))
    with pytest.raises(InvalidInput, match="must be below the speed"):
        FlightNavigator([BEE], FlightSettings(0.2, 0.5, boundary_speed=0.8))
    with pytest.raises(InvalidInput, match="two robots"):
        FlightNavigator([BEE, BEE], FlightSettings(0.2, 0.5))
    with pytest.raises(InvalidInput, match="time_window is 0"):
        FlightSettings(0.2, 0.5, time_window=0)


def test_robots_that_want_to_each_others_places_do_not_wait_for_each_other() -> None:
    starts = {"bee": at(1.0, 2.5, 1.5), "wasp": at(7.0, 2.5, 1.5), "fly": at(4.0, 6.0, 1.2)}
    goals = {"bee": starts["wasp"], "wasp": starts["fly"], "fly": starts["bee"]}
    decisions = Hall(starts, goals).decide().decisions
    assert isinstance(decisions["bee"], PlannedPath)
    assert not any(
        isinstance(one, Stop) and one.reason == StopReason.BLOCKED_BY_ROBOT for one in decisions.values()
    )
