"""What one step may cost is limited, and who hovers in the way of others goes aside."""

from __future__ import annotations

import numpy as np

from snnav_core.flight_types import FlyerState
from snnav_core.navigator.flight_retreat import Retreats
from snnav_core.navigator.flight_settings import FlightDistances, FlightSettings
from snnav_core.types import FloatArray, PlannedPath, RobotSpec, Stop, StopReason
from support.flight_hall import Hall

SETTINGS = FlightSettings(0.2, 0.5)


def at(*numbers: float) -> FloatArray:
    return np.array(numbers)


def test_two_robots_search_in_a_step_and_the_others_wait_for_their_turn() -> None:
    starts = {f"bee_{n}": at(1.0, 1.0 + 1.2 * n, 1.0 + 0.3 * (n % 2)) for n in range(5)}
    hall = Hall(starts, {name: place + at(5.5, 0.0, 0.0) for name, place in starts.items()})
    moving: set[str] = set()
    for expected in (2, 4, 5):
        for name, one in hall.decide().decisions.items():
            if isinstance(one, PlannedPath):
                moving.add(name)
            else:
                assert one.reason is StopReason.NO_PATH
                assert "turn" in one.message
        assert len(moving) == expected


def test_the_last_of_two_that_block_each_other_goes_aside_for_a_while() -> None:
    hall = Hall({"bee": at(3.0, 3.5, 1.5), "wasp": at(4.2, 3.5, 1.5)}, {})
    hall.decide()
    area = hall.fusion.area(0.0)
    distances = {name: FlightDistances(RobotSpec(name, 0.2, 0.7, 2.0), SETTINGS) for name in hall.states}
    goals = {"bee": at(6.5, 3.5, 1.5), "wasp": at(1.0, 3.5, 1.5)}
    retreats = Retreats(10, 1)

    def places(time: float, blocked: int, states: dict[str, FlyerState]) -> dict[str, FloatArray]:
        return retreats.places(
            time, area, ("bee", "wasp"), states, goals, {"bee": 12, "wasp": blocked}, distances
        )

    assert places(0.0, 9, hall.states) == {}
    chosen = places(0.2, 10, hall.states)
    assert list(chosen) == ["wasp"]
    place = chosen["wasp"]
    assert abs(place[1] - 3.5) > 0.9  # off the way of the other
    assert float(area.clearance_at(place[None])[0]) > 0.5
    np.testing.assert_array_equal(places(0.4, 0, hall.states)["wasp"], place)
    there = FlyerState("wasp", place, at(1.0, 0.0, 0.0), 3.0)
    assert places(3.0, 0, {**hall.states, "wasp": there}) == {}


def test_nobody_goes_aside_for_ever() -> None:
    hall = Hall({"bee": at(3.0, 3.5, 1.5), "wasp": at(4.2, 3.5, 1.5)}, {})
    hall.decide()
    area = hall.fusion.area(0.0)
    distances = {name: FlightDistances(RobotSpec(name, 0.2, 0.7, 2.0), SETTINGS) for name in hall.states}
    goals = {"bee": at(6.5, 3.5, 1.5), "wasp": at(1.0, 3.5, 1.5)}
    retreats = Retreats(10, 1)
    blocked = {"bee": 99, "wasp": 99}
    sent = [
        bool(retreats.places(10.0 * n, area, ("bee", "wasp"), hall.states, goals, blocked, distances))
        for n in range(12)
    ]
    assert sent[0]
    assert not any(sent[-4:])


def test_a_target_that_cannot_be_reached_is_told_in_every_step() -> None:
    wall = np.array([[[3.8, 0.0, 0.0], [4.2, 7.0, 3.0]]])
    hall = Hall({"bee": at(1.5, 1.5, 1.5)}, {"bee": at(6.5, 1.5, 1.5)}, wall)
    for _ in range(4):
        decision = hall.decide().decisions["bee"]
        assert isinstance(decision, Stop)
        assert decision.reason is StopReason.GOAL_UNREACHABLE
        hall.fly(0.2)
