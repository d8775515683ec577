"""From a scene in space to the settings of the core, in one place for the run without ROS and for the nodes."""

from __future__ import annotations

from snnav_core.area.camera_network import CameraNetwork
from snnav_core.area.spatial_fusion import SpatialFusionSettings
from snnav_core.navigator.flight_settings import FlightSettings
from snnav_sim.devices.tof import TOF_ACCURACY
from snnav_sim.space_types import SpaceScene
from snnav_sim.space_world import SpaceWorld

__all__ = ["flight_settings", "make_network", "noisy_cameras", "spatial_fusion_settings"]

_LEAST_REACH = 2.0  # [m]
_SPARE = 4.0  # half diagonals of a cell beyond what the navigator asks for


def spatial_fusion_settings(scene: SpaceScene) -> SpatialFusionSettings:
    """Return the settings of the fusion: the cells, what is known never to move, how wrong ranges are."""
    window = scene.time_window * scene.sampling_interval
    asked = scene.safety_margin + scene.boundary_speed * window + _SPARE * scene.grid.half_diagonal
    return SpatialFusionSettings(
        scene.grid,
        walls=SpaceWorld(scene).known_cells(),
        walled_in=scene.known_border,
        boundary_speed=scene.boundary_speed,
        range_accuracy=TOF_ACCURACY if noisy_cameras(scene) else 0.0,
        reach=max(_LEAST_REACH, asked),
    )


def noisy_cameras(scene: SpaceScene) -> tuple[str, ...]:
    """Return the ids of the cameras that never show exactly the same twice."""
    return tuple(sensor.id for sensor in scene.sensors if sensor.noise == "tof")


def make_network(scene: SpaceScene) -> CameraNetwork:
    """Return the fusion of all cameras of a scene, which see all of its robots."""
    cameras = [sensor.camera for sensor in scene.sensors]
    robots = [robot.spec for robot in scene.robots]
    return CameraNetwork(cameras, spatial_fusion_settings(scene), robots, noisy_cameras(scene))


def flight_settings(scene: SpaceScene, seed: int) -> FlightSettings:
    """Return the settings of the navigator."""
    return FlightSettings(
        sampling_interval=scene.sampling_interval,
        safety_margin=scene.safety_margin,
        time_window=scene.time_window,
        boundary_speed=scene.boundary_speed,
        seed=seed,
    )
