"""A closed loop of navigator, trackers and unicycles, and an independent check of what the navigator publishes."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
import pytest
import shapely

from snnav_core.area.planar import UnoccupiedArea
from snnav_core.navigator.ground import GroundNavigator
from snnav_core.types import (
    FloatArray,
    PlannedPath,
    Pose2D,
    RobotState,
    StepResult,
    Stop,
    StopReason,
)
from support.fleet import CONTROL_PERIOD, Fleet

Goals = Mapping[str, tuple[float, float]]


@dataclass
class Drive:
    """What happened: one result per decision, one pose per robot and control period."""

    results: list[StepResult] = field(default_factory=list)
    poses: dict[str, list[Pose2D]] = field(default_factory=dict)

    def positions(self, name: str) -> FloatArray:
        return np.array([(pose.x, pose.y) for pose in self.poses[name]])

    def last(self, name: str) -> PlannedPath | Stop:
        return self.results[-1].decisions[name]

    def reasons(self, name: str) -> list[str]:
        """Return for every decision where its path came from, or why there was none."""
        decisions = [result.decisions[name] for result in self.results]
        return [d.source.value if isinstance(d, PlannedPath) else d.reason.value for d in decisions]

    def digests(self) -> list[str]:
        decisions = [decision for result in self.results for decision in result.decisions.values()]
        return [d.path.digest() if isinstance(d, PlannedPath) else d.message for d in decisions]


def drive(
    navigator: GroundNavigator,
    area_at: Callable[[float], UnoccupiedArea],
    poses: Mapping[str, Pose2D],
    goals: Goals,
    duration: float,
) -> Drive:
    """Let all robots follow what the navigator decides, until all have arrived or the time is over."""
    interval = navigator.settings.sampling_interval
    ticks = round(interval / CONTROL_PERIOD)
    fleet = Fleet(navigator.robots, poses)
    log = Drive(poses={name: [pose] for name, pose in poses.items()})
    for step in range(math.ceil(duration / interval)):
        time = step * interval
        area = area_at(time)
        states = fleet.states(time)
        result = navigator.step(time, area, states, goals)
        log.results.append(result)
        check_result(navigator, result, area, states)
        fleet.tell(result.decisions)
        if all(isinstance(d, Stop) and d.reason is StopReason.ARRIVED for d in result.decisions.values()):
            break
        for tick in range(ticks):
            fleet.move(time + tick * CONTROL_PERIOD)
            for name, pose in fleet.poses.items():
                log.poses[name].append(pose)
    return log


def check_result(
    navigator: GroundNavigator, result: StepResult, area: UnoccupiedArea, states: Mapping[str, RobotState]
) -> None:
    """Every published path is the certified one, starts at the robot, and keeps what its certificate says."""
    assert set(result.decisions) == set(navigator.robots)
    for name, decision in result.decisions.items():
        assert decision.robot_id == name
        if isinstance(decision, Stop):
            assert decision.message
            continue
        certificate, path = decision.certificate, decision.path
        assert certificate.accepted
        assert certificate.robot_id == name
        assert certificate.path_digest == path.digest()
        assert certificate.area_stamp == area.stamp
        assert path.start_time == result.time
        window = navigator.settings.time_window * navigator.settings.sampling_interval
        soon = result.time + navigator.settings.sampling_interval
        assert (
            certificate.valid_until >= (soon if path.turn_to is not None else min(soon, path.end_time)) - 1e-9
        )
        assert certificate.valid_until <= result.time + window + 1e-9
        np.testing.assert_allclose(path.points[0], states[name].pose.position, atol=1e-9)
        check_margin(navigator, decision, area)


def check_margin(navigator: GroundNavigator, plan: PlannedPath, area: UnoccupiedArea) -> None:
    """Dense sampling by shapely: the margin grows as long as the path is valid, and is kept beyond."""
    settings, path = navigator.settings, plan.path
    end = max(path.end_time, plan.certificate.valid_until)
    times = path.start_time + np.arange(0.0, end - path.start_time + 1e-9, 0.01)
    positions = path.positions_at(times)
    distance = shapely.distance(shapely.points(positions), area.region.boundary)
    distance[~shapely.intersects_xy(area.region, positions[:, 0], positions[:, 1])] *= -1.0
    elapsed = np.where(times <= plan.certificate.valid_until, times - path.start_time, 0.0)
    growth = settings.boundary_speed * np.where(elapsed > path.step / 8.0, elapsed, 0.0)
    demanded = settings.safety_margin + growth
    # As safe as standing still: in the first interval, and for a robot that comes from nearer than the margin.
    no_nearer = (elapsed <= settings.sampling_interval) | (distance[0] < settings.safety_margin)
    demanded[no_nearer] = np.minimum(demanded[no_nearer], distance[0])
    assert (distance >= demanded - 1e-6).all()


@pytest.fixture(scope="session")
def closed_loop() -> Callable[..., Drive]:
    return drive
