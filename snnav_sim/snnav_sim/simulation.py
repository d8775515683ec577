"""The closed loop without ROS: scans, area, decision, tracking and motion of a scene."""

from __future__ import annotations

import time as clock

from snnav_core.area.fusion import AreaFusion
from snnav_core.area.robots import RobotTrack
from snnav_core.errors import InvalidInput
from snnav_core.tracking.planar import PlanarTracker, TrackerSettings
from snnav_core.types import PlannedPath, RobotState, StepResult, Stop
from snnav_sim.closed_loop import ClosedLoop, Progress
from snnav_sim.configure import fusion_settings, planar_sensor
from snnav_sim.devices import SensorFeed, make_device
from snnav_sim.devices.base import PioneerBase
from snnav_sim.pilot import pilot_of
from snnav_sim.report.record import RunRecord
from snnav_sim.scene import AnyScene
from snnav_sim.scene_types import RobotScene, Scene
from snnav_sim.simulation_flight import FlightSimulation
from snnav_sim.space_types import SpaceScene
from snnav_sim.world import World

__all__ = ["Progress", "Simulation", "simulate", "simulation_of"]


class _Robot:
    """One simulated robot: its base and its tracker."""

    def __init__(self, entry: RobotScene, control_period: float) -> None:
        self.base = PioneerBase(entry.pose, entry.spec)
        self.tracker = PlanarTracker(entry.spec, TrackerSettings(), control_period)

    def follow(self, decision: PlannedPath | Stop) -> None:
        if isinstance(decision, Stop):
            self.tracker.set_path(None)
        else:
            valid_until = decision.certificate.valid_until
            self.tracker.set_path(decision.path, self.base.pose.heading, valid_until)


class Simulation(ClosedLoop[Scene, RunRecord]):
    """A scene ready to run; `snnav_sim.simulation.simulate` is all that most need.

    Parameters
    ----------
    scene : Scene
    seed : int, optional
        Instead of the seed of the scene.

    Notes
    -----
    Computing takes no simulated time (C3-33): the path of a sampling instant is followed from that instant on. The
    order within an instant is that of the nodes in lockstep.
    """

    def __init__(self, scene: Scene, seed: int | None = None) -> None:
        super().__init__(scene, RunRecord(scene.seed if seed is None else seed))
        self.world = World(scene)
        seen = [robot.spec for robot in scene.robots if scene.sees_robots]
        self._tracks = {spec.id: RobotTrack(spec) for spec in seen}
        tracks = list(self._tracks.values())
        self._feeds = [
            SensorFeed(
                make_device(sensor, self.world, self.seed, tracks), scene.scan_period(sensor), self.seed
            )
            for sensor in scene.sensors
        ]
        sensors = [planar_sensor(sensor) for sensor in scene.sensors]
        self._fusion = AreaFusion(sensors, fusion_settings(scene))
        self._pilot = pilot_of(scene)
        self._robots: dict[str, _Robot] = {}
        self._join_and_leave()
        self._tell_states()

    def decide(self) -> StepResult:
        """Measure, fuse and plan at the present sampling instant; hand the paths to the trackers."""
        time = self.time
        goals = {robot.id: robot.target_at(time) for robot in self.scene.robots if robot.id in self._robots}
        scans = [(feed.device.sensor.id, scan) for feed in self._feeds for scan in feed.arrivals(time)]
        begin = clock.perf_counter()
        for sensor_id, scan in scans:
            try:
                self._fusion.add_scan(sensor_id, scan, now=time)
            except InvalidInput as error:
                self.record.add_rejection(sensor_id, str(error))
        area = self._fusion.area(time)
        fused = clock.perf_counter()
        result = self._pilot.decide(time, self._fusion, area, self._states(), goals)
        self.record.add_plans(time, self._pilot.plans)
        self.record.add_area(area)
        self.record.fusion_seconds.append(fused - begin)
        self.record.planner_seconds.append(clock.perf_counter() - fused)
        self._obey(result, self._robots)
        return result

    def move(self) -> None:
        """Let all robots drive for one control period; the sample of its start is recorded."""
        time = self.time
        for name, robot in self._robots.items():
            pose = robot.base.pose
            robot.base.apply(robot.tracker.command(pose, time), self.scene.control_period)
            self.record.add_sample(name, time, pose, robot.base.command)
        self._tick += 1
        if self._tick % self.scene.ticks_per_sample == 0:
            self._join_and_leave()
        self._tell_states()

    def _join_and_leave(self) -> None:
        """Let robots out of the workspace, then in, as the scene says for this sampling instant."""
        present = {robot.id: robot for robot in self.scene.robots if self.scene.is_present(robot, self.time)}
        for name in self._robots.keys() - present.keys():
            del self._robots[name]
            self._pilot.navigator.remove_robot(name)
            if name in self._tracks:
                self._tracks[name].clear()
                self._fusion.remove_robot(name)
        for name, robot in present.items():
            if name not in self._robots:
                self._robots[name] = _Robot(robot, self.scene.control_period)
                self._pilot.navigator.add_robot(robot.spec)
                if name in self._tracks:
                    self._fusion.add_robot(robot.spec)

    def _states(self) -> dict[str, RobotState]:
        time = self.time
        return {
            name: RobotState(name, robot.base.pose, time, robot.base.command.speed)
            for name, robot in self._robots.items()
        }

    def _tell_states(self) -> None:
        """Let scanners that see robots, and the fusion then, know where the robots are."""
        if not self._tracks:
            return
        for name, state in self._states().items():
            self._tracks[name].add(state.stamp, state.pose, state.speed)
            self._fusion.add_state(state)


def simulation_of(scene: AnyScene, seed: int | None = None) -> Simulation | FlightSimulation:
    """Return the closed loop of a scene, in the plane or in space, ready to run; parameters as of `simulate`."""
    return FlightSimulation(scene, seed) if isinstance(scene, SpaceScene) else Simulation(scene, seed)


def simulate(scene: AnyScene, seed: int | None = None, progress: Progress | None = None) -> RunRecord:
    """Run a scene without ROS until all robots arrived, the time limit, or nothing will change any more.

    Parameters
    ----------
    scene : Scene
    seed : int, optional
        Instead of the seed of the scene.
    progress : callable, optional
        Called once per sampling interval with the simulated time and the number of robots that have arrived.

    Returns
    -------
    RunRecord
    """
    return simulation_of(scene, seed).run(progress)
