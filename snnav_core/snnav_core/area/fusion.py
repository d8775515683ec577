"""From the scans of all sensors to the unoccupied area at one sampling instant."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from shapely.geometry import MultiPolygon
from shapely.geometry.base import BaseGeometry

from snnav_core.area.agreement import agree, cut_returns
from snnav_core.area.hiding import RobotHiding
from snnav_core.area.history import SeenHistory
from snnav_core.area.intake import check_clock, same_ranges, scan_intake
from snnav_core.area.memory import remember
from snnav_core.area.overlay import union_all
from snnav_core.area.planar import LostPart, UnoccupiedArea, as_multipolygon, shrink
from snnav_core.area.returns import FusedReturns, fused_returns
from snnav_core.area.settings import FusionSettings, PlanarSensor
from snnav_core.errors import InvalidInput
from snnav_core.sensing.scan import DetectedArea, PlanarScan, detect_planar
from snnav_core.types import TIME_TOLERANCE, FloatArray, RobotSpec, RobotState

__all__ = ["AreaFusion", "FusionSettings", "PlanarSensor"]

_SAME_PLACE = 1e-6  # [m]; nothing moves less than this far
_NO_AREA = 1e-6  # [m^2]


class AreaFusion:
    """Keeps the latest scan of every sensor and builds the unoccupied area from them.

    Parameters
    ----------
    sensors : sequence of PlanarSensor
        The sensor network.
    settings : FusionSettings
    robots : sequence of RobotSpec
        Those that sensors with `sees_robots` can see; `add_state` says where they are.

    Raises
    ------
    InvalidInput
        If there is no sensor, or two sensors or two robots have the same name.
    """

    def __init__(
        self,
        sensors: Sequence[PlanarSensor],
        settings: FusionSettings | None = None,
        robots: Sequence[RobotSpec] = (),
    ) -> None:
        self.sensors = {sensor.id: sensor for sensor in sensors}
        if not sensors or len(self.sensors) != len(sensors):
            raise InvalidInput(f"sensors {[s.id for s in sensors]}: need at least one, and different ids")
        self.settings = settings or FusionSettings()
        self._intakes = {sensor.id: scan_intake(sensor) for sensor in sensors}
        nothing_moves = self.settings.boundary_speed == 0.0
        self._robots = RobotHiding(robots, self.settings.robot_tolerance, keeps_lengths=nothing_moves)
        self._robots_are_seen = any(sensor.settings.sees_robots for sensor in sensors)
        self._history = SeenHistory(list(self.sensors))
        self.reset()

    def reset(self) -> None:
        """Forget all scans, states of robots and the memory, as after a jump of time."""
        self._robots.clear()
        self._history.clear()
        self._latest: dict[str, tuple[PlanarScan, DetectedArea]] = {}
        self._folded: dict[str, PlanarScan] = {}  # scans that are part of what is known
        self._agreed: tuple[list[DetectedArea], list[DetectedArea], dict[str, int]] = ([], [], {})
        self._union: tuple[list[BaseGeometry], MultiPolygon] = ([], MultiPolygon())
        self._nothing_remembered = True
        self._known: UnoccupiedArea | None = None  # at the newest stamp that is part of it
        self._area: UnoccupiedArea | None = None

    def add_scan(self, sensor_id: str, scan: PlanarScan, now: float | None = None) -> DetectedArea:
        """Take a new scan of one sensor and return what it saw, robots included.

        One that is refused leaves everything as it was, one that came before is taken for it.

        Parameters
        ----------
        sensor_id : str
        scan : PlanarScan
        now : float, optional
            Time at the arrival of the scan [s]: a stamp ahead of it lies. Without, a scan counts from its stamp on.

        Raises
        ------
        InvalidInput
            If the sensor is unknown, the stamp is ahead of `now` by more than `clock_tolerance`, older than the last
            one, or that of other ranges, or if a device that never repeats itself froze.
        ScanError
            If the scan cannot be used.
        """
        sensor = self.sensors.get(sensor_id)
        if sensor is None:
            raise InvalidInput(f"scan of unknown sensor {sensor_id!r}; known: {sorted(self.sensors)}")
        last = self._latest.get(sensor_id)
        before = None if last is None else last[0]
        intake, tolerance = self._intakes[sensor_id], self.settings.clock_tolerance
        if intake.is_repeated(scan, before, now, tolerance) and last is not None:
            return last[1]
        if last is not None and same_ranges(last[0], scan):
            detected = last[1]
        else:
            detected = detect_planar(sensor_id, scan, sensor.pose, sensor.settings)
        self._latest[sensor_id] = (scan, detected)
        self._history.add(scan.stamp, detected)
        return detected

    def add_robot(self, robot: RobotSpec) -> None:
        """Know one more robot that sensors can see; `InvalidInput` if there is one of this name."""
        self._robots.add_robot(robot)

    def remove_robot(self, robot_id: str) -> None:
        """Forget a robot that was taken out of the workspace; a name that is not known is no fault."""
        self._robots.remove_robot(robot_id)

    def add_state(self, state: RobotState, now: float | None = None) -> None:
        """Take where a robot is; before the `area` of the time at which sensors see it there.

        Parameters
        ----------
        state : RobotState
        now : float, optional
            Time at its arrival [s]: a stamp ahead of it lies.

        Raises
        ------
        InvalidInput
            If the robot is unknown, a number is not finite, or the state is older than the last one or ahead of `now`
            by more than `clock_tolerance`.
        """
        check_clock(f"state of robot {state.id!r}", state.stamp, now, self.settings.clock_tolerance)
        self._robots.add(state)

    def latest_stamp(self, sensor_id: str) -> float | None:
        """Stamp of the latest scan of a sensor [s], or None."""
        latest = self._latest.get(sensor_id)
        return None if latest is None else latest[0].stamp

    def silent_sensors(self, time: float) -> list[str]:
        """Sensors without a scan young enough at `time` [s]."""
        return [sensor_id for sensor_id in self.sensors if not self._is_usable(sensor_id, time)]

    def last_seen(self, points: FloatArray, time: float) -> tuple[NDArray[np.int64], FloatArray]:
        """Which sensor saw each of some points free last up to `time` [s], and when: see `SeenHistory.last_seen`.

        The index counts the sorted ids of the sensors. Only the last 20 different scans of each sensor are known.
        """
        return self._history.last_seen(points, time)

    def returns(self, time: float) -> FusedReturns:
        """Latest hits of all sensors with a usable scan at `time` [s], those on robots left out, for the tracker."""
        usable = [sensor_id for sensor_id in sorted(self._latest) if self._is_usable(sensor_id, time)]
        stamps = [self._latest[sensor_id][0].stamp for sensor_id in usable]
        numbers = [sorted(self.sensors).index(sensor_id) for sensor_id in usable]
        return fused_returns([self._without_robots(sensor_id) for sensor_id in usable], stamps, numbers)

    def area(self, time: float) -> UnoccupiedArea:
        """The unoccupied area at `time` [s]; empty when there is no scan.

        What each scan saw is reduced by V_max times its age and added to what was known to be free at the last area,
        reduced by V_max times the time since (memory, deviation C3-5). With V_max = 0 the latest scans show all.

        Parts are reduced one by one, not their union: where they meet a little is lost, but a stamp may be older than
        the measurement (a clock that is behind), and what was seen later must not cover for what was seen before.

        Raises
        ------
        InvalidInput
            If time runs backwards while memory is on; call `reset` after a jump.
        """
        if self.settings.remembers and self._area is not None and time < self._area.stamp:
            raise InvalidInput(
                f"area at {time} s asked for after that at {self._area.stamp} s; reset the memory after a jump of time"
            )
        usable = [sensor_id for sensor_id in sorted(self._latest) if self._is_usable(sensor_id, time)]
        parts = [self._without_robots(sensor_id) for sensor_id in usable]
        if not _identical(parts, self._agreed[0]):
            self._agreed = (parts, *agree(parts, self.settings))
        before, lost = self._known, self._lost(time)
        self._known = known = self._advanced(time, usable, lost)
        reach = (time - known.stamp) * self.settings.boundary_speed
        if reach > _SAME_PLACE:
            # remember, not shrink: it keeps the number of vertices in bounds
            region = remember(known.region, MultiPolygon(), time - known.stamp, self.settings.boundary_speed)
            disks = self._disks(time, [region])
            if disks:
                region = cut_returns(as_multipolygon(union_all([region, *disks])), parts, self.settings)
            self._area = UnoccupiedArea(time, region, self._agreed[2], lost)
        else:
            self._area = known if known is not before else known.restamped(time, self._agreed[2], lost)
        return self._area

    def _advanced(self, time: float, usable: list[str], lost: tuple[LostPart, ...]) -> UnoccupiedArea:
        """What is known to be free once all scans that are not yet part of it are added."""
        known, pieces = self._known, self._new_pieces(time, usable)
        remembers, found = self.settings.remembers, self._agreed[2]
        if known is not None and not pieces and remembers:
            return known
        if known is not None and self._nothing_remembered and _identical(pieces, self._union[0]):
            return known.restamped(time, found, lost)
        region = self._with_memory(pieces, known if remembers else None, time)
        return UnoccupiedArea(time, cut_returns(region, self._agreed[0], self.settings), found, lost)

    def _new_pieces(self, time: float, usable: list[str]) -> list[BaseGeometry]:
        """What scans that are not yet part of the known area saw, reduced by what may have moved since their stamps."""
        remembers, agreed = self.settings.remembers, dict(zip(usable, self._agreed[1], strict=True))
        pieces: list[BaseGeometry] = []
        for sensor_id in usable:
            scan = self._latest[sensor_id][0]
            if remembers and self._folded.get(sensor_id) is scan:
                continue
            self._folded[sensor_id] = scan
            age = time - scan.stamp + self.settings.clock_tolerance
            reach = age * self.settings.boundary_speed
            polygon = agreed[sensor_id].polygon
            if reach > _SAME_PLACE:
                if self.sensors[sensor_id].settings.sees_robots:
                    # where robots were at the stamp: else the free space in front of them would shrink away from them
                    polygon = union_all([polygon, *self._disks(scan.stamp, [polygon])])
                polygon = shrink(polygon, reach)
            pieces.append(polygon)
        return pieces + self._disks(time, pieces)

    def _with_memory(
        self, pieces: list[BaseGeometry], known: UnoccupiedArea | None, time: float
    ) -> MultiPolygon:
        """The union of what was seen and of what was known before and cannot have been reached since."""
        if not _identical(pieces, self._union[0]):
            self._union = (pieces, as_multipolygon(union_all(pieces)))
        seen = self._union[1]
        self._nothing_remembered = True
        if known is None:
            return seen
        remembered = remember(known.region, seen, time - known.stamp, self.settings.boundary_speed)
        self._nothing_remembered = remembered.area - seen.area < _NO_AREA
        return seen if self._nothing_remembered else remembered

    def _disks(self, time: float, seen: Sequence[BaseGeometry]) -> list[BaseGeometry]:
        """Where robots are that sensors see, if anything else is free."""
        if not self._robots_are_seen or all(one.is_empty for one in seen):
            return []
        return list(self._robots.disks(time))

    def _without_robots(self, sensor_id: str) -> DetectedArea:
        scan, detected = self._latest[sensor_id]
        if not self.sensors[sensor_id].settings.sees_robots:
            return detected
        return self._robots.without_robots(detected, scan.stamp)

    def _lost(self, time: float) -> tuple[LostPart, ...]:
        """What the sensors saw last that have no usable scan."""
        lost = []
        for sensor_id in sorted(self.silent_sensors(time)):
            latest = self._latest.get(sensor_id)
            if latest is None:
                lost.append(LostPart(sensor_id, None, MultiPolygon()))
            else:
                lost.append(LostPart(sensor_id, latest[0].stamp, as_multipolygon(latest[1].polygon)))
        return tuple(lost)

    def _is_usable(self, sensor_id: str, time: float) -> bool:
        if sensor_id not in self._latest:
            return False
        age = time - self._latest[sensor_id][0].stamp
        earliest = -self.settings.clock_tolerance - TIME_TOLERANCE
        return earliest <= age <= self.settings.max_scan_age + TIME_TOLERANCE


def _identical(first: Sequence[object], second: Sequence[object]) -> bool:
    return len(first) == len(second) and all(a is b for a, b in zip(first, second, strict=True))
