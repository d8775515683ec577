"""From the scans of all sensors to the unoccupied area at one sampling instant."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import shapely
from shapely.geometry import MultiPolygon
from shapely.geometry.base import BaseGeometry

from snnav_core.area.memory import remember
from snnav_core.area.planar import UnoccupiedArea, as_multipolygon, shrink
from snnav_core.errors import InvalidInput
from snnav_core.sensing.scan import DetectedArea, PlanarScan, ScanSettings, detect_planar
from snnav_core.types import FloatArray, Pose2D

__all__ = ["AreaFusion", "FusionSettings", "PlanarSensor", "fuse"]

_TIME_TOLERANCE = 1e-6


@dataclass(frozen=True)
class PlanarSensor:
    """A fixed planar range finder: its name, its surveyed pose in the map, how to read its ranges."""

    id: str
    pose: Pose2D
    settings: ScanSettings = field(default_factory=ScanSettings)


@dataclass(frozen=True, slots=True)
class FusionSettings:
    """How scans become the unoccupied area.

    Parameters
    ----------
    boundary_speed : float
        V_max: nothing that moves in the workspace is faster [m/s].
    memory : bool
        Keep what was free and cannot yet have been reached (A_mem, deviation C3-5). Without effect when
        `boundary_speed` is zero: then every scan shows all there is.
    max_scan_age : float
        An older scan counts as no scan [s].
    return_tolerance : float
        A return this far [m] or less inside the union does not cut it; the planning reserve covers it.
    return_radius : float
        Half width of the obstacle that stands for one cut return [m].
    contradiction_depth : float
        A return farther inside the union than this [m] is counted as a contradiction.
    """

    boundary_speed: float = 0.0
    memory: bool = True
    max_scan_age: float = 1.0
    return_tolerance: float = 0.003
    return_radius: float = 0.01
    contradiction_depth: float = 0.1

    def __post_init__(self) -> None:
        for name in ("boundary_speed", "return_tolerance", "contradiction_depth"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise InvalidInput(f"fusion setting {name} is {value}, must be a number >= 0")
        for name in ("max_scan_age", "return_radius"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise InvalidInput(f"fusion setting {name} is {value}, must be a positive number")


def fuse(stamp: float, union: MultiPolygon, detected: Sequence[DetectedArea], settings: FusionSettings) -> UnoccupiedArea:
    """Cut every measured return out of the union of the detected areas (Ch. 3, total detected area).

    Parameters
    ----------
    stamp : float
        Time of the area [s].
    union : shapely.MultiPolygon
        Union of the detected areas, with memory if wanted [m, map].
    detected : sequence of DetectedArea
        Their returns are obstacles for all sensors.
    settings : FusionSettings

    Returns
    -------
    UnoccupiedArea
        With the contradictions counted per sensor.

    Notes
    -----
    Deviation: the thesis takes the plain union. On real scanners a return of one node can lie inside what another
    node's rays passed (pose error, thin objects, glass); the safe side wins.
    """
    area = UnoccupiedArea(stamp, union)
    sizes = [len(part.returns) for part in detected]
    returns = np.concatenate([part.returns for part in detected]) if sum(sizes) else np.empty((0, 2))
    if union.is_empty or len(returns) == 0:
        return UnoccupiedArea(stamp, union, {part.sensor_id: 0 for part in detected})
    depth, _ = area.clearance_field.query(returns)
    deep = np.split(depth > settings.contradiction_depth, np.cumsum(sizes)[:-1])
    counts = {part.sensor_id: int(flags.sum()) for part, flags in zip(detected, deep, strict=True)}
    inside = depth > settings.return_tolerance
    if not inside.any():
        return area.restamped(stamp, counts)
    return UnoccupiedArea(stamp, _cut(union, returns[inside], settings.return_radius), counts)


def _cut(union: MultiPolygon, returns: FloatArray, radius: float) -> MultiPolygon:
    obstacles = shapely.buffer(shapely.multipoints(returns), radius, quad_segs=1)
    return as_multipolygon(shapely.difference(union, obstacles))


class AreaFusion:
    """Keeps the latest scan of every sensor and builds the unoccupied area from them.

    Parameters
    ----------
    sensors : sequence of PlanarSensor
        The sensor network.
    settings : FusionSettings

    Raises
    ------
    InvalidInput
        If there is no sensor or two have the same name.
    """

    def __init__(self, sensors: Sequence[PlanarSensor], settings: FusionSettings | None = None) -> None:
        self.sensors = {sensor.id: sensor for sensor in sensors}
        if not sensors or len(self.sensors) != len(sensors):
            raise InvalidInput(f"sensors {[s.id for s in sensors]}: need at least one, and different ids")
        self.settings = settings or FusionSettings()
        self._scans: dict[str, PlanarScan] = {}
        self._detected: dict[str, DetectedArea] = {}
        self._union: tuple[list[BaseGeometry], MultiPolygon] | None = None
        self._area: UnoccupiedArea | None = None

    def reset(self) -> None:
        """Forget all scans and the memory, as after a jump of time."""
        self._scans.clear()
        self._detected.clear()
        self._union = None
        self._area = None

    def add_scan(self, sensor_id: str, scan: PlanarScan) -> DetectedArea:
        """Take a new scan of one sensor and return what it saw.

        Raises
        ------
        InvalidInput
            If the sensor is unknown, or the scan is older than the last one of this sensor.
        ScanError
            If the scan cannot be used.
        """
        sensor = self.sensors.get(sensor_id)
        if sensor is None:
            raise InvalidInput(f"scan of unknown sensor {sensor_id!r}; known: {sorted(self.sensors)}")
        last = self._scans.get(sensor_id)
        if last is not None and scan.stamp < last.stamp - _TIME_TOLERANCE:
            raise InvalidInput(
                f"scan of {sensor_id} stamped {scan.stamp:.3f} s is older than its last ({last.stamp:.3f} s): ignored"
            )
        if last is None or not _same_ranges(last, scan):
            self._detected[sensor_id] = detect_planar(sensor_id, scan, sensor.pose, sensor.settings)
        self._scans[sensor_id] = scan
        return self._detected[sensor_id]

    def latest_stamp(self, sensor_id: str) -> float | None:
        """Stamp of the latest scan of a sensor [s], or None."""
        scan = self._scans.get(sensor_id)
        return None if scan is None else scan.stamp

    def silent_sensors(self, time: float) -> list[str]:
        """Sensors without a scan young enough at `time` [s]."""
        return [sensor_id for sensor_id in self.sensors if not self._is_usable(sensor_id, time)]

    def area(self, time: float) -> UnoccupiedArea:
        """The unoccupied area at `time` [s] from the latest scans; empty when there is none.

        A part that was seen `a` seconds ago is reduced by a V_max first; what was free before and cannot have been
        reached since stays (memory).

        Raises
        ------
        InvalidInput
            If time runs backwards while memory is on; call `reset` after a jump.
        """
        usable = [sensor_id for sensor_id in sorted(self._detected) if self._is_usable(sensor_id, time)]
        parts = [self._detected[sensor_id] for sensor_id in usable]
        polygons = [self._aged(sensor_id, time) for sensor_id in usable]
        last_union, last_area = self._union, self._area
        unchanged = last_union is not None and _identical(polygons, last_union[0])
        if unchanged and last_union is not None:
            union = last_union[1]
        else:
            union = as_multipolygon(shapely.union_all(polygons))
            self._union = (polygons, union)
        if self.settings.memory and self.settings.boundary_speed > 0.0 and last_area is not None:
            elapsed = time - last_area.stamp
            union = as_multipolygon(remember(last_area.region, union, elapsed, self.settings.boundary_speed))
        elif unchanged and last_area is not None:
            self._area = last_area.restamped(time)
            return self._area
        self._area = fuse(time, union, parts, self.settings)
        return self._area

    def _aged(self, sensor_id: str, time: float) -> BaseGeometry:
        polygon = self._detected[sensor_id].polygon
        reach = (time - self._scans[sensor_id].stamp) * self.settings.boundary_speed
        return shrink(polygon, reach) if reach > _TIME_TOLERANCE else polygon

    def _is_usable(self, sensor_id: str, time: float) -> bool:
        if sensor_id not in self._scans:
            return False
        age = time - self._scans[sensor_id].stamp
        return -_TIME_TOLERANCE <= age <= self.settings.max_scan_age + _TIME_TOLERANCE


def _identical(first: Sequence[BaseGeometry], second: Sequence[BaseGeometry]) -> bool:
    return len(first) == len(second) and all(a is b for a, b in zip(first, second, strict=True))


def _same_ranges(first: PlanarScan, second: PlanarScan) -> bool:
    return (
        first.angle_min == second.angle_min
        and first.angle_increment == second.angle_increment
        and first.range_min == second.range_min
        and first.range_max == second.range_max
        and np.array_equal(first.ranges, second.ranges, equal_nan=True)
    )
