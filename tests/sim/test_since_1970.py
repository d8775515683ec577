"""A run does not depend on when it takes place: real clocks count since 1970, floats to a quarter of a microsecond."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import pytest

from snnav_core.flight_types import FlyerState
from snnav_core.types import Pose2D, RobotState, StepResult
from snnav_sim.scene import find_scene, load_any_scene
from snnav_sim.simulation import Simulation, simulate
from snnav_sim.simulation_flight import FlightSimulation
from snnav_sim.space_types import SpaceScene

SINCE_1970 = 1_795_000_000  # [s]; a day of 2026
SCENES = {
    "crossing": 40.0,  # a control period less in one window, and others go first
    "ten_robots": 12.0,
    "thesis_ch2_dynamic": 12.0,
    "thesis_ch4_four_robots": 8.0,
}


def late(time: float) -> float:
    """A time of a scene as the clock of a robot tells it [s]."""
    return (SINCE_1970 * 10**9 + round(time * 1e9)) * 1e-9


def late_states(states: Mapping[str, Any]) -> dict[str, Any]:
    return {name: replace(state, stamp=late(state.stamp)) for name, state in states.items()}


class Late:
    """Something of the closed loop that is told late times; what it is not told times for is as it was."""

    def __init__(self, inner: Any) -> None:
        self.inner = inner

    def __getattr__(self, name: str) -> Any:
        return getattr(self.inner, name)


class LateFusion(Late):
    def add_scan(self, sensor: str, scan: Any, now: float) -> Any:
        return self.inner.add_scan(sensor, replace(scan, stamp=late(scan.stamp)), late(now))

    def add_image(self, sensor: str, image: Any, now: float) -> None:
        self.inner.add_image(sensor, replace(image, stamp=late(image.stamp)), late(now))

    def add_state(self, state: RobotState | FlyerState) -> None:
        self.inner.add_state(replace(state, stamp=late(state.stamp)))

    def area(self, time: float) -> Any:
        return self.inner.area(late(time))


class LateNavigator(Late):
    def step(self, time: float, area: Any, states: Mapping[str, Any], goals: Any) -> StepResult:
        return self.inner.step(late(time), area, late_states(states), goals)

    def decide(
        self, time: float, fusion: LateFusion, area: Any, states: Mapping[str, Any], goals: Any
    ) -> StepResult:
        return self.inner.decide(late(time), fusion.inner, area, late_states(states), goals)


class LateTracker(Late):
    def command(self, where: Pose2D | FlyerState, time: float) -> Any:
        at = replace(where, stamp=late(where.stamp)) if isinstance(where, FlyerState) else where
        return self.inner.command(at, late(time))


class LateSimulation(Simulation):
    def _join_and_leave(self) -> None:
        if not isinstance(self._fusion, LateFusion):
            self._fusion, self._pilot = LateFusion(self._fusion), LateNavigator(self._pilot)
        super()._join_and_leave()
        for robot in self._robots.values():
            if not isinstance(robot.tracker, LateTracker):
                robot.tracker = LateTracker(robot.tracker)


class LateFlightSimulation(FlightSimulation):
    def _tell_states(self) -> None:
        if not isinstance(self.fusion, LateFusion):
            self.fusion, self.navigator = LateFusion(self.fusion), LateNavigator(self.navigator)
            for flyer in self._flyers.values():
                flyer.tracker = LateTracker(flyer.tracker)
        super()._tell_states()


@pytest.mark.parametrize(("name", "limit"), SCENES.items())
def test_a_run_since_1970_is_the_run_since_zero(name: str, limit: float) -> None:
    scene = replace(load_any_scene(find_scene(name)), time_limit=limit)
    early = simulate(scene)
    run = (LateFlightSimulation if isinstance(scene, SpaceScene) else LateSimulation)(scene).run()
    assert len(run.decisions) == len(early.decisions)
    assert sum(decision.path is not None for decision in run.decisions) > 20
    for there, here in zip(run.decisions, early.decisions, strict=True):
        assert (there.time, there.robot, there.reason) == (here.time, here.robot, here.reason)
        if there.path is None or here.path is None:
            assert there.path is here.path
            continue
        assert there.path.points == pytest.approx(here.path.points, abs=1e-3)
        assert here.valid_until is not None
        assert there.valid_until == pytest.approx(late(here.valid_until), abs=1e-5)
