"""What the cameras of a scene in space see, and where robots can get: without flying anywhere (C4-21)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from snnav_core.area.spatial import SpatialArea
from snnav_core.area.spatial_fusion import SpatialFusion
from snnav_core.navigator.flight_settings import FlightDistances
from snnav_sim.configure_flight import flight_settings, spatial_fusion_settings
from snnav_sim.devices.tof import DepthDevice
from snnav_sim.space_types import FlyerScene, Point3, SpaceScene
from snnav_sim.space_world import SpaceWorld

__all__ = ["Coverage", "measure_coverage"]

_FEW_CELLS = 50
_RESERVE = 0.5  # of half a cell's diagonal: what the navigator keeps at least beyond the margin


@dataclass(frozen=True)
class Coverage:
    """What is seen and what can be reached at time 0, before robots are put into the room.

    Parameters
    ----------
    area : SpatialArea
        What all cameras prove free together.
    free, solid : ndarray of bool, shape (nx, ny, nz)
        Cells that truly are free, whole; cells whose centre truly is solid.
    seen_by : ndarray of int, shape (nx, ny, nz)
        How many cameras prove each cell free alone.
    cameras : dict
        Name -> share of the free cells that it proves free, and that no other one does.
    labels : ndarray of int, shape (nx, ny, nz)
        Components of R[A, d], by size from 1 on; 0 where a robot cannot stay for a window.
    volumes : tuple of float
        Of the components that are larger than a few cells [m^3].
    distance : float
        d, what is kept from all, and `growth` from what may move [m].
    growth : float
    robots : dict
        Name -> "reachable", or why not.
    """

    area: SpatialArea
    free: NDArray[np.bool_]
    solid: NDArray[np.bool_]
    seen_by: NDArray[np.int64]
    cameras: dict[str, tuple[float, float]]
    labels: NDArray[np.int32]
    volumes: tuple[float, ...]
    distance: float
    growth: float
    robots: dict[str, str]

    @property
    def seen_share(self) -> float:
        """Share of the truly free cells that is proved free."""
        return _share(self.area.moving > 0.0, self.free)

    def summary(self) -> dict[str, Any]:
        """Return the numbers, for JSON."""
        return {
            "seen_share": round(self.seen_share, 4),
            "seen_twice_share": round(_share(self.seen_by >= 2, self.free), 4),
            "cameras": {
                name: {"share": round(share, 4), "alone": round(alone, 4)}
                for name, (share, alone) in self.cameras.items()
            },
            "distance": round(self.distance, 4),
            "growth": round(self.growth, 4),
            "component_volumes": [round(volume, 2) for volume in self.volumes],
            "robots": self.robots,
        }


def measure_coverage(scene: SpaceScene) -> Coverage:
    """Look with all cameras once, without noise and faults, and see what they show."""
    ideal = replace(
        scene,
        sensors=tuple(
            replace(sensor, noise="none", drop_out=0.0, faults=(), scan_offset=0.0)
            for sensor in scene.sensors
        ),
    )
    world, settings, grid = SpaceWorld(ideal), spatial_fusion_settings(ideal), scene.grid
    images = {sensor.id: DepthDevice(sensor, world, 0).scan(0.0) for sensor in ideal.sensors}
    single = {}
    for sensor in ideal.sensors:
        fusion = SpatialFusion([sensor.camera], settings)
        fusion.add_image(sensor.id, images[sensor.id])
        single[sensor.id] = fusion.area(0.0).moving > 0.0
    fusion = SpatialFusion([sensor.camera for sensor in ideal.sensors], settings)
    for name, image in images.items():
        fusion.add_image(name, image)
    area = fusion.area(0.0)
    true = world.clearance(grid.centres().reshape(-1, 3), 0.0).reshape(grid.shape)
    free = np.asarray(true >= grid.half_diagonal)
    seen_by = np.sum(list(single.values()), axis=0) if single else np.zeros(grid.shape, dtype=np.int64)
    distance = (
        scene.safety_margin + flight_settings(scene, 0).tracking_tolerance + _RESERVE * grid.half_diagonal
    )
    growth = scene.boundary_speed * scene.time_window * scene.sampling_interval
    labels, volumes = _components(area, distance, growth)
    robots = {
        robot.id: _verdict(scene, robot, area, labels, growth) for robot in scene.robots if not robot.curve
    }
    cameras = {
        name: (_share(seen, free), _share(seen & (seen_by == 1), free)) for name, seen in single.items()
    }
    solid = np.asarray(true < 0.0)
    return Coverage(area, free, solid, seen_by, cameras, labels, volumes, distance, growth, robots)


def _share(cells: NDArray[np.bool_], among: NDArray[np.bool_]) -> float:
    return float(cells[among].mean()) if among.any() else 0.0


def _components(
    area: SpatialArea, distance: float, growth: float
) -> tuple[NDArray[np.int32], tuple[float, ...]]:
    """Label the components of R[A, d] by size, and return their volumes [m^3]."""
    labels, number = area.components(distance, growth)
    sizes = np.bincount(labels.ravel(), minlength=number + 1)[1:]
    order = np.argsort(-sizes, kind="stable")
    renamed = np.zeros(number + 1, dtype=np.int32)
    renamed[1 + order] = np.arange(1, number + 1)
    large = sizes[order][sizes[order] >= _FEW_CELLS]
    return renamed[labels], tuple((large * area.grid.spacing**3).tolist())


def _verdict(
    scene: SpaceScene, robot: FlyerScene, area: SpatialArea, labels: NDArray[np.int32], growth: float
) -> str:
    """Whether the target of a robot can be reached from its start, or why not."""
    for what, point, grown in (("start", robot.start, 0.0), ("target", robot.target, growth)):
        kept = float(area.clearance_at(np.array([point]), grown)[0])
        if kept <= 0.0:
            return f"the {what} is not seen, or not free"
        if kept < scene.safety_margin:
            return f"the {what} keeps {kept:.2f} m of the margin of {scene.safety_margin:g} m"
    reach = FlightDistances(robot.spec, flight_settings(scene, 0)).link + 2.0 * growth
    begin, end = (_labels_near(area, labels, point, reach) for point in (robot.start, robot.target))
    return "reachable" if begin & end else "start and target are in different components"


def _labels_near(area: SpatialArea, labels: NDArray[np.int32], point: Point3, reach: float) -> set[int]:
    """Components within a distance [m] of a point; one cell's diagonal at least."""
    grid = area.grid
    reach = max(reach, 2.0 * grid.half_diagonal)
    cell = (np.array(point) - grid.origin) / grid.spacing
    steps = reach / grid.spacing
    low = np.maximum(np.floor(cell - steps), 0).astype(int)
    high = np.minimum(np.ceil(cell + steps) + 1, grid.shape).astype(int)
    block = labels[low[0] : high[0], low[1] : high[1], low[2] : high[2]]
    return set(np.unique(block[block > 0]).tolist())
