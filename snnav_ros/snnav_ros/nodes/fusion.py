"""The node that makes the unoccupied area of the scans of all sensors."""

from __future__ import annotations

import time as clock
from dataclasses import MISSING, dataclass, fields
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import OccupancyGrid
from sensor_msgs.msg import LaserScan, PointCloud2

from snnav_core.area.fusion import AreaFusion, FusionSettings
from snnav_core.area.planar import UnoccupiedArea
from snnav_core.errors import InvalidInput
from snnav_ros.convert import (
    area_to_grid,
    area_to_message,
    check_frame,
    nanoseconds,
    nanoseconds_from_stamp,
    scan_from_message,
    seconds,
)
from snnav_ros.lockstep import Participant
from snnav_ros.nodes.base import ManagedNode, NodeOptions, diagnostics, now_of, serve, status, watch_time
from snnav_ros.nodes.sensors import read_sensors
from snnav_ros.qos import DIAGNOSTICS, LATCHED, SENSOR, for_mode
from snnav_ros.scenes import read_scene
from snnav_sim.configure import fusion_settings

__all__ = ["FusionNode", "FusionParameters"]


@dataclass(frozen=True)
class FusionParameters:
    """Parameters of the node besides those of the fusion and of the sensors.

    Parameters
    ----------
    sampling_interval : float
        From one unoccupied area to the next [s].
    grid_resolution : float
        Side of a cell of `unoccupied_area/grid` [m].
    """

    sampling_interval: float = 1.0
    grid_resolution: float = 0.2


class FusionNode(ManagedNode):
    """Hears `sensors/<id>/scan`, publishes `unoccupied_area`, its grid, and how the sensors are."""

    def __init__(self, options: NodeOptions | None = None) -> None:
        super().__init__("fusion_node", options or NodeOptions())
        scene = read_scene(self.reader)
        self.sensors = {one.sensor.id: one for one in read_sensors(self.reader, scene)}
        interval = {} if scene is None else {"sampling_interval": scene.sampling_interval}
        self.settings = self.reader.settings(FusionParameters, **interval)
        base: dict[str, Any] = {"boundary_speed": MISSING}  # how fast things move, a person has to say
        if scene is not None:
            held = fusion_settings(scene)
            base = {field.name: getattr(held, field.name) for field in fields(held)}
        self.fusion_settings = self.reader.settings(FusionSettings, **base)
        self.reader.finish()
        if not self.lockstep:
            self._jump = watch_time(self, self.reset)
        switches = {f"{name}/enable": partial(self._enable, name) for name in self.sensors}
        serve(self, self.options, self.reset, switches)
        self.autostart()

    def configure(self) -> None:
        """Make the fusion and the publishers."""
        self._fusion = AreaFusion([one.sensor for one in self.sensors.values()], self.fusion_settings)
        self._enabled = dict.fromkeys(self.sensors, True)
        self._latest: dict[str, LaserScan] = {}
        self._problems: dict[str, str] = {}
        self._received = dict.fromkeys(self.sensors, 0)
        self._rejected = dict.fromkeys(self.sensors, 0)
        self._misses = 0
        latched = for_mode(self.lockstep, LATCHED)
        self._areas = self.publisher(PointCloud2, "unoccupied_area", latched)
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
        self._participant: Participant | None = None
        if self.lockstep:
            period = nanoseconds(self.settings.sampling_interval)
            self._participant = self.participate(period, self._on_tick, self.reset)
        else:
            self.every(self.settings.sampling_interval, self._on_timer)
        self._waiting = self.report_waiting(
            lambda: [_topic(name) for name, enabled in self._enabled.items() if enabled]
        )

    def reset(self) -> None:
        """Forget all scans and the memory."""
        self._fusion.reset()
        self._problems.clear()
        if not self.lockstep:  # in lockstep a scan of the new time may be here before its tick
            self._latest.clear()

    def _enable(self, name: str, enabled: bool) -> None:
        self._enabled[name] = enabled
        self.get_logger().info(f"sensor {name} is {'used again' if enabled else 'not used'}")
        self._step_when_complete()

    def _on_scan(self, name: str, message: LaserScan) -> None:
        self._waiting.heard(_topic(name))
        self._received[name] += 1
        if not self._enabled[name]:
            return
        self._latest[name] = message
        self._step_when_complete()

    def _on_tick(self, _: int) -> None:
        self._step_when_complete()

    def _on_timer(self) -> None:
        if self._latest or any(self._fusion.latest_stamp(name) is not None for name in self.sensors):
            self._step(now_of(self))

    def _step_when_complete(self) -> None:
        """In lockstep: go on once the scan of the present tick is there from every sensor in use."""
        if self._participant is None or self._participant.due is None:
            return
        tick = self._participant.due
        stamps = {name: nanoseconds_from_stamp(scan.header.stamp) for name, scan in self._latest.items()}
        if all(stamps.get(name) == tick for name, enabled in self._enabled.items() if enabled):
            self._step(tick)
            self._participant.done()

    def _step(self, now: int) -> None:
        begin = clock.perf_counter()
        for name in sorted(self._latest):
            self._take(name, self._latest[name])
        self._latest.clear()
        area = self._fusion.area(seconds(now))
        duration = clock.perf_counter() - begin
        self._areas.publish(area_to_message(area))
        if (
            self.lockstep or self._grids.get_subscription_count() > 0
        ):  # in lockstep a listener may be found later
            self._grids.publish(area_to_grid(area, self.settings.grid_resolution))
        self._misses += duration > self.settings.sampling_interval
        self._diagnostics.publish(diagnostics(now, self._statuses(area, duration)))

    def _take(self, name: str, message: LaserScan) -> None:
        """Give one scan to the fusion; one that cannot be used is counted and named."""
        try:
            check_frame(message, _topic(name), (self.sensors[name].frame,))
            self._fusion.add_scan(name, scan_from_message(message))
            self._problems.pop(name, None)
        except InvalidInput as error:
            self._rejected[name] += 1
            if self._problems.get(name) is None:
                self.get_logger().warning(f"scan of {name} not used: {error}")
            self._problems[name] = str(error)

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
