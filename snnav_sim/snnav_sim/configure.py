"""From a scene to the settings of the core, in one place for the run without ROS and for the nodes."""

from __future__ import annotations

from snnav_core.area.fusion import FusionSettings, PlanarSensor
from snnav_core.navigator.settings import NavigatorSettings
from snnav_core.sensing.scan import LMS200_ERROR_CODES, ScanSettings
from snnav_sim.scene_types import Scene, SensorScene

__all__ = ["fusion_settings", "navigator_settings", "planar_sensor", "scan_settings"]

_NOISE_ALLOWANCE = 0.02


def scan_settings(sensor: SensorScene) -> ScanSettings:
    """Return how the ranges of a sensor are to be read.

    Notes
    -----
    With the noise of the LMS-200 every range is shortened by 0.02 m: four standard deviations of flicker and
    white noise together (4 * 3.52 mm) and half a step of the 10 mm resolution make 19.1 mm.
    """
    return ScanSettings(
        inf_is_free=sensor.no_return == "free",
        error_codes=LMS200_ERROR_CODES if sensor.error_codes else (),
        range_accuracy=_NOISE_ALLOWANCE if sensor.noise == "lms200" else 0.0,
        range_cut=sensor.range_cut,
        expected_beams=sensor.beams,
    )


def planar_sensor(sensor: SensorScene) -> PlanarSensor:
    """Return the sensor as the fusion knows it."""
    return PlanarSensor(sensor.id, sensor.pose, scan_settings(sensor))


def fusion_settings(scene: Scene) -> FusionSettings:
    """Return the settings of the fusion: the speed bound, and scans usable until the next but one is missed.

    Noisy outlines may lose half of the noise allowance when they are thinned out before the union.
    """
    noisy = any(sensor.noise == "lms200" for sensor in scene.sensors)
    return FusionSettings(
        boundary_speed=scene.boundary_speed,
        max_scan_age=1.5 * scene.sampling_interval,
        simplification=0.5 * _NOISE_ALLOWANCE if noisy else FusionSettings().simplification,
    )


def navigator_settings(scene: Scene) -> NavigatorSettings:
    """Return the settings of the navigator."""
    return NavigatorSettings(
        sampling_interval=scene.sampling_interval,
        safety_margin=scene.safety_margin,
        time_window=scene.time_window,
        boundary_speed=scene.boundary_speed,
    )
