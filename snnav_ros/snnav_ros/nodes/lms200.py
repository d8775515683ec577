"""The node of one range finder of a scene: simulated, or repeating a recorded scan."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from functools import partial

from nav_msgs.msg import Odometry
from rclpy.node import Node
from sensor_msgs.msg import LaserScan

from snnav_core.area.robots import RobotTrack
from snnav_core.errors import InvalidInput
from snnav_ros.convert import (
    nanoseconds,
    nothing_to_message,
    scan_to_message,
    seconds,
    state_from_message,
)
from snnav_ros.lockstep import Participant
from snnav_ros.nodes.base import NodeOptions, serve
from snnav_ros.nodes.node_time import is_simulated, now_of, steady_clock, watch_time
from snnav_ros.parameters import ParameterReader
from snnav_ros.qos import ODOMETRY_INPUT, SENSOR, for_mode
from snnav_ros.scenes import read_planar_scene
from snnav_ros.waiting import WaitingReport
from snnav_sim.devices import SensorFeed, make_device
from snnav_sim.scene_types import Scene, SensorScene
from snnav_sim.world import World

__all__ = ["Lms200Node", "ScannerParameters"]

_REAL_TIME_PERIOD = 0.2  # [s]
_LOOK = 0.05  # [s] from one look for arrivals to the next, in real time


@dataclass(frozen=True)
class ScannerParameters:
    """Parameters of the node besides `scene`.

    Parameters
    ----------
    sensor_id : str
        Which sensor of the scene this is; may stay empty when there is only one.
    seed : int or None
        Of noise and drop-outs; the scene's when left out.
    scan_period : float or None
        Time from scan to scan in real time [s]; when left out the scene's, or where that says nothing 0.2 s or the
        sampling interval, whichever is shorter.
    lockstep : bool
        Simulated time goes on only when all nodes have consumed the data of a tick.
    """

    sensor_id: str = ""
    seed: int | None = None
    scan_period: float | None = None
    lockstep: bool = False


class Lms200Node(Node):
    """Publishes `sensors/<id>/scan`; a scanner that sees robots hears `<robot>/odom` of all robots of the scene.

    With `use_sim_time` the time of the scene is the time of ROS; else the scene begins when the node starts, and goes
    on steadily whatever happens to the clock of the machine.
    """

    def __init__(self, options: NodeOptions | None = None) -> None:
        options = options or NodeOptions()
        super().__init__(options.name or "lms200_node", **options.keywords())
        scene, sensor = self._read()
        lockstep = self.settings.lockstep
        seen = scene.robots if sensor.sees_robots else ()
        self._scene = scene
        self._tracks = {robot.id: RobotTrack(robot.spec) for robot in seen}
        seed = scene.seed if self.settings.seed is None else self.settings.seed
        device = make_device(sensor, World(scene), seed, list(self._tracks.values()))
        self._feed = SensorFeed(device, scene.scan_period(sensor), seed)
        self._sensor_id, self._enabled, self._begun = sensor.id, True, False
        self._scans = self.create_publisher(
            LaserScan, f"sensors/{sensor.id}/scan", for_mode(lockstep, SENSOR)
        )
        for name in self._tracks:
            take = partial(self._on_odometry, name)
            self.create_subscription(Odometry, f"{name}/odom", take, for_mode(lockstep, ODOMETRY_INPUT))
        serve(self, options, lambda: None, {"enable": self._enable})
        self._participant: Participant | None = None
        if lockstep:
            self._sample_ns = nanoseconds(scene.sampling_interval)
            period = nanoseconds(scene.control_period) if self._tracks else self._sample_ns
            self._participant = Participant(self, period, self._on_tick, self._feed.reset)
        else:
            self._run_freely(min(_LOOK, scene.scan_period(sensor)))
        self._waiting = WaitingReport(self, self._inputs)

    def _read(self) -> tuple[Scene, SensorScene]:
        """Return the scene and this sensor of it, whose period in real time is never the default of the scene."""
        reader = ParameterReader(self)
        scene = read_planar_scene(reader, required=True)
        assert scene is not None
        self.settings = reader.settings(ScannerParameters)
        reader.finish()
        ids = [sensor.id for sensor in scene.sensors]
        chosen = self.settings.sensor_id or (ids[0] if len(ids) == 1 else "")
        if chosen not in ids:
            reader.fail(
                "sensor_id", f"value {chosen!r} names no sensor of {scene.name}; it has {', '.join(ids)}"
            )
        sensor = scene.sensors[ids.index(chosen)]
        if not self.settings.lockstep:
            usual = sensor.scan_period or min(_REAL_TIME_PERIOD, scene.sampling_interval)
            sensor = replace(sensor, scan_period=self.settings.scan_period or usual)
        return scene, sensor

    def _run_freely(self, look: float) -> None:
        self._begin = time.monotonic_ns()
        if is_simulated(self):
            self._jump = watch_time(self, self._start_afresh)
        self.create_timer(look, self._on_timer, clock=None if is_simulated(self) else steady_clock())

    def _inputs(self) -> list[str]:
        clock = ["/clock"] if self.settings.lockstep or is_simulated(self) else []
        return [*clock, *(f"{name}/odom" for name in self._tracks)]

    def _enable(self, enabled: bool) -> None:
        self._enabled = enabled

    def _start_afresh(self) -> None:
        self._feed.reset()
        for track in self._tracks.values():
            track.clear()

    def _origin(self) -> int:
        """When the scene began, by the clock of ROS [ns]."""
        if self.settings.lockstep or is_simulated(self):
            return 0
        return now_of(self) - (time.monotonic_ns() - self._begin)

    def _on_odometry(self, name: str, message: Odometry) -> None:
        topic, track = f"{name}/odom", self._tracks[name]
        self._waiting.heard(topic)
        try:
            state = state_from_message(message, name, topic)
            stamp = state.stamp - seconds(self._origin())
            if self._participant is not None and track.last_stamp is not None and stamp < track.last_stamp:
                track.clear()  # in lockstep nothing is late: time began anew
            track.add(stamp, state.pose, state.speed)
        except InvalidInput as error:
            self.get_logger().warning(f"message not used: {error}", throttle_duration_sec=5.0)
        self._scan_when_ready()

    def _on_tick(self, _: int) -> None:
        self._waiting.heard("/clock")
        self._scan_when_ready()

    def _scan_when_ready(self) -> None:
        """In lockstep: scan at sampling instants, once it is known where all robots are that can be seen."""
        if self._participant is None or self._participant.due is None:
            return
        tick = self._participant.due
        for robot in self._scene.robots if self._tracks else ():
            track = self._tracks[robot.id]
            if not self._scene.is_present(robot, seconds(tick)):
                track.clear()
            elif track.last_stamp != seconds(tick):
                return
        if tick % self._sample_ns == 0:
            last = self._publish(tick, 0)
            if last != tick:
                self._scans.publish(nothing_to_message(self._sensor_id, tick))
        self._participant.done()

    def _on_timer(self) -> None:
        self._waiting.heard("/clock")
        origin = self._origin()
        now = now_of(self) - origin
        for robot in self._scene.robots if self._tracks else ():
            if not self._scene.is_present(robot, seconds(now)):
                self._tracks[robot.id].clear()
        self._publish(now, origin)
        self._begun = True

    def _publish(self, now: int, origin: int) -> int:
        """Publish what arrives up to now, in the time of the scene, and return the last stamp or -1 [ns]."""
        scans = self._feed.arrivals(seconds(now))
        if self._participant is None and not self._begun:
            scans = scans[-1:]  # in real time nobody waits for what was before the node
        last = -1
        for scan in scans if self._enabled else []:
            last = nanoseconds(scan.stamp) + origin
            self._scans.publish(scan_to_message(scan, self._sensor_id, last))
        return last
