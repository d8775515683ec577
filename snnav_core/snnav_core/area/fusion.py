"""From the scans of all sensors to the unoccupied area at one sampling instant."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import shapely
from shapely.geometry import MultiPolygon
from shapely.geometry.base import BaseGeometry

from snnav_core.area.memory import remember
from snnav_core.area.planar import UnoccupiedArea, as_multipolygon, shrink
from snnav_core.errors import InvalidInput
from snnav_core.sensing.scan import DetectedArea, PlanarScan, ScanSettings, detect_planar
from snnav_core.sensing.star import shorten_fan
from snnav_core.types import FloatArray, Pose2D

__all__ = ["AreaFusion", "FusionSettings", "PlanarSensor", "agree", "cut_returns"]

_TIME_TOLERANCE = 1e-6
_NO_AREA = 1e-6  # [m^2]


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
    shorten_depth : float
        Where a return lies up to this far inside the area of another sensor, along its ray, that sensor's beams end at
        the return [m]; a deeper return becomes a small obstacle of its own.
    simplification : float
        The outline of each sensor's area may lose points, and the area this much, before the union [m].
    least_part : float
        Parts of the area smaller than this are dropped: no robot fits into them [m^2].
    contradiction_depth : float
        A return farther inside the union than this [m] is counted as a contradiction.
    """

    boundary_speed: float = 0.0
    memory: bool = True
    max_scan_age: float = 1.0
    return_tolerance: float = 0.001
    return_radius: float = 0.01
    shorten_depth: float = 0.1
    simplification: float = 0.003
    least_part: float = 0.05
    contradiction_depth: float = 0.1

    def __post_init__(self) -> None:
        at_least_zero = (
            "boundary_speed",
            "return_tolerance",
            "shorten_depth",
            "simplification",
            "least_part",
        )
        for name in (*at_least_zero, "contradiction_depth"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise InvalidInput(f"fusion setting {name} is {value}, must be a number >= 0")
        for name in ("max_scan_age", "return_radius"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise InvalidInput(f"fusion setting {name} is {value}, must be a positive number")


def agree(
    detected: Sequence[DetectedArea], settings: FusionSettings
) -> tuple[list[DetectedArea], dict[str, int]]:
    """Reconcile what the sensors saw: a return of any of them is an obstacle for all.

    Measured from two places one wall never is in one place, and the union of both areas would hide the nearer
    measurement: where a return lies a little inside the area of another sensor, that area ends there.

    Parameters
    ----------
    detected : sequence of DetectedArea
    settings : FusionSettings

    Returns
    -------
    agreed : list of DetectedArea
        Never larger than before.
    contradictions : dict of str to int
        Per sensor: its returns through which rays of another sensor passed by more than `contradiction_depth`.
    """
    if not detected:
        return [], {}
    returns = _all_returns(detected)
    deepest = np.zeros(len(returns))
    agreed = []
    for part in detected:
        fan, inside = shorten_fan(part.fan, part.pose, returns, settings.shorten_depth)
        deepest = np.maximum(deepest, inside)
        agreed.append(replace(part, fan=fan, simplification=settings.simplification))
    flags = np.split(
        deepest > settings.contradiction_depth, np.cumsum([len(p.returns) for p in detected])[:-1]
    )
    return agreed, {part.sensor_id: int(flag.sum()) for part, flag in zip(detected, flags, strict=True)}


def cut_returns(
    union: MultiPolygon, detected: Sequence[DetectedArea], settings: FusionSettings
) -> MultiPolygon:
    """Cut the returns that still lie inside a union of detected areas out of it (Ch. 3, total detected area).

    Parameters
    ----------
    union : shapely.MultiPolygon
        Union of the detected areas, with memory if wanted [m, map].
    detected : sequence of DetectedArea
        Their returns are obstacles for all sensors.
    settings : FusionSettings

    Returns
    -------
    shapely.MultiPolygon
        The union itself when nothing lies inside.

    Notes
    -----
    Deviation: the thesis takes the plain union. On real scanners a return of one node can lie inside what another
    node's rays passed (pose error, thin objects, glass); the safe side wins.
    """
    returns = _all_returns(detected)
    if union.is_empty or len(returns) == 0:
        return union
    depth, _ = UnoccupiedArea(0.0, union).clearance_field.query(returns)
    inside = depth > settings.return_tolerance
    if not inside.any():
        return union
    obstacles = shapely.buffer(shapely.multipoints(returns[inside]), settings.return_radius, quad_segs=1)
    return _without_crumbs(as_multipolygon(shapely.difference(union, obstacles)), settings.least_part)


def _all_returns(detected: Sequence[DetectedArea]) -> FloatArray:
    return np.concatenate([part.returns for part in detected]) if detected else np.empty((0, 2))


def _without_crumbs(region: MultiPolygon, least: float) -> MultiPolygon:
    parts = shapely.get_parts(region)
    return MultiPolygon(list(parts[shapely.area(parts) >= least]))


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
        self._agreed: tuple[list[DetectedArea], list[DetectedArea], dict[str, int]] = ([], [], {})
        self._union: tuple[list[BaseGeometry], MultiPolygon] = ([], MultiPolygon())
        self._area: UnoccupiedArea | None = None
        self._nothing_remembered = True

    def reset(self) -> None:
        """Forget all scans and the memory, as after a jump of time."""
        self._scans.clear()
        self._detected.clear()
        self._area = None
        self._nothing_remembered = True

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
        if not _identical(parts, self._agreed[0]):
            self._agreed = (parts, *agree(parts, self.settings))
        polygons = [self._aged(part, time) for part in self._agreed[1]]
        last = self._area
        unchanged = _identical(polygons, self._union[0])
        if not unchanged:
            self._union = (polygons, as_multipolygon(shapely.union_all(polygons)))
        union, speed = self._union[1], self.settings.boundary_speed
        if last is not None and unchanged and self._nothing_remembered:
            self._area = last.restamped(time)
            return self._area
        if self.settings.memory and speed > 0.0 and last is not None:
            remembered = as_multipolygon(remember(last.region, union, time - last.stamp, speed))
            self._nothing_remembered = remembered.area - union.area < _NO_AREA
            union = union if self._nothing_remembered else remembered
        self._area = UnoccupiedArea(time, cut_returns(union, parts, self.settings), self._agreed[2])
        return self._area

    def _aged(self, part: DetectedArea, time: float) -> BaseGeometry:
        reach = (time - self._scans[part.sensor_id].stamp) * self.settings.boundary_speed
        return shrink(part.polygon, reach) if reach > _TIME_TOLERANCE else part.polygon

    def _is_usable(self, sensor_id: str, time: float) -> bool:
        if sensor_id not in self._scans:
            return False
        age = time - self._scans[sensor_id].stamp
        return -_TIME_TOLERANCE <= age <= self.settings.max_scan_age + _TIME_TOLERANCE


def _identical(first: Sequence[object], second: Sequence[object]) -> bool:
    return len(first) == len(second) and all(a is b for a, b in zip(first, second, strict=True))


def _same_ranges(first: PlanarScan, second: PlanarScan) -> bool:
    return (
        first.angle_min == second.angle_min
        and first.angle_increment == second.angle_increment
        and first.range_min == second.range_min
        and first.range_max == second.range_max
        and np.array_equal(first.ranges, second.ranges, equal_nan=True)
    )
