"""The tracker keeps a flying robot on its path in space, within its turn rate, and lets it hover when it must."""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from snnav_core.errors import InvalidInput
from snnav_core.flight_types import FlyerState, direction_of
from snnav_core.motion.flyer import step_flyer
from snnav_core.tracking.spatial import SpatialTracker, SpatialTrackerSettings
from snnav_core.tracking.spatial_track import chain_in_space, spline_in_space
from snnav_core.types import FloatArray, RobotSpec, TimedPath

SPEED, TURN, LINK = 0.7, 2.0, 0.14
BEE = RobotSpec("bee", 0.2, SPEED, TURN)


class Flight(NamedTuple):
    """What a closed-loop run did."""

    states: list[FlyerState]
    rates: FloatArray
    errors: FloatArray  # distance from the true curve [m]


def weave(length: float = 15.0) -> FloatArray:
    """Return a smooth curve in fine steps: rising, to and fro; its radius is nowhere below 1.4 m."""
    x = np.linspace(0.0, length, 6001)
    return np.column_stack((x, 1.2 * np.sin(0.7 * x), 1.0 + 0.08 * x + 0.4 * np.cos(0.5 * x)))


def path_along(curve: FloatArray) -> TimedPath:
    """Return points every link along the curve."""
    length = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))))
    at = np.arange(0.0, length[-1], LINK)
    points = np.column_stack([np.interp(at, length, curve[:, axis]) for axis in range(3)])
    return TimedPath(0.0, LINK / SPEED, points)


def fly(tracker: SpatialTracker, state: FlyerState, curve: FloatArray, limit: float) -> Flight:
    """Fly until the tracker lets the robot hover, at most for `limit` seconds."""
    tree = cKDTree(curve)
    states, rates = [state], []
    for step in range(int(limit / tracker.control_period)):
        command = tracker.command(state, step * tracker.control_period)
        if command.speed == 0.0:
            break
        rates.append(float(np.linalg.norm(command.turn)))
        state = step_flyer(state, command, math.inf, tracker.control_period)
        states.append(state)
    errors, _ = tree.query(np.array([one.position for one in states]))
    return Flight(states, np.array(rates), errors)


def start(offset: tuple[float, float, float] = (0.0, 0.0, 0.0), turned: float = 0.0) -> FlyerState:
    curve = weave()
    first = curve[1] - curve[0]
    heading = math.atan2(first[1], first[0]) + turned
    return FlyerState("bee", curve[0] + np.array(offset), direction_of(heading, 0.08), 0.0, SPEED)


@pytest.mark.parametrize(
    ("law", "period", "limit"),
    [("practical", 0.05, 0.02), ("practical", 0.2, 0.05), ("printed", 0.02, 0.05)],
)
def test_after_three_seconds_the_robot_is_on_its_path(
    law: Literal["practical", "printed"], period: float, limit: float
) -> None:
    tracker = SpatialTracker(BEE, SpatialTrackerSettings(law=law), period)
    curve = weave()
    tracker.set_path(path_along(curve))
    flight = fly(tracker, start((0.0, 0.3, 0.4), turned=1.0), curve, 60.0)
    settled = flight.errors[int(3.0 / period) :]
    assert len(settled) * period > 15.0
    assert float(settled.max()) < limit
    assert float(flight.rates.max()) <= TURN + 1e-9
    assert float(np.linalg.norm(flight.states[-1].position - curve[-1])) < 2 * LINK


@settings(max_examples=30, deadline=None)
@given(st.tuples(*[st.floats(-0.5, 0.5)] * 3), st.floats(-3.1, 3.1))
def test_from_anywhere_near_it_comes_back(offset: tuple[float, float, float], turned: float) -> None:
    tracker = SpatialTracker(BEE, SpatialTrackerSettings(), 0.05)
    curve = weave()
    tracker.set_path(path_along(curve))
    flight = fly(tracker, start(offset, turned), curve, 60.0)
    assert float(flight.errors[int(14.0 / 0.05) :].max()) < 0.05
    assert float(flight.rates.max()) <= TURN + 1e-9


def test_a_robot_that_hovers_leaves_along_the_path() -> None:
    tracker = SpatialTracker(BEE, SpatialTrackerSettings(), 0.05)
    curve = weave()
    tracker.set_path(path_along(curve))
    hovering = FlyerState("bee", curve[0], direction_of(math.pi, -1.0), 0.0, 0.0)
    assert float(fly(tracker, hovering, curve, 60.0).errors.max()) < 0.02


def test_it_hovers_without_a_path_after_its_validity_and_at_its_end() -> None:
    tracker = SpatialTracker(BEE, SpatialTrackerSettings(), 0.05)
    assert tracker.command(start(), 0.0).speed == 0.0
    tracker.set_path(path_along(weave()), valid_until=1.0)
    assert tracker.command(start(), 0.95).speed == SPEED
    assert tracker.command(start(), 0.96).speed == 0.0
    tracker.set_path(TimedPath(0.0, 0.2, np.ones((4, 3))))
    assert tracker.finished
    assert tracker.command(start(), 0.0).speed == 0.0
    tracker.set_path(None)
    assert tracker.finished


def test_successive_paths_of_a_flight_join_without_a_jump() -> None:
    curve = weave()
    whole, state = path_along(curve), start()
    tracker = SpatialTracker(BEE, SpatialTrackerSettings(), 0.05)
    errors, tree = [], cKDTree(curve)
    for decision in range(60):
        rest = np.vstack((state.position, whole.points[decision + 1 :]))
        tracker.set_path(TimedPath(0.2 * decision, 0.2, rest), state.direction)
        for tick in range(4):
            command = tracker.command(state, 0.2 * decision + 0.05 * tick)
            state = step_flyer(state, command, TURN, 0.05)
            errors.append(float(tree.query(state.position)[0]))
    assert max(errors) < 0.03


def test_a_straight_spline_has_no_curvature_and_a_chain_keeps_its_corners() -> None:
    line = np.column_stack((np.arange(5.0), np.zeros(5), np.arange(5.0)))
    track = spline_in_space(line)
    assert track is not None
    assert float(np.abs(track.curvatures).max()) < 1e-9
    corner = chain_in_space(np.array([[0.0, 0, 0], [1, 0, 0], [1, 0, 1]]))
    assert corner is not None
    assert corner.length == pytest.approx(2.0)
    np.testing.assert_allclose(corner.closest(np.array([2.0, 0, 0.5]), 0, 2).tangent, [0, 0, 1])
    assert spline_in_space(np.ones((3, 3))) is None
    assert chain_in_space(np.ones((3, 3))) is None


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"law": "sloppy"}, "law is 'sloppy'"),
        ({"distance_rate": -1.0}, "distance_rate is -1.0"),
        ({"boundary_layer": math.nan}, "boundary_layer is nan"),
    ],
)
def test_wrong_settings_are_refused(change: dict[str, object], message: str) -> None:
    with pytest.raises(InvalidInput, match=message):
        SpatialTrackerSettings(**change)  # type: ignore[arg-type]


def test_wrong_input_is_refused_and_leaves_no_path() -> None:
    tracker = SpatialTracker(BEE, SpatialTrackerSettings(), 0.05)
    with pytest.raises(InvalidInput, match=r"expected \(N, 3\)"):
        tracker.set_path(TimedPath(0.0, 0.2, np.zeros((4, 2))))
    with pytest.raises(InvalidInput, match="valid_until"):
        tracker.set_path(path_along(weave()), valid_until=math.nan)
    with pytest.raises(InvalidInput, match="initial_direction"):
        tracker.set_path(path_along(weave()), np.full(3, math.nan))
    assert tracker.finished
    with pytest.raises(InvalidInput, match="time is nan"):
        tracker.command(start(), math.nan)
    with pytest.raises(InvalidInput, match="control period"):
        SpatialTracker(BEE, SpatialTrackerSettings(), 0.0)
