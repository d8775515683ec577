"""What the fusion node does in space: clouds of depth cameras -> unoccupied region, and its grid."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import MISSING, dataclass, fields
from typing import Any

import numpy as np
from nav_msgs.msg import OccupancyGrid, Odometry
from sensor_msgs.msg import PointCloud2

from snnav_core.area.camera_network import CameraNetwork
from snnav_core.area.grid import Grid
from snnav_core.area.spatial import SpatialArea
from snnav_core.area.spatial_fusion import SpatialFusionSettings
from snnav_core.errors import InvalidInput
from snnav_core.types import RobotSpec
from snnav_ros.convert import (
    check_frame,
    flyer_state_from_message,
    image_from_message,
    is_no_cloud,
    spatial_area_to_grid,
    spatial_area_to_message,
)
from snnav_ros.nodes.base import ManagedNode
from snnav_ros.nodes.cameras import read_cameras
from snnav_ros.nodes.sensors import read_seen_robots
from snnav_ros.parameters import ParameterReader
from snnav_ros.qos import CLOUDS, LATCHED, SENSOR, VOLUMES
from snnav_sim.configure import longest_silence
from snnav_sim.configure_flight import spatial_fusion_settings
from snnav_sim.space_types import SpaceScene

__all__ = ["SpaceFusion", "SpaceParameters", "read_workspace"]

_CORNERS = "two corners [x0, y0, z0, x1, y1, z1], the first below the second"
_WORKSPACE_TEXT = (
    "Room of depth cameras as [x0, y0, z0, x1, y1, z1] [m, map]: with it the node works in space, else in the "
    "plane. By default that of the scene."
)


@dataclass(frozen=True)
class SpaceParameters:
    """Parameters of the node in space besides those of the fusion and of the cameras.

    Parameters
    ----------
    grid_spacing : float
        Edge of the cubic cells in which the free region is known [m].
    max_scan_age : float
        A camera is silent when its last image is older [s]; what it saw shrinks at `boundary_speed`.
    """

    grid_spacing: float = 0.1
    max_scan_age: float = 1.0


def read_workspace(reader: ParameterReader, scene: SpaceScene | None) -> tuple[float, ...] | None:
    """Declare the parameter `workspace` and return it: six numbers, or None for the plane.

    Raises
    ------
    ParameterError
        If it is no box.
    """
    default = None if scene is None else _corners(scene)
    corners: tuple[float, ...] | None = reader.value(
        "workspace", tuple[float, ...] | None, _WORKSPACE_TEXT, default
    )
    if corners is None:
        return None
    is_box = len(corners) == 6 and bool(np.isfinite(corners).all())
    if not (is_box and all(low < high for low, high in zip(corners[:3], corners[3:], strict=True))):
        reader.fail("workspace", f"value {list(corners)} is no box; give {_CORNERS}")
    return corners


def _corners(scene: SpaceScene) -> tuple[float, ...]:
    return tuple(float(value) for value in (*scene.low, *scene.high))


class SpaceFusion:
    """Fuses `sensors/<id>/points` in space.

    Parameters
    ----------
    node : ManagedNode
        Its parameters are declared.
    scene : SpaceScene or None
    workspace : tuple of float
        Lowest and highest corner of the room [m, map].
    clock_lag : float or None
        Tolerance of the clock unless the parameter says another [s].
    """

    measurement, channel, kind = "image", "points", PointCloud2
    sees_robots = True

    def __init__(
        self,
        node: ManagedNode,
        scene: SpaceScene | None,
        workspace: tuple[float, ...],
        clock_lag: float | None,
    ) -> None:
        self._node, reader = node, node.reader
        self.sensors = {one.camera.id: one for one in read_cameras(reader, scene)}
        self.robots = read_seen_robots(reader, scene, list(self.sensors), may_be_none=True)
        known = (
            {}
            if scene is None
            else {"grid_spacing": scene.grid_spacing, "max_scan_age": longest_silence(scene)}
        )
        self.parameters = reader.settings(SpaceParameters, **known)
        try:
            grid = Grid.covering(
                np.array(workspace[:3]), np.array(workspace[3:]), self.parameters.grid_spacing
            )
        except InvalidInput as error:
            reader.fail("workspace", str(error))
        base: dict[str, Any] = {"boundary_speed": MISSING}  # how fast things move, a person has to say
        walls = None
        if scene is not None:
            held = spatial_fusion_settings(scene)
            base = {field.name: getattr(held, field.name) for field in fields(held)}
            if (
                grid.shape != held.grid.shape
                or grid.spacing != held.grid.spacing
                or workspace != _corners(scene)
            ):
                reader.fail(
                    "workspace",
                    "and grid_spacing are those of the scene; leave out these or `scene`",
                )
            walls = held.walls
        if clock_lag is not None:
            base["clock_tolerance"] = clock_lag
        fixed = {"grid": grid, "walls": walls}
        self.settings = reader.settings(SpatialFusionSettings, "", fixed, **base)
        self.sensor_qos = CLOUDS if node.lockstep else SENSOR

    @property
    def max_age(self) -> float:
        """A camera is silent when its last image is older [s]."""
        return self.parameters.max_scan_age

    def configure(self, robots: Iterable[RobotSpec]) -> None:
        """Make the fusion and the publishers."""
        cameras = [one.camera for one in self.sensors.values()]
        noisy = [name for name, one in self.sensors.items() if one.never_repeats]
        self.fusion = CameraNetwork(cameras, self.settings, list(robots), noisy)
        latched = VOLUMES if self._node.lockstep else LATCHED
        self._areas = self._node.publisher(PointCloud2, "unoccupied_area", latched)
        self._grids = self._node.publisher(OccupancyGrid, "unoccupied_area/grid", latched)

    def is_nothing(self, message: PointCloud2) -> bool:
        """Whether a message says that nothing more comes of a tick."""
        return is_no_cloud(message)

    def take(self, name: str, message: PointCloud2, now: float) -> None:
        """Take an image that came at a time [s]; InvalidInput says why it cannot be used."""
        heard, topic = self.sensors[name], f"sensors/{name}/points"
        check_frame(message, topic, (heard.frame,))
        self.fusion.add_image(
            name, image_from_message(message, heard.camera, topic, optical=heard.optical), now
        )

    def take_state(self, name: str, message: Odometry, frames: list[str], now: float) -> None:
        """Take where a robot is; InvalidInput says why it cannot be used."""
        self.fusion.add_state(flyer_state_from_message(message, name, f"{name}/odom", frames), now)

    def publish(self, area: SpatialArea, now: int) -> None:
        """Publish an area, and its grid to who listens."""
        self._areas.publish(spatial_area_to_message(area))
        if self._node.lockstep or self._grids.get_subscription_count() > 0:
            self._grids.publish(spatial_area_to_grid(area))

    def sensor_values(self, name: str, area: SpatialArea) -> dict[str, object]:
        """What the status of a camera tells besides what all do."""
        return {"contradictions": self.fusion.contradictions[name]}

    def area_values(self, area: SpatialArea) -> dict[str, object]:
        """What the status of the fusion tells of an area."""
        free = int(np.count_nonzero(area.moving > 0.0))
        return {"coverage": f"{free * area.grid.spacing**3:.3f}", "free_cells": free}

    def is_empty(self, area: SpatialArea) -> bool:
        """Whether nothing is free."""
        return not bool((area.moving > 0.0).any())
