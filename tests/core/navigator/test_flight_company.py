"""What flying robots count on of each other holds also when one is stopped, is not heard of, or began too near."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from snnav_core.flight_types import FlyerState
from snnav_core.navigator.flight_company import silent
from snnav_core.planning.flight_separation import least_gap
from snnav_core.types import FloatArray, PlannedPath, RobotSpec, Stop, StopReason, TimedPath
from support.flight_hall import Hall


def at(*numbers: float) -> FloatArray:
    return np.array(numbers)


def meet(hall: Hall) -> None:
    """Let two robots fly after each other until the one behind is as near as it may come."""
    for _ in range(4):
        hall.decide()
        hall.fly(0.2)


def followers() -> Hall:
    starts = {"bee": at(1.2, 3.5, 1.5), "wasp": at(2.2, 3.5, 1.5)}
    return Hall(starts, {"bee": at(6.0, 3.5, 1.5), "wasp": at(7.2, 3.5, 1.5)})


def test_a_window_ends_where_another_was_stopped_after_it_was_proved() -> None:
    hall = followers()
    meet(hall)
    before = hall.results[-1].decisions["bee"]
    assert isinstance(before, PlannedPath)
    del hall.goals["wasp"]  # decided after the bee, which counts on it to fly on
    bee, wasp = (hall.decide().decisions[name] for name in ("bee", "wasp"))
    assert isinstance(wasp, Stop)
    there = TimedPath(0.0, 1.0, hall.states["wasp"].position[None])
    if isinstance(bee, PlannedPath):
        until = bee.certificate.valid_until
        assert least_gap(bee.path, there, bee.path.start_time, until)[0] - hall.radius >= hall.margin - 1e-3
        assert until < bee.path.start_time + 6 * 0.2 - 1e-6
    # No further decision comes.
    hall.fly(3.0)
    assert hall.least_separation >= hall.margin - 0.01


def test_one_that_is_not_heard_of_any_more_is_kept_clear_of() -> None:
    starts = {"bee": at(1.2, 3.5, 1.5), "wasp": at(4.0, 3.5, 1.5)}
    hall = Hall(starts, {"bee": at(6.8, 3.5, 1.5)})
    hall.decide()
    hall.fly(0.2)
    hidden = hall.states["wasp"]
    for number in range(1, 30):
        states = {"bee": hall.states["bee"]}
        time = 0.2 * number
        result = hall.navigator.step(time, hall.fusion.area(time), states, hall.goals)
        bee = result.decisions["bee"]
        assert result.decisions["wasp"].reason is StopReason.NO_STATE  # type: ignore[union-attr]
        if isinstance(bee, PlannedPath):
            gap = least_gap(
                bee.path, TimedPath(0.0, 1.0, hidden.position[None]), time, bee.certificate.valid_until
            )[0]
            assert gap - hall.radius >= hall.margin - 1e-3
            hall.trackers["bee"].set_path(bee.path, hall.states["bee"].direction, bee.certificate.valid_until)
        hall.step_number = number + 1
        hall.fly(0.2)
    assert hall.least_separation >= hall.margin - 0.01


def test_a_silent_robot_is_on_its_way_or_anywhere_on_the_rest_of_it() -> None:
    hall = followers()
    plan = hall.decide().decisions["wasp"]
    assert isinstance(plan, PlannedPath)
    robot, until = RobotSpec("wasp", 0.2, 0.7, 2.0), plan.certificate.valid_until
    last = FlyerState("wasp", plan.path.points[2], at(1.0, 0.0, 0.0), 2 * plan.path.step)
    for time, moves in ((0.6, True), (until + 1.0, False)):
        others = silent(robot, last, plan, time)
        assert any(len(one.path) > 1 for one in others) is moves
        places = np.array([one.path.points[0] for one in others if len(one.path) == 1])
        for when in np.linspace(last.stamp, until, 40):
            truth = plan.path.positions_at(np.array([when]))[0]
            assert np.linalg.norm(places - truth, axis=1).min() <= 0.7 * plan.path.step
    stopped = silent(robot, last, None, 0.6)
    assert [one.path.points.tolist() for one in stopped] == [[last.position.tolist()]]
    assert silent(robot, None, plan, 0.6) == []


def test_a_state_that_is_too_old_gets_no_path() -> None:
    hall = followers()
    hall.decide()
    old = {"bee": replace(hall.states["bee"], stamp=-0.5), "wasp": replace(hall.states["wasp"], stamp=1.0)}
    for stop in hall.navigator.step(0.2, hall.fusion.area(0.2), old, hall.goals).decisions.values():
        assert isinstance(stop, Stop)
        assert stop.reason is StopReason.NO_STATE
        assert "odometry" in stop.message


def test_robots_that_begin_too_near_each_other_fly_apart() -> None:
    starts = {"bee": at(3.6, 3.5, 1.5), "wasp": at(4.2, 3.5, 1.5)}
    hall = Hall(starts, {"bee": at(1.5, 3.5, 1.5), "wasp": at(6.5, 3.5, 1.5)})
    hall.run(20.0)
    assert set(hall.reasons().values()) == {"arrived"}
    assert hall.least_separation >= 0.6 - hall.radius - 0.005  # never nearer than they began
