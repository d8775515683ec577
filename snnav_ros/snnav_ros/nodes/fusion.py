"""The node that makes the unoccupied area of the scans of all sensors."""

from __future__ import annotations

import time as clock
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import MISSING, dataclass, fields
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import OccupancyGrid, Odometry
from sensor_msgs.msg import LaserScan, PointCloud2
from visualization_msgs.msg import MarkerArray

from snnav_core.area.fusion import AreaFusion, FusionSettings
from snnav_core.area.planar import UnoccupiedArea
from snnav_core.errors import InvalidInput
from snnav_core.types import RobotSpec
from snnav_ros.convert import (
    MAP_FRAME,
    area_to_grid,
    area_to_message,
    check_frame,
    grid_points,
    is_nothing,
    lost_to_message,
    nanoseconds,
    nanoseconds_from_stamp,
    returns_to_message,
    scan_from_message,
    seconds,
    seen_to_message,
    state_from_message,
)
from snnav_ros.lockstep import Participant
from snnav_ros.nodes.base import ManagedNode, NodeOptions, diagnostics, serve, status
from snnav_ros.nodes.node_time import now_of, watch_time
from snnav_ros.nodes.roster import Roster
from snnav_ros.nodes.sensors import read_seen_robots, read_sensors
from snnav_ros.qos import DIAGNOSTICS, LATCHED, ODOMETRY_INPUT, SENSOR, for_mode
from snnav_ros.scenes import read_scene
from snnav_sim.configure import fusion_settings

__all__ = ["FusionNode", "FusionParameters"]

_MOST_SCANS, _MOST_STATES = 10, 200  # of one sensor, of one robot, that wait for the next step in real time

_CLOCK_LAG = 0.1  # [s] that `/clock` may come later here than at a simulated scanner

_ACCEPT_TEXT = "Whether robots that sensors see may join by announcing themselves on `robots`."

_Arrivals = dict[str, deque[tuple[int, Any]]]  # by sensor or robot: time of arrival [ns] and message


@dataclass(frozen=True)
class FusionParameters:
    """Parameters of the node besides those of the fusion and of the sensors.

    Parameters
    ----------
    sampling_interval : float
        From one unoccupied area to the next [s].
    grid_resolution : float
        Side of a cell of `unoccupied_area/grid` [m].
    seen_resolution : float
        Distance between the points of `unoccupied_area/seen` [m].
    odometry_frames : tuple of str
        Frames of the odometry of robots that sensors see, as far as they coincide with the map; `{robot}` stands for
        the id of the robot.
    """

    sampling_interval: float = 1.0
    grid_resolution: float = 0.2
    seen_resolution: float = 0.5
    odometry_frames: tuple[str, ...] = (MAP_FRAME,)


class FusionNode(ManagedNode):
    """Hears `sensors/<id>/scan`, publishes `unoccupied_area`, what it lacks, its grid, and how the sensors are.

    Where sensors see robots it hears their odometry too.
    """

    def __init__(self, options: NodeOptions | None = None) -> None:
        super().__init__("fusion_node", options or NodeOptions())
        scene = read_scene(self.reader)
        self.sensors = {one.sensor.id: one for one in read_sensors(self.reader, scene)}
        accepts: bool = self.reader.value("accept_robots", bool, _ACCEPT_TEXT, True)
        robots = read_seen_robots(self.reader, scene, list(self.sensors.values()), may_be_none=accepts)
        self._sees = any(one.sensor.settings.sees_robots for one in self.sensors.values())
        self._roster = Roster(self, scene, robots, accepts, self._join, self._leave)
        interval = {} if scene is None else {"sampling_interval": scene.sampling_interval}
        self.settings = self.reader.settings(FusionParameters, **interval)
        base: dict[str, Any] = {"boundary_speed": MISSING}  # how fast things move, a person has to say
        if scene is not None:
            held = fusion_settings(scene)
            base = {field.name: getattr(held, field.name) for field in fields(held)}
        if self.get_parameter("use_sim_time").value and not self.lockstep:
            base["clock_tolerance"] = _CLOCK_LAG
        self.fusion_settings = self.reader.settings(FusionSettings, **base)
        self.reader.finish()
        if not self.lockstep:
            self._jump = watch_time(self, self.reset)
        switches = {f"{name}/enable": partial(self._enable, name) for name in self.sensors}
        serve(self, self.options, self.reset, switches)
        self.autostart()

    @property
    def robots(self) -> dict[str, RobotSpec]:
        """Robots that sensors may see, by id."""
        return self._roster.present

    def configure(self) -> None:
        """Make the fusion and the publishers."""
        self._fusion = AreaFusion(
            [one.sensor for one in self.sensors.values()], self.fusion_settings, list(self.robots.values())
        )
        self._endings: dict[str, Callable[[], object]] = {}
        self._enabled = dict.fromkeys(self.sensors, True)
        self._scans = self._inbox(self.sensors, _MOST_SCANS)
        self._odometry = self._inbox(self.robots, _MOST_STATES)
        self._problems: dict[str, str] = {}
        self._received = dict.fromkeys(self.sensors, 0)
        self._rejected = dict.fromkeys(self.sensors, 0)
        self._misses = 0
        latched = for_mode(self.lockstep, LATCHED)
        self._lost = self.publisher(MarkerArray, "unoccupied_area/lost", latched)
        self._areas = self.publisher(PointCloud2, "unoccupied_area", latched)
        self._returns = self.publisher(PointCloud2, "unoccupied_area/returns", latched)
        self._seen = self.publisher(PointCloud2, "unoccupied_area/seen", latched)
        self._grids = self.publisher(OccupancyGrid, "unoccupied_area/grid", latched)
        self._diagnostics = self.publisher(
            DiagnosticArray, "/diagnostics", for_mode(self.lockstep, DIAGNOSTICS)
        )

    def start(self) -> None:
        """Listen; then work by ticks or by a timer."""
        for name in self.sensors:
            self.listen(
                LaserScan, _topic(name), partial(self._on_scan, name), for_mode(self.lockstep, SENSOR)
            )
        for name in self.robots:
            self._listen_to(name)
        if self._sees:
            self._roster.start(self._step_when_complete)
        self._participant: Participant | None = None
        if self.lockstep:
            period = nanoseconds(self.settings.sampling_interval)
            self._participant = self.participate(period, self._on_tick, self.reset)
        else:
            self.every(self.settings.sampling_interval, self._on_timer)
        self._waiting = self.report_waiting(
            lambda: [
                *(_topic(name) for name, enabled in self._enabled.items() if enabled),
                *(f"{name}/odom" for name in self.robots),
            ]
        )

    def _listen_to(self, name: str) -> None:
        odometry = for_mode(self.lockstep, ODOMETRY_INPUT)
        self._endings[name] = self.listen(
            Odometry, f"{name}/odom", partial(self._on_odometry, name), odometry
        )

    def _join(self, spec: RobotSpec) -> None:
        self._fusion.add_robot(spec)
        self._odometry |= self._inbox([spec.id], _MOST_STATES)
        self._listen_to(spec.id)

    def _leave(self, name: str) -> None:
        self._fusion.remove_robot(name)
        self._endings.pop(name)()
        del self._odometry[name]
        self._problems.pop(f"{name}/odom", None)

    def _inbox(self, names: Iterable[str], most: int) -> _Arrivals:
        """What came since the last step; in lockstep nothing may be left out."""
        return {name: deque(maxlen=None if self.lockstep else most) for name in names}

    def reset(self) -> None:
        """Forget all scans and the memory."""
        self._fusion.reset()
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

    def _on_scan(self, name: str, message: LaserScan) -> None:
        self._waiting.heard(_topic(name))
        self._received[name] += not self._is_end(message)
        if not self._enabled[name]:
            return
        self._scans[name].append((self._arrival(), message))
        self._step_when_complete()

    def _on_odometry(self, name: str, message: Odometry) -> None:
        self._waiting.heard(f"{name}/odom")
        self._odometry[name].append((self._arrival(), message))
        self._step_when_complete()

    def _is_end(self, message: LaserScan) -> bool:
        """Whether a message only says that nothing more comes of this tick; in real time nobody says so."""
        return self.lockstep and is_nothing(message)

    def _arrival(self) -> int:
        """Time on the clock, which what comes now may not be ahead of; in lockstep the tick of the step counts."""
        return 0 if self.lockstep else now_of(self)

    def _on_tick(self, _: int) -> None:
        self._step_when_complete()

    def _on_timer(self) -> None:
        if any(self._scans.values()) or any(
            self._fusion.latest_stamp(name) is not None for name in self.sensors
        ):
            self._step(now_of(self))

    def _step_when_complete(self) -> None:
        """In lockstep: go on once sensors in use, and robots that are seen, said all up to the present tick."""
        if self._participant is None or self._participant.due is None:
            return
        tick = self._participant.due
        if self._sees:
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
        area = self._fusion.area(seconds(now))
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

    def _take_scan(self, name: str, message: LaserScan, now: float) -> None:
        if self._is_end(message):
            return
        check_frame(message, _topic(name), (self.sensors[name].frame,))
        self._fusion.add_scan(name, scan_from_message(message), now)

    def _take_state(self, name: str, message: Odometry, now: float) -> None:
        frames = [frame.replace("{robot}", name) for frame in self.settings.odometry_frames]
        self._fusion.add_state(state_from_message(message, name, f"{name}/odom", frames), now)

    def _publish(self, area: UnoccupiedArea, duration: float, now: int) -> None:
        self._lost.publish(lost_to_message(area))
        self._areas.publish(area_to_message(area))
        # in lockstep a listener may be found later
        if self.lockstep or self._returns.get_subscription_count() > 0:
            self._returns.publish(returns_to_message(self._fusion.returns(area.stamp), now))
        if self.lockstep or self._grids.get_subscription_count() > 0:
            self._grids.publish(area_to_grid(area, self.settings.grid_resolution))
        if self._seen.get_subscription_count() > 0:
            points = grid_points(area, self.settings.seen_resolution)
            sensor, stamps = self._fusion.last_seen(points, area.stamp)
            self._seen.publish(seen_to_message(points, sensor, area.stamp - stamps, now))
        self._misses += duration > self.settings.sampling_interval
        self._diagnostics.publish(diagnostics(now, self._statuses(area, duration)))

    def _statuses(self, area: UnoccupiedArea, duration: float) -> list[Any]:
        statuses = []
        for name in self.sensors:
            stamp = self._fusion.latest_stamp(name)
            age = None if stamp is None else area.stamp - stamp
            silent = age is None or age > self.fusion_settings.max_scan_age
            problem = self._problems.get(name) or ("no scan young enough" if silent else "")
            values = {
                "age": "none" if age is None else f"{age:.3f}",
                "rate": f"{self._received[name] / self.settings.sampling_interval:.2f}",
                "rejected": self._rejected[name],
                "contradictions": area.contradictions.get(name, 0),
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
            "coverage": f"{area.region.area:.3f}",
            "vertices": sum(len(ring) for ring in area.rings),
        }
        return [
            *statuses,
            status("fusion", self.get_name(), "nothing is free" if area.is_empty else "", values),
        ]


def _topic(name: str) -> str:
    return f"sensors/{name}/scan"
