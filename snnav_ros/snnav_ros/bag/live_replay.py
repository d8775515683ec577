"""Fusion and planner among recorded people: recorded scans come in at their own time, simulated robots drive."""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from snnav_core.area.fusion import AreaFusion, FusionSettings
from snnav_core.area.planar import UnoccupiedArea
from snnav_core.errors import InvalidInput
from snnav_core.navigator.ground import GroundNavigator
from snnav_core.navigator.settings import NavigatorSettings
from snnav_core.tracking.planar import PlanarTracker, TrackerSettings
from snnav_core.types import PlannedPath, Pose2D, RobotSpec, RobotState, Stop, StopReason
from snnav_ros.bag.recorded_scans import Recording
from snnav_ros.bag.sensors_file import TopicSensor
from snnav_ros.bag.settings import ReplaySettings
from snnav_sim.devices.base import PioneerBase
from snnav_sim.report.record import Decision, RunRecord

__all__ = ["LiveReplay", "Progress", "ReplayRecord", "ReplayRobot"]

_SMALLEST = 1e-9

Progress = Callable[[float, RunRecord], None]
"""Called once per sampling interval with the time [s from the start of the recording] and what happened so far."""


@dataclass(frozen=True, slots=True)
class ReplayRobot:
    """A simulated robot: what it is, where it starts, where it shall go [m, rad, map]."""

    spec: RobotSpec
    start: Pose2D
    goal: tuple[float, float]


@dataclass
class ReplayRecord:
    """What happened in a replay.

    Parameters
    ----------
    run : RunRecord
        As of a run of a scene (its seed means nothing here); times count from the start of the recording.
    areas : list of UnoccupiedArea
        What was known to be free, one per decision.
    trips : dict
        Robot id -> begin [s] and goal [m, map] of each of its trips; more than one when it goes to and fro.
    arrivals : dict
        Robot id -> times of its arrivals [s].
    refused : dict
        Sensor id -> why scans were refused by the fusion, one line each.
    """

    run: RunRecord
    areas: list[UnoccupiedArea] = field(default_factory=list)
    trips: dict[str, list[tuple[float, tuple[float, float]]]] = field(default_factory=dict)
    arrivals: dict[str, list[float]] = field(default_factory=dict)
    refused: dict[str, list[str]] = field(default_factory=dict)


class _Drive:
    """A robot under way: base, tracker, and where it goes now."""

    def __init__(self, robot: ReplayRobot, control_period: float) -> None:
        self.base = PioneerBase(robot.start, robot.spec)
        self.tracker = PlanarTracker(robot.spec, TrackerSettings(), control_period)
        self.goal, self.next_goal = robot.goal, (robot.start.x, robot.start.y)

    def follow(self, decision: PlannedPath | Stop) -> None:
        if isinstance(decision, Stop):
            self.tracker.set_path(None)
        else:
            valid_until = decision.certificate.valid_until
            self.tracker.set_path(decision.path, self.base.pose.heading, valid_until)

    def turn_round(self) -> None:
        self.goal, self.next_goal = self.next_goal, self.goal


class LiveReplay:
    """A recording and robots ready to run.

    Parameters
    ----------
    sensors : sequence of TopicSensor
    recording : Recording
    robots : sequence of ReplayRobot
        In order of priority.
    settings : ReplaySettings

    Raises
    ------
    InvalidInput
        If a robot does not fit the settings, or the sensors' scans do not overlap in time.

    Notes
    -----
    Decisions fall on every sampling interval from the first moment (rounded up to a control period) when every sensor
    has sent a scan. A scan takes part in the decisions from its arrival on and counts as old as its stamp says.
    Computing takes no time (C3-33).
    """

    def __init__(
        self,
        sensors: Sequence[TopicSensor],
        recording: Recording,
        robots: Sequence[ReplayRobot],
        settings: ReplaySettings,
    ) -> None:
        self.settings = settings
        self.recording = recording
        self._fusion = AreaFusion(
            [entry.sensor for entry in sensors], FusionSettings(boundary_speed=settings.boundary_speed)
        )
        self._navigator = GroundNavigator([robot.spec for robot in robots], _navigator_settings(settings))
        self._drives = {robot.spec.id: _Drive(robot, settings.control_period) for robot in robots}
        first = {scan.sensor_id: scan.arrival for scan in reversed(recording.scans)}
        self._first_tick = math.ceil(max(first.values()) / settings.control_period - _SMALLEST)
        self._tick = self._first_tick
        self._next_scan = 0
        self.record = ReplayRecord(
            RunRecord(seed=0),
            trips={name: [(self.time, drive.goal)] for name, drive in self._drives.items()},
            arrivals={name: [] for name in self._drives},
        )

    @property
    def time(self) -> float:
        """Time from the start of the recording [s], exact to a nanosecond."""
        return round(self._tick * self.settings.control_period, 9)

    def run(self, progress: Progress | None = None) -> ReplayRecord:
        """Run until all robots have arrived (unless they go to and fro, or stay) or the recording is over."""
        run, whole = self.record.run, self.settings.to_and_fro or self.settings.stay
        while not run.reason:
            self._decide()
            if progress is not None:
                progress(self.time, run)
            if not whole and all(self.record.arrivals.values()):
                run.reason = "all robots arrived"
            for _ in range(self.settings.ticks_per_sample):
                self._move()
                if run.reason or self.time > self.recording.end:
                    run.reason = run.reason or "the recording is over"
                    break
        return self.record

    def _decide(self) -> None:
        """Take in what has come, fuse and plan; hand the paths to the trackers."""
        time, run = self.time, self.record.run
        begin = clock.perf_counter()
        self._hear(time)
        area = self._fusion.area(time)
        fused = clock.perf_counter()
        states = {
            name: RobotState(name, drive.base.pose, time, drive.base.command.speed)
            for name, drive in self._drives.items()
        }
        goals = {name: drive.goal for name, drive in self._drives.items()}
        result = self._navigator.step(time, area, states, goals)
        run.fusion_seconds.append(fused - begin)
        run.planner_seconds.append(clock.perf_counter() - fused)
        self.record.areas.append(area)
        for name, decision in result.decisions.items():
            self._drives[name].follow(decision)
            run.decisions.append(Decision.of(time, decision))
            if isinstance(decision, Stop) and decision.reason is StopReason.ARRIVED:
                self._arrive(name, time)

    def _hear(self, time: float) -> None:
        scans = self.recording.scans
        while self._next_scan < len(scans) and scans[self._next_scan].arrival <= time + _SMALLEST:
            found = scans[self._next_scan]
            self._next_scan += 1
            try:
                self._fusion.add_scan(found.sensor_id, found.scan, found.arrival)
            except InvalidInput as error:
                self.record.refused.setdefault(found.sensor_id, []).append(str(error))

    def _arrive(self, name: str, time: float) -> None:
        if self.settings.to_and_fro:
            self.record.arrivals[name].append(time)
            self._drives[name].turn_round()
            self.record.trips[name].append((time, self._drives[name].goal))
        elif not self.record.arrivals[name]:
            self.record.arrivals[name].append(time)

    def _move(self) -> None:
        """Let all robots drive for one control period; the sample of its start is recorded."""
        time = self.time
        for name, drive in self._drives.items():
            pose = drive.base.pose
            drive.base.apply(drive.tracker.command(pose, time), self.settings.control_period)
            self.record.run.add_sample(name, time, pose, drive.base.command)
        self._tick += 1


def _navigator_settings(settings: ReplaySettings) -> NavigatorSettings:
    return NavigatorSettings(
        sampling_interval=settings.sampling_interval,
        safety_margin=settings.safety_margin,
        time_window=settings.time_window,
        boundary_speed=settings.boundary_speed,
    )
