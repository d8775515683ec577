"""A simulated robot flies through free space that real cameras recorded: a snapshot in which nothing moves."""

from __future__ import annotations

import time as clock
from dataclasses import replace

import numpy as np

from snnav_core.area.spatial import SpatialArea
from snnav_core.flight_types import FlyerState
from snnav_core.navigator.flight import FlightNavigator
from snnav_core.tracking.spatial import SpatialTracker, SpatialTrackerSettings
from snnav_core.types import FloatArray, Stop
from snnav_sim.configure_flight import flight_settings
from snnav_sim.devices.flyer_base import FlyerBase
from snnav_sim.ending import EndWatch
from snnav_sim.report.flight_record import FlightRecord
from snnav_sim.report.record import Decision
from snnav_sim.space_types import SpaceScene

__all__ = ["far_apart", "fly_through"]


def fly_through(scene: SpaceScene, area: SpatialArea) -> FlightRecord:
    """Let the robots of a scene fly through an area that stays as it is.

    Parameters
    ----------
    scene : SpaceScene
        Robots, margins and times; what it says of bodies and sensors is not used.
    area : SpatialArea
        Given to the navigator at every sampling instant.
    """
    record = FlightRecord(scene.seed)
    navigator = FlightNavigator([robot.spec for robot in scene.robots], flight_settings(scene, scene.seed))
    goals = {robot.id: np.array(robot.target) for robot in scene.robots}
    bases = {robot.id: FlyerBase(robot.state, robot.spec) for robot in scene.robots}
    period = scene.control_period
    trackers = {
        robot.id: SpatialTracker(robot.spec, SpatialTrackerSettings(), period) for robot in scene.robots
    }
    watch, tick = EndWatch(scene), 0
    while not record.reason:
        time = round(tick * period, 9)
        states = {name: base.state for name, base in bases.items()}
        begin = clock.perf_counter()
        result = navigator.step(time, replace(area, stamp=time), states, goals)
        record.planner_seconds.append(clock.perf_counter() - begin)
        for name, decision in result.decisions.items():
            record.decisions.append(Decision.of(time, decision))
            if isinstance(decision, Stop):
                trackers[name].set_path(None)
            else:
                ahead = states[name].direction if states[name].speed > 0.0 else None
                trackers[name].set_path(decision.path, ahead, decision.certificate.valid_until)
        stops = {name: d.reason.value for name, d in result.decisions.items() if isinstance(d, Stop)}
        record.reason = watch.update(time, stops)
        for _ in range(scene.ticks_per_sample):
            _move(round(tick * period, 9), period, bases, trackers, record)
            tick += 1
    return record


def _move(
    time: float,
    period: float,
    bases: dict[str, FlyerBase],
    trackers: dict[str, SpatialTracker],
    record: FlightRecord,
) -> None:
    """Let all robots fly for one control period."""
    for name, base in bases.items():
        state = FlyerState(name, base.state.position, base.state.direction, time, base.state.speed)
        command = trackers[name].command(state, time)
        base.apply(command, period)
        record.add_flight(name, time, state, base.command)
        if command.speed > 0.0:
            record.add_error(name, time, trackers[name].distance_error, trackers[name].angle_error)


def far_apart(area: SpatialArea, distance: float) -> tuple[FloatArray, FloatArray] | None:
    """Return two points far apart in the largest connected part that keeps a distance [m], or None if there is none.

    The one farthest from the middle of that part, and the one farthest from it.
    """
    labels, number = area.components(distance)
    if number == 0:
        return None
    largest = int(np.argmax(np.bincount(labels.ravel())[1:])) + 1
    places: FloatArray = area.grid.origin + area.grid.spacing * (np.argwhere(labels == largest) + 0.5)
    first = places[np.argmax(np.linalg.norm(places - places.mean(axis=0), axis=1))]
    second = places[np.argmax(np.linalg.norm(places - first, axis=1))]
    return first, second
