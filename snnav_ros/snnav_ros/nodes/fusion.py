"""The node that makes the unoccupied area of what all sensors saw, in the plane or in space."""

from __future__ import annotations

import time as clock
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol

from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry
from rclpy.qos import QoSProfile

from snnav_core.errors import InvalidInput
from snnav_core.types import RobotSpec
from snnav_ros.convert import MAP_FRAME, nanoseconds, nanoseconds_from_stamp, seconds
from snnav_ros.lockstep import Participant
from snnav_ros.nodes.base import ManagedNode, NodeOptions, diagnostics, serve, status
from snnav_ros.nodes.fusion_plane import PlaneFusion
from snnav_ros.nodes.fusion_space import SpaceFusion, read_workspace
from snnav_ros.nodes.node_time import now_of, watch_time
from snnav_ros.nodes.roster import Roster
from snnav_ros.qos import DIAGNOSTICS, ODOMETRY_INPUT, for_mode
from snnav_ros.scenes import read_scene
from snnav_sim.scene import AnyScene, SpaceScene

__all__ = ["FusionNode", "FusionParameters"]

_MOST_SCANS, _MOST_STATES = 10, 200  # of one sensor, of one robot, that wait for the next step in real time

_CLOCK_LAG = 0.1  # [s] that `/clock` may come later here than at a simulated scanner

_ACCEPT_TEXT = "Whether robots that sensors see may join by announcing themselves on `robots`."

_Arrivals = dict[str, deque[tuple[int, Any]]]  # by sensor or robot: time of arrival [ns] and message


@dataclass(frozen=True)
class FusionParameters:
    """Parameters of the node in both worlds.

    Parameters
    ----------
    sampling_interval : float
        From one unoccupied area to the next [s].
    odometry_frames : tuple of str
        Frames of the odometry of robots that sensors see, as far as they coincide with the map; `{robot}` stands for
        the id of the robot.
    """

    sampling_interval: float = 1.0
    odometry_frames: tuple[str, ...] = (MAP_FRAME,)


class _Fusion(Protocol):
    """The fusion of a world itself."""

    def reset(self) -> None: ...

    def add_robot(self, robot: RobotSpec) -> None: ...

    def remove_robot(self, robot_id: str) -> None: ...

    def latest_stamp(self, name: str, /) -> float | None: ...

    def area(self, time: float) -> Any: ...


class _World(Protocol):
    """What differs between the plane and space (`PlaneFusion`, `SpaceFusion`)."""

    measurement: str  # in messages: scan, image
    channel: str  # last part of the topics
    kind: Any  # type of the messages
    sensors: Mapping[str, Any]
    robots: list[RobotSpec]
    sees_robots: bool
    sensor_qos: QoSProfile
    fusion: _Fusion

    @property
    def max_age(self) -> float: ...

    def configure(self, robots: Iterable[RobotSpec]) -> None: ...

    def is_nothing(self, message: Any) -> bool: ...

    def take(self, name: str, message: Any, now: float) -> None: ...

    def take_state(self, name: str, message: Odometry, frames: list[str], now: float) -> None: ...

    def publish(self, area: Any, now: int) -> None: ...

    def sensor_values(self, name: str, area: Any) -> dict[str, object]: ...

    def area_values(self, area: Any) -> dict[str, object]: ...

    def is_empty(self, area: Any) -> bool: ...


class FusionNode(ManagedNode):
    """Hears what sensors saw, publishes `unoccupied_area`, what goes with it, and how the sensors are.

    In the plane these are `sensors/<id>/scan`, in space, for a scene there or a `workspace`, `sensors/<id>/points`.
    Where sensors see robots it hears their odometry too.
    """

    def __init__(self, options: NodeOptions | None = None) -> None:
        super().__init__("fusion_node", options or NodeOptions())
        scene = read_scene(self.reader)
        accepts: bool = self.reader.value("accept_robots", bool, _ACCEPT_TEXT, True)
        self.world = self._read_world(scene, accepts)
        self.sensors = self.world.sensors
        self._roster = Roster(self, scene, self.world.robots, accepts, self._join, self._leave)
        interval = {} if scene is None else {"sampling_interval": scene.sampling_interval}
        self.settings = self.reader.settings(FusionParameters, **interval)
        self.reader.finish()
        if not self.lockstep:
            self._jump = watch_time(self, self.reset)
        switches = {f"{name}/enable": partial(self._enable, name) for name in self.sensors}
        serve(self, self.options, self.reset, switches)
        self.autostart()

    def _read_world(self, scene: AnyScene | None, accepts: bool) -> _World:
        room = scene if isinstance(scene, SpaceScene) else None
        workspace = read_workspace(self.reader, room)
        lag = _CLOCK_LAG if self.get_parameter("use_sim_time").value and not self.lockstep else None
        if workspace is not None:
            if room is None and scene is not None:
                self.reader.fail(
                    "workspace", f"is given, but {scene.name} is a scene in the plane; leave it out"
                )
            return SpaceFusion(self, room, workspace, lag)
        assert not isinstance(scene, SpaceScene)
        return PlaneFusion(self, scene, accepts, lag)

    @property
    def robots(self) -> dict[str, RobotSpec]:
        """Robots that sensors may see, by id."""
        return self._roster.present

    def configure(self) -> None:
        """Make the fusion and the publishers."""
        self.world.configure(self.robots.values())
        self._endings: dict[str, Callable[[], object]] = {}
        self._enabled = dict.fromkeys(self.sensors, True)
        self._scans = self._inbox(self.sensors, _MOST_SCANS)
        self._odometry = self._inbox(self.robots, _MOST_STATES)
        self._problems: dict[str, str] = {}
        self._received = dict.fromkeys(self.sensors, 0)
        self._rejected = dict.fromkeys(self.sensors, 0)
        self._misses = 0
        self._diagnostics = self.publisher(
            DiagnosticArray, "/diagnostics", for_mode(self.lockstep, DIAGNOSTICS)
        )

    def start(self) -> None:
        """Listen; then work by ticks or by a timer."""
        for name in self.sensors:
            self.listen(
                self.world.kind, self._topic(name), partial(self._on_scan, name), self.world.sensor_qos
            )
        for name in self.robots:
            self._listen_to(name)
        if self.world.sees_robots:
            self._roster.start(self._step_when_complete)
        self._participant: Participant | None = None
        if self.lockstep:
            period = nanoseconds(self.settings.sampling_interval)
            self._participant = self.participate(period, self._on_tick, self.reset)
        else:
            self.every(self.settings.sampling_interval, self._on_timer)
        self._waiting = self.report_waiting(
            lambda: [
                *(self._topic(name) for name, enabled in self._enabled.items() if enabled),
                *(f"{name}/odom" for name in self.robots),
            ]
        )

    def _topic(self, name: str) -> str:
        return f"sensors/{name}/{self.world.channel}"

    def _listen_to(self, name: str) -> None:
        odometry = for_mode(self.lockstep, ODOMETRY_INPUT)
        self._endings[name] = self.listen(
            Odometry, f"{name}/odom", partial(self._on_odometry, name), odometry
        )

    def _join(self, spec: RobotSpec) -> None:
        self.world.fusion.add_robot(spec)
        self._odometry |= self._inbox([spec.id], _MOST_STATES)
        self._listen_to(spec.id)

    def _leave(self, name: str) -> None:
        self.world.fusion.remove_robot(name)
        self._endings.pop(name)()
        del self._odometry[name]
        self._problems.pop(f"{name}/odom", None)

    def _inbox(self, names: Iterable[str], most: int) -> _Arrivals:
        """What came since the last step; in lockstep nothing may be left out."""
        return {name: deque(maxlen=None if self.lockstep else most) for name in names}

    def reset(self) -> None:
        """Forget all scans and the memory."""
        self.world.fusion.reset()
        self._roster.reset()
        self._problems.clear()
        if not self.lockstep:  # in lockstep data of the new time may be here before their tick
            for waiting in (*self._scans.values(), *self._odometry.values()):
                waiting.clear()

    def _enable(self, name: str, enabled: bool) -> None:
        self._enabled[name] = enabled
        self._scans[name].clear()
        self.get_logger().info(f"sensor {name} is {'used again' if enabled else 'not used'}")
        self._step_when_complete()

    def _on_scan(self, name: str, message: Any) -> None:
        self._waiting.heard(self._topic(name))
        self._received[name] += not self._is_end(message)
        if not self._enabled[name]:
            return
        self._scans[name].append((self._arrival(), message))
        self._step_when_complete()

    def _on_odometry(self, name: str, message: Odometry) -> None:
        self._waiting.heard(f"{name}/odom")
        self._odometry[name].append((self._arrival(), message))
        self._step_when_complete()

    def _is_end(self, message: Any) -> bool:
        """Whether a message only says that nothing more comes of this tick; in real time nobody says so."""
        return self.lockstep and self.world.is_nothing(message)

    def _arrival(self) -> int:
        """Time on the clock, which what comes now may not be ahead of; in lockstep the tick of the step counts."""
        return 0 if self.lockstep else now_of(self)

    def _on_tick(self, _: int) -> None:
        self._step_when_complete()

    def _on_timer(self) -> None:
        if any(self._scans.values()) or any(
            self.world.fusion.latest_stamp(name) is not None for name in self.sensors
        ):
            self._step(now_of(self))

    def _step_when_complete(self) -> None:
        """In lockstep: go on once sensors in use, and robots that are seen, said all up to the present tick."""
        if self._participant is None or self._participant.due is None:
            return
        tick = self._participant.due
        if self.world.sees_robots:
            if not self._roster.is_complete(tick):
                return
            self._roster.settle(tick)
        needed = [self._scans[name] for name, enabled in self._enabled.items() if enabled]
        for waiting in (*needed, *self._odometry.values()):
            if not any(nanoseconds_from_stamp(message.header.stamp) == tick for _, message in waiting):
                return
        self._step(tick)
        self._participant.done()

    def _step(self, now: int) -> None:
        begin = clock.perf_counter()
        for name, waiting in self._odometry.items():
            self._take_all(f"{name}/odom", waiting, now, partial(self._take_state, name))
        for name in sorted(self._scans):
            self._take_all(name, self._scans[name], now, partial(self._take_scan, name))
        area = self.world.fusion.area(seconds(now))
        duration = clock.perf_counter() - begin
        self._publish(area, duration, now)

    def _take_all(
        self, name: str, waiting: deque[tuple[int, Any]], now: int, take: Callable[[Any, float], None]
    ) -> None:
        """Give what came to the fusion in the order of arrival; what cannot be used is counted and named."""
        problem = ""
        for arrival, message in waiting:
            try:
                take(message, seconds(now if self.lockstep else arrival))
            except InvalidInput as error:
                problem = str(error)
                if name in self._rejected:
                    self._rejected[name] += 1
                if name not in self._problems:
                    self.get_logger().warning(f"message of {name} not used: {error}")
        if problem:
            self._problems[name] = problem
        elif waiting:
            self._problems.pop(name, None)
        waiting.clear()

    def _take_scan(self, name: str, message: Any, now: float) -> None:
        if not self._is_end(message):
            self.world.take(name, message, now)

    def _take_state(self, name: str, message: Odometry, now: float) -> None:
        frames = [frame.replace("{robot}", name) for frame in self.settings.odometry_frames]
        self.world.take_state(name, message, frames, now)

    def _publish(self, area: Any, duration: float, now: int) -> None:
        self.world.publish(area, now)
        self._misses += duration > self.settings.sampling_interval
        self._diagnostics.publish(diagnostics(now, self._statuses(area, duration)))

    def _statuses(self, area: Any, duration: float) -> list[Any]:
        statuses = []
        for name in self.sensors:
            stamp = self.world.fusion.latest_stamp(name)
            age = None if stamp is None else area.stamp - stamp
            silent = age is None or age > self.world.max_age
            problem = self._problems.get(name) or (
                f"no {self.world.measurement} young enough" if silent else ""
            )
            values = {
                "age": "none" if age is None else f"{age:.3f}",
                "rate": f"{self._received[name] / self.settings.sampling_interval:.2f}",
                "rejected": self._rejected[name],
                **self.world.sensor_values(name, area),
                "enabled": self._enabled[name],
            }
            statuses.append(status(f"sensor {name}", name, problem if self._enabled[name] else "", values))
            self._received[name] = 0
        for name in self.robots:
            problem = self._problems.get(f"{name}/odom", "")
            statuses.append(status(f"robot {name} as seen", name, problem, {}))
        values = {
            "step_ms": f"{1e3 * duration:.4f}",
            "deadline_misses": self._misses,
            **self.world.area_values(area),
        }
        nothing = "nothing is free" if self.world.is_empty(area) else ""
        return [*statuses, status("fusion", self.get_name(), nothing, values)]
