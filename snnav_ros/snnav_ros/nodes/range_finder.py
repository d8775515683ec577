"""What the nodes of simulated range finders share, in the plane and in space."""

from __future__ import annotations

import time
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, ClassVar

from nav_msgs.msg import Odometry
from rclpy.node import Node

from snnav_core.area.robots import RobotTrack
from snnav_core.errors import InvalidInput
from snnav_ros.convert import nanoseconds, seconds, seconds_from_stamp
from snnav_ros.lockstep import Participant
from snnav_ros.nodes.base import NodeOptions, serve
from snnav_ros.nodes.node_time import is_simulated, now_of, steady_clock, watch_time
from snnav_ros.parameters import ParameterReader
from snnav_ros.qos import ODOMETRY_INPUT, for_mode
from snnav_ros.waiting import WaitingReport
from snnav_sim.devices import SensorFeed
from snnav_sim.devices.feed import Measuring

__all__ = ["RangeFinderNode", "RangeFinderParameters"]

_REAL_TIME_PERIOD = 0.2  # [s]
_LOOK = 0.05  # [s] from one look for arrivals to the next, in real time


@dataclass(frozen=True)
class RangeFinderParameters:
    """Parameters of the node besides `scene`.

    Parameters
    ----------
    sensor_id : str
        Which sensor of the scene this is; may stay empty when there is only one.
    seed : int or None
        Of noise and drop-outs; the scene's when left out.
    scan_period : float or None
        Time from measurement to measurement in real time [s]; when left out the scene's, or where that says nothing
        0.2 s or the sampling interval, whichever is shorter.
    lockstep : bool
        Simulated time goes on only when all nodes have consumed the data of a tick.
    """

    sensor_id: str = ""
    seed: int | None = None
    scan_period: float | None = None
    lockstep: bool = False


class RangeFinderNode(Node):
    """Publishes what one sensor of a scene measures; hears `<robot>/odom` of all robots that it sees.

    With `use_sim_time` the time of the scene is the time of ROS; else the scene begins when the node starts, and goes
    on steadily whatever happens to the clock of the machine.
    """

    usual_name: ClassVar[str]
    ticks: ClassVar[str]
    """Whether a sensor that sees robots takes part in every tick of lockstep (`control`), or at sampling instants."""

    def __init__(self, options: NodeOptions | None = None) -> None:
        options = options or NodeOptions()
        super().__init__(options.name or self.usual_name, **options.keywords())
        self._scene, self._sensor = scene, sensor = self._read()
        lockstep = self.settings.lockstep
        self._tracks = {robot.id: RobotTrack(robot.spec) for robot in self.seen_robots(scene, sensor)}
        seed = scene.seed if self.settings.seed is None else self.settings.seed
        device = self.make_device(scene, sensor, seed, list(self._tracks.values()))
        self._feed: SensorFeed[Any] = SensorFeed(device, scene.scan_period(sensor), seed)
        self._enabled, self._begun = True, False
        self._mouth = self.make_publisher(sensor.id, lockstep)
        for name in self._tracks:
            take = partial(self._on_odometry, name)
            self.create_subscription(Odometry, f"{name}/odom", take, for_mode(lockstep, ODOMETRY_INPUT))
        serve(self, options, lambda: None, {"enable": self._enable})
        self._participant: Participant | None = None
        if lockstep:
            self._sample_ns = nanoseconds(scene.sampling_interval)
            each = self._tracks and self.ticks == "control"
            period = nanoseconds(scene.control_period) if each else self._sample_ns
            self._participant = Participant(self, period, self._on_tick, self._feed.reset)
        else:
            self._run_freely(min(_LOOK, scene.scan_period(sensor)))
        self._waiting = WaitingReport(self, self._inputs)

    # what differs between the plane and space

    @abstractmethod
    def read_scene(self, reader: ParameterReader) -> Any:
        """Return the scene, of the world of the node."""

    @abstractmethod
    def seen_robots(self, scene: Any, sensor: Any) -> Sequence[Any]:
        """Return the robots of the scene that a sensor sees."""

    @abstractmethod
    def make_device(self, scene: Any, sensor: Any, seed: int, tracks: list[RobotTrack]) -> Measuring[Any]:
        """Return what measures."""

    @abstractmethod
    def make_publisher(self, sensor_id: str, lockstep: bool) -> Any:
        """Return the publisher of the measurements."""

    @abstractmethod
    def to_message(self, measurement: Any, sensor: Any, stamp_ns: int) -> Any:
        """Return the message of a measurement."""

    @abstractmethod
    def nothing(self, sensor_id: str, stamp_ns: int) -> Any:
        """Return the message that says "nothing more" up to a time [ns]."""

    @abstractmethod
    def take_state(self, track: RobotTrack, message: Odometry, topic: str, origin: float) -> None:
        """Add the state that odometry tells, in the time of the scene, which began at `origin` [s]."""

    # what does not

    def _read(self) -> tuple[Any, Any]:
        """Return the scene and this sensor of it, whose period in real time is never the default of the scene."""
        reader = ParameterReader(self)
        scene = self.read_scene(reader)
        self.settings = reader.settings(RangeFinderParameters)
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
        origin = seconds(self._origin())
        try:
            stamp = seconds_from_stamp(message.header.stamp) - origin
            if self._participant is not None and track.last_stamp is not None and stamp < track.last_stamp:
                track.clear()  # in lockstep nothing is late: time began anew
            self.take_state(track, message, topic, origin)
        except InvalidInput as error:
            self.get_logger().warning(f"message not used: {error}", throttle_duration_sec=5.0)
        self._measure_when_ready()

    def _on_tick(self, _: int) -> None:
        self._waiting.heard("/clock")
        self._measure_when_ready()

    def _measure_when_ready(self) -> None:
        """In lockstep: measure at sampling instants, once it is known where all robots are that can be seen."""
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
                self._mouth.publish(self.nothing(self._sensor.id, tick))
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
        arrived = self._feed.arrivals(seconds(now))
        if self._participant is None and not self._begun:
            arrived = arrived[-1:]  # in real time nobody waits for what was before the node
        last = -1
        for measurement in arrived if self._enabled else []:
            last = nanoseconds(measurement.stamp) + origin
            self._mouth.publish(self.to_message(measurement, self._sensor, last))
        return last
