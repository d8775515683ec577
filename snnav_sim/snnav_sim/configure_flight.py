"""From a scene in space to the settings of the core, in one place for the run without ROS and for the nodes."""

from __future__ import annotations

from snnav_core.area.spatial_fusion import SpatialFusion, SpatialFusionSettings
from snnav_core.navigator.flight_settings import FlightSettings
from snnav_sim.devices.tof import TOF_ACCURACY
from snnav_sim.space_types import SpaceScene
from snnav_sim.space_world import SpaceWorld

__all__ = ["flight_settings", "make_fusion", "spatial_fusion_settings"]

_LEAST_REACH = 2.0  # [m]
_SPARE = 4.0  # half diagonals of a cell beyond what the navigator asks for


def spatial_fusion_settings(scene: SpaceScene) -> SpatialFusionSettings:
    """Return the settings of the fusion: the cells, what is known never to move, how wrong ranges are."""
    noisy = any(sensor.noise == "tof" for sensor in scene.sensors)
    window = scene.time_window * scene.sampling_interval
    asked = scene.safety_margin + scene.boundary_speed * window + _SPARE * scene.grid.half_diagonal
    return SpatialFusionSettings(
        scene.grid,
        walls=SpaceWorld(scene).known_cells(),
        walled_in=scene.known_border,
        boundary_speed=scene.boundary_speed,
        range_accuracy=TOF_ACCURACY if noisy else 0.0,
        reach=max(_LEAST_REACH, asked),
    )


def make_fusion(scene: SpaceScene) -> SpatialFusion:
    """Return the fusion of all cameras of a scene."""
    return SpatialFusion([sensor.camera for sensor in scene.sensors], spatial_fusion_settings(scene))


def flight_settings(scene: SpaceScene, seed: int) -> FlightSettings:
    """Return the settings of the navigator."""
    return FlightSettings(
        sampling_interval=scene.sampling_interval,
        safety_margin=scene.safety_margin,
        time_window=scene.time_window,
        boundary_speed=scene.boundary_speed,
        seed=seed,
    )
