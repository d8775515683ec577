"""From what happened in a replay to what its figures show."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from snnav_core.types import FloatArray
from snnav_ros.bag.live_replay import ReplayRecord, ReplayRobot
from snnav_ros.bag.replay_judge import Returns, Verdict
from snnav_ros.bag.sensors_file import TopicSensor
from snnav_sim.report.record import Decision
from snnav_sim.report.replay_figures import Distances, Moment, RobotMoment, draw_distances, draw_moments

__all__ = ["draw_replay"]

_PANELS = 4
_DOING = {
    "warm_start": "drives",
    "tangent_graph": "drives",
    "shortest_path": "drives",
    "straight_leg": "drives a straight leg",
    "last_path": "follows its last path",
    "turn_in_place": "turns on the spot",
    "evasion": "makes room",
    "yield": "makes room for a robot",
    "yields": "waits for a robot",
    "arrived": "has arrived",
}


def draw_replay(
    directory: Path,
    title: str,
    sensors: Sequence[TopicSensor],
    robots: Sequence[ReplayRobot],
    record: ReplayRecord,
    returns: Sequence[Returns],
    verdicts: Mapping[str, Verdict],
) -> None:
    """Draw ``replay.png`` and ``clearance.png`` into a directory."""
    positions = np.array([entry.sensor.pose.position for entry in sensors])
    first = verdicts[robots[0].spec.id]
    trip = _telling_trip(record, robots[0], first)
    times = _telling_times(record, robots[0], first, trip)
    moments = [_moment(time, trip[0], robots, record, returns) for time in times]
    draw_moments(title, positions, moments, directory / "replay.png")
    distances = [
        Distances(name, verdict.times, verdict.distances, verdict.person_distances, _standing(record, name))
        for name, verdict in verdicts.items()
    ]
    draw_distances(f"{title}: distance from the robot's disk", distances, directory / "clearance.png")


def _telling_trip(record: ReplayRecord, robot: ReplayRobot, verdict: Verdict) -> tuple[float, float]:
    """Return begin and end of the trip between two arrivals [s] on which people came nearest to the moving robot."""
    rows = record.run.trajectory(robot.spec.id)
    moving = np.where(rows[:, 4] > 0.0, verdict.person_distances, math.inf)
    if not np.isfinite(moving).any():
        return float(rows[0, 0]), float(rows[-1, 0])
    nearest = float(rows[int(np.argmin(moving)), 0])
    begin = max(time for time, _ in record.trips[robot.spec.id] if time <= nearest)
    arrivals = record.arrivals[robot.spec.id]
    return begin, min((time for time in arrivals if time > nearest), default=float(rows[-1, 0]))


def _telling_times(
    record: ReplayRecord, robot: ReplayRobot, verdict: Verdict, trip: tuple[float, float]
) -> list[float]:
    """Return the times [s] at which the robot has driven 1/8, 3/8, 5/8, 7/8 of a trip; evenly spread if it stood.

    One of them gives way to the time at which people were nearest.
    """
    rows = record.run.trajectory(robot.spec.id)
    within = (rows[:, 0] >= trip[0]) & (rows[:, 0] <= trip[1])
    rows, people = rows[within], verdict.person_distances[within]
    shares = (np.arange(_PANELS) + 0.5) / _PANELS
    driven = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(rows[:, 1:3], axis=0).T))])
    if driven[-1] < 2.0 * robot.spec.radius:
        times = trip[0] + shares * (trip[1] - trip[0])
    else:
        times = rows[np.searchsorted(driven, shares * driven[-1]), 0]
    if np.isfinite(people).any():
        nearest = rows[int(np.argmin(people)), 0]
        times[int(np.argmin(np.abs(times - nearest)))] = nearest
    return [float(time) for time in np.sort(times)]


def _moment(
    time: float,
    begin: float,
    robots: Sequence[ReplayRobot],
    record: ReplayRecord,
    returns: Sequence[Returns],
) -> Moment:
    area = next((area for area in reversed(record.areas) if area.stamp <= time), record.areas[0])
    latest = {scan.sensor_id: scan for scan in returns if scan.stamp <= time}
    points = [np.zeros((0, 2)), *(scan.points for scan in latest.values())]
    is_person = np.concatenate([np.zeros(0, dtype=bool), *(scan.is_person for scan in latest.values())])
    everything = np.concatenate(points)
    shown = tuple(_robot_moment(time, begin, robot, record) for robot in robots)
    return Moment(time, area.region, everything[is_person], everything[~is_person], shown)


def _robot_moment(time: float, begin: float, robot: ReplayRobot, record: ReplayRecord) -> RobotMoment:
    name = robot.spec.id
    rows = record.run.trajectory(name)
    index = max(0, int(np.searchsorted(rows[:, 0], time + 1e-9)) - 1)
    decision = next((d for d in reversed(record.run.decisions_of(name)) if d.time <= time + 1e-9), None)
    goal = [goal for start, goal in record.trips[name] if start <= time][-1]
    planned = None if decision is None or decision.path is None else decision.path.points
    x, y, heading = rows[index, 1:4].tolist()
    first = int(np.searchsorted(rows[:, 0], begin))
    driven: FloatArray = rows[first : index + 1, 1:3]
    return RobotMoment(name, (x, y), heading, robot.spec.radius, goal, driven, planned, _doing(decision))


def _doing(decision: Decision | None) -> str:
    """Return in words what a robot does."""
    if decision is None:
        return "waits"
    if decision.path is None and decision.reason != "arrived":
        return f"waits ({decision.reason.replace('_', ' ')})"
    return _DOING.get(decision.reason or decision.source, "drives")


def _standing(record: ReplayRecord, name: str) -> list[tuple[float, float]]:
    """Return the periods in which a robot stood [s]."""
    rows = record.run.trajectory(name)
    still = np.concatenate([[False], rows[:, 4] <= 0.0, [False]]).astype(np.int8)
    begins, ends = np.flatnonzero(np.diff(still) == 1), np.flatnonzero(np.diff(still) == -1)
    return [(float(rows[b, 0]), float(rows[e - 1, 0])) for b, e in zip(begins, ends, strict=True)]
