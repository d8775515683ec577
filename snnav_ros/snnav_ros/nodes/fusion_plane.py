"""What the fusion node does in the plane: scans -> unoccupied area and what goes with it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import MISSING, dataclass, fields
from typing import Any

from nav_msgs.msg import OccupancyGrid, Odometry
from sensor_msgs.msg import LaserScan, PointCloud2
from visualization_msgs.msg import MarkerArray

from snnav_core.area.fusion import AreaFusion, FusionSettings
from snnav_core.area.planar import UnoccupiedArea
from snnav_core.types import RobotSpec
from snnav_ros.convert import (
    area_to_grid,
    area_to_message,
    check_frame,
    grid_points,
    is_nothing,
    lost_to_message,
    returns_to_message,
    scan_from_message,
    seen_to_message,
    state_from_message,
)
from snnav_ros.nodes.base import ManagedNode
from snnav_ros.nodes.sensors import read_seen_robots, read_sensors
from snnav_ros.qos import LATCHED, SENSOR, for_mode
from snnav_sim.configure import fusion_settings
from snnav_sim.scene_types import Scene

__all__ = ["PlaneFusion", "PlaneParameters"]


@dataclass(frozen=True)
class PlaneParameters:
    """Parameters of the node in the plane besides those of the fusion and of the sensors.

    Parameters
    ----------
    grid_resolution : float
        Side of a cell of `unoccupied_area/grid` [m].
    seen_resolution : float
        Distance between the points of `unoccupied_area/seen` [m].
    """

    grid_resolution: float = 0.2
    seen_resolution: float = 0.5


class PlaneFusion:
    """Fuses `sensors/<id>/scan` in the plane.

    Parameters
    ----------
    node : ManagedNode
        Its parameters are declared.
    scene : Scene or None
    accepts : bool
        Whether robots may join.
    clock_lag : float or None
        Tolerance of the clock unless the parameter says another [s].
    """

    measurement, channel, kind = "scan", "scan", LaserScan

    def __init__(
        self, node: ManagedNode, scene: Scene | None, accepts: bool, clock_lag: float | None
    ) -> None:
        self._node, reader = node, node.reader
        self.sensors = {one.sensor.id: one for one in read_sensors(reader, scene)}
        seeing = [name for name, one in self.sensors.items() if one.sensor.settings.sees_robots]
        self.sees_robots = bool(seeing)
        self.robots = read_seen_robots(reader, scene, seeing, may_be_none=accepts)
        self.parameters = reader.settings(PlaneParameters)
        base: dict[str, Any] = {"boundary_speed": MISSING}  # how fast things move, a person has to say
        if scene is not None:
            held = fusion_settings(scene)
            base = {field.name: getattr(held, field.name) for field in fields(held)}
        if clock_lag is not None:
            base["clock_tolerance"] = clock_lag
        self.settings = reader.settings(FusionSettings, **base)
        self.sensor_qos = for_mode(node.lockstep, SENSOR)

    @property
    def max_age(self) -> float:
        """A sensor is silent when its last scan is older [s]."""
        return self.settings.max_scan_age

    def configure(self, robots: Iterable[RobotSpec]) -> None:
        """Make the fusion and the publishers."""
        sensors = [one.sensor for one in self.sensors.values()]
        self.fusion = AreaFusion(sensors, self.settings, list(robots))
        latched, publisher = for_mode(self._node.lockstep, LATCHED), self._node.publisher
        self._lost = publisher(MarkerArray, "unoccupied_area/lost", latched)
        self._areas = publisher(PointCloud2, "unoccupied_area", latched)
        self._returns = publisher(PointCloud2, "unoccupied_area/returns", latched)
        self._seen = publisher(PointCloud2, "unoccupied_area/seen", latched)
        self._grids = publisher(OccupancyGrid, "unoccupied_area/grid", latched)

    def is_nothing(self, message: LaserScan) -> bool:
        """Whether a message says that nothing more comes of a tick."""
        return is_nothing(message)

    def take(self, name: str, message: LaserScan, now: float) -> None:
        """Take a scan that came at a time [s]; InvalidInput says why it cannot be used."""
        check_frame(message, f"sensors/{name}/scan", (self.sensors[name].frame,))
        self.fusion.add_scan(name, scan_from_message(message), now)

    def take_state(self, name: str, message: Odometry, frames: list[str], now: float) -> None:
        """Take where a robot is; InvalidInput says why it cannot be used."""
        self.fusion.add_state(state_from_message(message, name, f"{name}/odom", frames), now)

    def publish(self, area: UnoccupiedArea, now: int) -> None:
        """Publish an area of a time [ns], and what goes with it to who listens."""
        self._lost.publish(lost_to_message(area))
        self._areas.publish(area_to_message(area))
        lockstep = self._node.lockstep  # a listener may be found later
        if lockstep or self._returns.get_subscription_count() > 0:
            self._returns.publish(returns_to_message(self.fusion.returns(area.stamp), now))
        if lockstep or self._grids.get_subscription_count() > 0:
            self._grids.publish(area_to_grid(area, self.parameters.grid_resolution))
        if self._seen.get_subscription_count() > 0:
            points = grid_points(area, self.parameters.seen_resolution)
            sensor, stamps = self.fusion.last_seen(points, area.stamp)
            self._seen.publish(seen_to_message(points, sensor, area.stamp - stamps, now))

    def sensor_values(self, name: str, area: UnoccupiedArea) -> dict[str, object]:
        """What the status of a sensor tells besides what all do."""
        return {"contradictions": area.contradictions.get(name, 0)}

    def area_values(self, area: UnoccupiedArea) -> dict[str, object]:
        """What the status of the fusion tells of an area."""
        return {"coverage": f"{area.region.area:.3f}", "vertices": sum(len(ring) for ring in area.rings)}

    def is_empty(self, area: UnoccupiedArea) -> bool:
        """Whether nothing is free."""
        return area.is_empty
