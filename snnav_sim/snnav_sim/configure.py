"""From a scene to the settings of the core, in one place for the run without ROS and for the nodes."""

from __future__ import annotations

from snnav_core.area.fusion import FusionSettings, PlanarSensor
from snnav_core.area.tracks import TrackerSettings
from snnav_core.navigator.global_settings import GlobalSettings
from snnav_core.navigator.settings import NavigatorSettings
from snnav_core.planning.spacetime_problem import SpacetimeSettings
from snnav_core.sensing.scan import LMS200_ERROR_CODES, ScanSettings
from snnav_sim.scene_types import Scene, SensorScene
from snnav_sim.space_types import SpaceScene

__all__ = [
    "fusion_settings",
    "global_settings",
    "longest_silence",
    "navigator_settings",
    "planar_sensor",
    "scan_settings",
    "tracker_settings",
]

_NOISE_ALLOWANCE = 0.02


def scan_settings(sensor: SensorScene) -> ScanSettings:
    """Return how the ranges of a sensor are to be read.

    Notes
    -----
    With the noise of the LMS-200 every range is shortened by 0.02 m: four standard deviations of flicker and
    white noise together (4 * 3.52 mm) and half a step of the 10 mm resolution make 19.1 mm. And such a device never
    repeats itself: two equal scans come from one that froze.
    """
    return ScanSettings(
        inf_is_free=sensor.no_return == "free",
        error_codes=LMS200_ERROR_CODES if sensor.error_codes else (),
        range_accuracy=_NOISE_ALLOWANCE if sensor.noise == "lms200" else 0.0,
        range_cut=sensor.range_cut,
        expected_beams=sensor.beams,
        never_repeats=sensor.noise == "lms200",
        sees_robots=sensor.sees_robots,
    )


def planar_sensor(sensor: SensorScene) -> PlanarSensor:
    """Return the sensor as the fusion knows it."""
    return PlanarSensor(sensor.id, sensor.pose, scan_settings(sensor))


def longest_silence(scene: Scene | SpaceScene) -> float:
    """Return the age from which on a scan or an image tells that its sensor is silent [s].

    Notes
    -----
    A sensor is silent once two of its scans in a row are missing. One that measures at the sampling instants has then
    none since before the last instant: 1.5 sampling intervals. One with a period of its own has a scan at any age up to
    the period when nothing is wrong, and up to two periods when one is missing.
    """
    periods = [sensor.scan_period for sensor in scene.sensors if sensor.scan_period is not None]
    return max([1.5 * scene.sampling_interval, *(2.0 * period for period in periods)])


def fusion_settings(scene: Scene) -> FusionSettings:
    """Return the settings of the fusion: the speed bound, and how long a scan is usable.

    Notes
    -----
    Noisy outlines may lose half of the noise allowance when they are thinned out before the union.
    """
    noisy = any(sensor.noise == "lms200" for sensor in scene.sensors)
    return FusionSettings(
        boundary_speed=scene.boundary_speed,
        max_scan_age=longest_silence(scene),
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


def global_settings(scene: Scene) -> GlobalSettings:
    """Return the settings of the global navigator."""
    return GlobalSettings(
        SpacetimeSettings(sampling_interval=scene.sampling_interval, safety_margin=scene.safety_margin),
        time_window=scene.time_window,
        body_speed=scene.boundary_speed,
    )


def tracker_settings(scene: Scene) -> TrackerSettings:
    """Return the settings of the tracker of bodies."""
    return TrackerSettings(top_speed=max(scene.boundary_speed, TrackerSettings().least_speed))
