"""The closed loop of flying robots without ROS: images, free region, decision, tracking and motion of a scene."""

from __future__ import annotations

import time as clock
from collections.abc import Sequence

import numpy as np
from scipy.interpolate import CubicSpline

from snnav_core.area.robots import RobotTrack
from snnav_core.area.spatial import SpatialArea
from snnav_core.errors import InvalidInput
from snnav_core.flight_types import FlyerState
from snnav_core.navigator.flight import FlightNavigator
from snnav_core.navigator.flight_settings import FlightDistances
from snnav_core.planning.adjustment import resample
from snnav_core.sensing.depth import DepthImage
from snnav_core.tracking.spatial import SpatialTracker, SpatialTrackerSettings
from snnav_core.types import PlannedPath, StepResult, Stop, StopReason, TimedPath
from snnav_sim.closed_loop import ClosedLoop
from snnav_sim.configure_flight import flight_settings, make_network
from snnav_sim.devices.feed import SensorFeed
from snnav_sim.devices.flyer_base import FlyerBase
from snnav_sim.devices.tof import DepthDevice
from snnav_sim.report.flight_record import FlightRecord
from snnav_sim.report.record import Decision
from snnav_sim.space_types import FlyerScene, SpaceScene
from snnav_sim.space_world import SpaceWorld

__all__ = ["FlightSimulation", "curve_of"]

_FINE = 0.01  # [m]; from point to point of a curve before it is cut into links


class _Flyer:
    """One simulated robot: its base and its tracker."""

    def __init__(self, entry: FlyerScene, control_period: float) -> None:
        self.entry = entry
        self.base = FlyerBase(entry.state, entry.spec)
        self.tracker = SpatialTracker(entry.spec, SpatialTrackerSettings(), control_period)

    def follow(self, decision: PlannedPath | Stop) -> None:
        if isinstance(decision, Stop):
            self.tracker.set_path(None)
            return
        state = self.base.state
        ahead = state.direction if state.speed > 0.0 else None
        self.tracker.set_path(decision.path, ahead, decision.certificate.valid_until)

    def state(self, time: float) -> FlyerState:
        """Where it is at the present time [s]."""
        state = self.base.state
        return FlyerState(state.id, state.position, state.direction, time, state.speed)


class FlightSimulation(ClosedLoop[SpaceScene, FlightRecord]):
    """A scene in space ready to run.

    Parameters
    ----------
    scene : SpaceScene
    seed : int, optional
        Instead of the seed of the scene.

    Notes
    -----
    Computing takes no simulated time (C3-33): the path of a sampling instant is followed from that instant on.
    Robots are put into the room right after the images of time 0: those show what is behind them.
    """

    def __init__(self, scene: SpaceScene, seed: int | None = None) -> None:
        super().__init__(scene, FlightRecord(scene.seed if seed is None else seed))
        self.world = SpaceWorld(scene)
        self._flyers = {robot.id: _Flyer(robot, scene.control_period) for robot in scene.robots}
        self._tracks = {robot.id: RobotTrack(robot.spec) for robot in scene.robots}
        self._feeds = [
            SensorFeed(
                DepthDevice(sensor, self.world, self.seed, self._tracks.values()),
                scene.scan_period(sensor),
                self.seed,
            )
            for sensor in scene.sensors
        ]
        self.fusion = make_network(scene)
        self._settings = flight_settings(scene, self.seed)
        self.navigator = FlightNavigator([robot.spec for robot in scene.planned], self._settings)
        self._goals = {robot.id: np.array(robot.target) for robot in scene.planned}
        self._tell_states()

    def decide(self) -> StepResult:
        """Measure, fuse and plan at the present sampling instant; hand the paths to the trackers."""
        time = self.time
        images = [(feed.device.sensor.id, image) for feed in self._feeds for image in feed.arrivals(time)]
        begin = clock.perf_counter()
        area = self._fuse(time, images)
        fused = clock.perf_counter()
        states = {name: flyer.state(time) for name, flyer in self._flyers.items() if name in self._goals}
        result = self.navigator.step(time, area, states, self._goals)
        self.record.fusion_seconds.append(fused - begin)
        self.record.planner_seconds.append(clock.perf_counter() - fused)
        self._obey(result, self._flyers)
        on_curves = {name: stop for name in self._flyers if (stop := self._along_curve(name, time))}
        return StepResult(time, {**result.decisions, **on_curves})

    def _fuse(self, time: float, images: Sequence[tuple[str, DepthImage]]) -> SpatialArea:
        """Take in what the cameras sent and return what is proved free."""
        for sensor_id, image in images:
            try:
                self.fusion.add_image(sensor_id, image, time)
            except InvalidInput as error:
                self.record.add_rejection(sensor_id, str(error))
        return self.fusion.area(time)

    def move(self) -> None:
        """Let all robots fly for one control period; the sample of its start is recorded."""
        time = self.time
        self._tick += 1
        for name, flyer in self._flyers.items():
            state = flyer.state(time)
            command = flyer.tracker.command(state, time)
            flyer.base.apply(command, self.scene.control_period)
            self.record.add_flight(name, time, state, flyer.base.command)
            if command.speed > 0.0:
                tracker = flyer.tracker
                self.record.add_error(name, time, tracker.distance_error, tracker.angle_error)
        self._tell_states()

    def _along_curve(self, name: str, time: float) -> Stop | None:
        """Hand a robot the curve that its scene gives it, once; return a stop when it is through."""
        flyer = self._flyers[name]
        if not flyer.entry.curve:
            return None
        if self._tick == 0:
            path = curve_of(flyer.entry, FlightDistances(flyer.entry.spec, self._settings), time)
            flyer.tracker.set_path(path)
            self.record.decisions.append(Decision(time, name, path, source="curve"))
            return None
        if not flyer.tracker.finished:
            return None
        stop = Stop(name, StopReason.ARRIVED, f"robot {name} is at the end of its curve")
        self.record.decisions.append(Decision.of(time, stop))
        return stop

    def _tell_states(self) -> None:
        """Let cameras and fusion know where the robots are."""
        for name, flyer in self._flyers.items():
            state = flyer.state(self.time)
            self._tracks[name].add_flyer(state)
            self.fusion.add_state(state)


def curve_of(robot: FlyerScene, distances: FlightDistances, time: float) -> TimedPath:
    """Return the smooth curve through the points that a scene gives a robot, in links, from a time [s] on."""
    points = np.array(robot.curve)
    marks = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))))
    fine = np.linspace(0.0, marks[-1], max(2, int(marks[-1] / _FINE)))
    curve = CubicSpline(marks, points)(fine) if len(points) > 2 else points
    return TimedPath(time, distances.step, resample(np.asarray(curve, dtype=np.float64), distances.link))
