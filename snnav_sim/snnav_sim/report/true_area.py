"""The true unoccupied area among moving bodies: all that the sensors of a scene can know to be free at best."""

from __future__ import annotations

import math

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.affinity import translate
from shapely.geometry import MultiPolygon
from shapely.geometry.base import BaseGeometry

from snnav_core.area.planar import UnoccupiedArea, as_multipolygon, grow
from snnav_core.types import FloatArray
from snnav_sim.scene_types import Mover, Point, SensorScene
from snnav_sim.visibility import ring_segments, visible_region
from snnav_sim.world import World, mover_positions, solid

__all__ = ["TrueMemory"]

_QUARTER_SEGMENTS = 24  # chords of a quarter arc
# The corners of a chord chain lie on the arc, a chord may span 1.5 steps: so much more is taken off (0.12 %).
_OUTSIDE = 1.0 / math.cos(1.5 * math.pi / (4 * _QUARTER_SEGMENTS))
_REACH = 1.0  # [m]; how far beyond the margin a distance between sampling instants is told exactly
_TIME = 1e-6  # [s]
_PLACES = 10  # of a body in a sampling interval, for what it sweeps


class TrueMemory:
    """What is seen, and what was seen free and cannot have been reached since (C3-5), from exact visibility.

    M(t_k) = V(t_k) united with R[M(t_{k-1}), delta V_max], V = what the sensors can truly see.

    Parameters
    ----------
    world : World

    Notes
    -----
    All sensors work and look at the sampling instants; those with instants of their own look then as well, and what
    they saw in between shrinks to the next sampling instant. Robots hide nothing. What fusion may claim at these
    instants is never more: beams are fewer than bearings, sensors may fail, and robots stand in the way of sensors on
    the floor. The erosion is its own, with chords on the safe side: short of the exact one by at most 0.12 % of the way
    eroded, 1 % at dents of the outline.
    """

    def __init__(self, world: World) -> None:
        self._world, self._scene = world, world.scene
        self._regions: list[MultiPolygon] = []
        self._areas: dict[int, UnoccupiedArea] = {}
        self._views: dict[int, list[BaseGeometry]] = {}

    @property
    def moves(self) -> bool:
        """Whether the area changes at all."""
        return any(mover.top_speed > 0.0 for mover in self._scene.movers)

    def views(self, index: int) -> list[BaseGeometry]:
        """Return what each sensor sees at a sampling instant by its number from 0 [m, map]."""
        index = index if self.moves else 0
        if index not in self._views:
            self._views[index] = self._world.visible_regions(index * self._scene.sampling_interval)
        return self._views[index]

    def region(self, index: int) -> MultiPolygon:
        """Return the area of a sampling instant by its number from 0 [m, map]."""
        index = index if self.moves else 0
        reach = self._scene.sampling_interval * self._scene.boundary_speed
        while len(self._regions) <= index:
            kept = [_eroded(self._regions[-1], reach)] if self._regions else []
            number = len(self._regions)
            area = shapely.union_all([*self.views(number), *self._views_since(number), *kept])
            self._regions.append(as_multipolygon(area))
        return self._regions[index]

    def _area(self, index: int) -> UnoccupiedArea:
        """Return the same with what its distances need, which all robots share."""
        index = index if self.moves else 0
        if index not in self._areas:
            self._areas[index] = UnoccupiedArea(0.0, self.region(index))
        return self._areas[index]

    def _views_since(self, index: int) -> list[BaseGeometry]:
        """Return what is left of what sensors with instants of their own saw since the sampling instant before."""
        world, scene = self._world, self._scene
        end = index * scene.sampling_interval
        parts = []
        for sensor in scene.sensors:
            period, offset = scene.scan_period(sensor), sensor.scan_offset
            first = math.floor((end - scene.sampling_interval - offset) / period + _TIME) + 1
            for number in range(max(0, first), math.ceil((end - offset) / period - _TIME)):
                instant = offset + number * period
                if not world.is_covered(sensor.position, instant):
                    view = _view(sensor, 0.0, sensor.field_of_view, ring_segments(world.free_region(instant)))
                    parts.append(_eroded(view, (end - instant) * scene.boundary_speed))
        return parts

    def clearance(self, points: FloatArray, times: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Return the signed distance to the boundary of the area at each time, negative outside.

        Parameters
        ----------
        points : ndarray, shape (N, 2)
            [m, map]
        times : ndarray, shape (N,)
            [s]

        Returns
        -------
        clearance : ndarray, shape (N,)
            [m]
        exact : ndarray of bool, shape (N,)
            Where it is the distance itself. Elsewhere, between sampling instants, it is a lower bound: the distance
            to M(t_k) less what a boundary moves since t_k, or to what stays free up to t_{k+1} wherever the bodies
            are on their way. The least of all, and whatever is below the safety margin, is exact.
        """
        delta, margin = self._scene.sampling_interval, self._scene.safety_margin
        numbers = (
            np.floor((times + _TIME) / delta).astype(np.int64) if self.moves else np.zeros(len(times), int)
        )
        since = times - numbers * delta if self.moves else np.zeros(len(times))
        clearance = np.empty(len(points))
        for number in np.unique(numbers):
            rows = numbers == number
            clearance[rows] = self._area(int(number)).clearance(points[rows])
        clearance -= since * self._scene.boundary_speed
        exact = since <= _TIME
        least = max(margin, float(np.min(clearance[exact]))) if exact.any() else math.inf
        for number in np.unique(numbers[~exact & (clearance < least)]):
            rows = (numbers == number) & ~exact & (clearance < least)
            lasting = self._near(points[rows], number * delta, delta, int(number), least)
            clearance[rows] = np.maximum(clearance[rows], lasting)
        for row in np.flatnonzero(~exact & (clearance < least)):
            limit = max(margin, float(clearance[row])) + _REACH
            near = float(self._near(points[[row]], float(times[row]), 0.0, int(numbers[row]), limit)[0])
            exact[row] = near < limit
            clearance[row] = max(clearance[row], near)
        return clearance, exact

    def _near(
        self, points: FloatArray, begin: float, duration: float, number: int, limit: float
    ) -> FloatArray:
        """Return the distances of points (N, 2) to the boundary of what is free for a while, at most the limit [m].

        Free for a while is what is seen past all that bodies sweep, and the memory of sampling instant `number` that
        is left at the end. Only what is near is built: what the sensors see through the bearings of a disk around the
        points, and the memory within a square.
        """
        blocked = shapely.union_all([_swept(mover, begin, duration) for mover in self._scene.movers])
        segments = ring_segments(shapely.difference(self._world.static_region, blocked))
        low, high = points.min(axis=0), points.max(axis=0)
        x, y = (0.5 * (low + high)).tolist()
        radius = limit + 0.5 * math.dist(low, high)
        parts = [
            _seen_near(sensor, (x, y), radius, segments)
            for sensor in self._scene.sensors
            if not blocked.intersects(shapely.Point(sensor.position))
        ]
        age = (begin + duration - number * self._scene.sampling_interval) * self._scene.boundary_speed
        side = radius + 1.1 * age + 0.1
        square = shapely.box(x - side, y - side, x + side, y + side)
        parts.append(_eroded(shapely.intersection(self.region(number), square), age))
        area = UnoccupiedArea(0.0, as_multipolygon(shapely.union_all(parts)))
        return np.minimum(area.clearance(points), limit)


def _seen_near(sensor: SensorScene, centre: Point, radius: float, segments: FloatArray) -> BaseGeometry:
    """Return what a sensor sees through the bearings of a disk; beside the disk it may be anything."""
    width = sensor.field_of_view
    dx, dy = centre[0] - sensor.position[0], centre[1] - sensor.position[1]
    distance = math.hypot(dx, dy)
    if distance - radius >= sensor.range_max:
        return shapely.Polygon()
    if distance <= 1.01 * radius:
        return _view(sensor, 0.0, width, segments)
    half = math.asin(radius / distance) + 0.01
    low = math.remainder(math.atan2(dy, dx) - half - sensor.heading - sensor.angle_min, 2.0 * math.pi)
    if sensor.all_round:
        return _view(sensor, low, low + 2.0 * half, segments)
    parts = []
    for turn in (0.0, 2.0 * math.pi):  # the disk may lie on both sides of a gap in the field of view
        begin, end = max(low + turn, 0.0), min(low + turn + 2.0 * half, width)
        if begin < end:
            parts.append(_view(sensor, begin, end, segments))
    return shapely.union_all(parts)


def _view(sensor: SensorScene, begin: float, end: float, segments: FloatArray) -> BaseGeometry:
    """Return what a sensor sees between two angles from its first beam [rad]."""
    first = sensor.heading + sensor.angle_min + begin
    return visible_region(sensor.position, first, end - begin, sensor.range_max, segments)


def _swept(mover: Mover, begin: float, duration: float) -> BaseGeometry:
    """Return a region that holds a body all the time; the body itself for a moment."""
    if duration == 0.0 or mover.top_speed == 0.0:
        x, y = mover_positions(mover, begin)[0].tolist()
        return translate(solid(mover.shape), x, y)
    step = duration / _PLACES
    places = mover_positions(mover, np.linspace(begin, begin + duration, _PLACES + 1))
    corners = shapely.get_coordinates(solid(mover.shape))
    outline = shapely.MultiPoint((places[:, None, :] + corners).reshape(-1, 2))
    return (
        grow(outline.convex_hull, 0.5 * step * mover.top_speed)
        if mover.top_speed > 0.0
        else outline.convex_hull
    )


def _eroded(region: BaseGeometry, distance: float) -> BaseGeometry:
    if distance <= 0.0:
        return region
    return region.buffer(-distance * _OUTSIDE, quad_segs=_QUARTER_SEGMENTS)
