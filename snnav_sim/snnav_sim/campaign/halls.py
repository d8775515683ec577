"""Random halls: border, inner walls with doors, obstacles, and the range finders on the walls."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from snnav_core.types import FloatArray
from snnav_sim.scene_types import Circle, Point, Polygon, SensorScene, Shape
from snnav_sim.visibility import ring_segments, visible_region
from snnav_sim.world import solid

__all__ = ["Draws", "Hall", "between", "draw_hall", "draw_sensors"]

Draws = np.random.Generator

_OFF_WALL = 0.1  # [m] from the wall to the scanner
_CANDIDATES = 3  # places that are looked at for each scanner, the one that sees most that is new is taken
_VIEW = math.radians(180.0)
_RANGES = (16.0, 30.0)  # [m]
_TRIES = 100


@dataclass(frozen=True)
class Hall:
    """What stands still: a border and what is inside."""

    border: Polygon
    obstacles: tuple[Shape, ...]

    @property
    def free(self) -> BaseGeometry:
        """The workspace without the obstacles [m, map]."""
        solids = [solid(shape) for shape in self.obstacles]
        return shapely.Polygon(self.border.vertices).difference(shapely.union_all(solids))


def between(draws: Draws, low: float, high: float, digits: int = 2) -> float:
    """Return a number in [low, high] with few digits."""
    return round(float(draws.uniform(low, high)), digits)


def draw_hall(draws: Draws, low: float, high: float, obstacles: int, walls: int) -> Hall:
    """Return a random hall.

    Parameters
    ----------
    draws : numpy.random.Generator
    low, high : float
        Width and depth lie between these [m].
    obstacles, walls : int
        At most so many.
    """
    width, depth = between(draws, low, high, 1), between(draws, low, high, 1)
    border = Polygon(_outline(draws, width, depth))
    shapes: list[Shape] = []
    for _ in range(int(draws.integers(0, walls + 1))):
        shapes += _wall(draws, border, width, depth)
    for _ in range(int(draws.integers(0, obstacles + 1))):
        shapes.append(_obstacle(draws, between(draws, 1.0, width - 1.0), between(draws, 1.0, depth - 1.0)))
    return Hall(border, tuple(shapes))


def _outline(draws: Draws, width: float, depth: float) -> tuple[Point, ...]:
    """A rectangle, an L, a rectangle with corners cut off, or something irregular."""
    sort = draws.choice(4, p=(0.4, 0.2, 0.2, 0.2))
    if sort == 0:
        return ((0.0, 0.0), (width, 0.0), (width, depth), (0.0, depth))
    if sort == 1:
        x, y = between(draws, 0.4 * width, 0.7 * width, 1), between(draws, 0.4 * depth, 0.7 * depth, 1)
        return ((0.0, 0.0), (width, 0.0), (width, y), (x, y), (x, depth), (0.0, depth))
    if sort == 2:
        corners: list[Point] = []
        for x, y, along in ((0.0, 0.0, 1), (width, 0.0, 0), (width, depth, 1), (0.0, depth, 0)):
            if draws.random() < 0.6:
                cut_x, cut_y = between(draws, 1.0, 0.35 * width, 1), between(draws, 1.0, 0.35 * depth, 1)
                in_x = (round(x + cut_x if x == 0.0 else x - cut_x, 2), y)
                in_y = (x, round(y + cut_y if y == 0.0 else y - cut_y, 2))
                corners += [in_y, in_x] if along else [in_x, in_y]
            else:
                corners.append((x, y))
        return tuple(corners)
    count = int(draws.integers(5, 10))
    steps = draws.uniform(0.7, 1.3, count)
    angles = 2.0 * math.pi * np.cumsum(steps) / steps.sum() + draws.uniform(0.0, 1.0)
    spans = draws.uniform(0.75, 1.0, count)
    return tuple(
        (
            round(float(0.5 * width * (1.0 + span * math.cos(angle))), 2),
            round(float(0.5 * depth * (1.0 + span * math.sin(angle))), 2),
        )
        for angle, span in zip(angles, spans, strict=True)
    )


def _wall(draws: Draws, border: Polygon, width: float, depth: float) -> list[Shape]:
    """A wall from side to side with one or two doors, or one that ends in the hall; it may stand aslant."""
    if draws.random() < 0.5:
        first, last = draws.uniform(0.25, 0.75) * width, draws.normal(0.0, 1.0)
        line = shapely.LineString([(first, -1.0), (first + last * (draws.random() < 0.4), depth + 1.0)])
    else:
        first, last = draws.uniform(0.25, 0.75) * depth, draws.normal(0.0, 1.0)
        line = shapely.LineString([(-1.0, first), (width + 1.0, first + last * (draws.random() < 0.4))])
    parts = shapely.get_parts(line.intersection(shapely.Polygon(border.vertices)))
    begin, end = shapely.get_coordinates(max(parts, key=shapely.length))
    length = math.dist(begin, end)
    if draws.random() < 0.3:
        solid_parts = [(0.0, draws.uniform(0.4, 0.75) * length)]
        if draws.random() < 0.5:
            begin, end = end, begin
    else:
        solid_parts = _beside_doors(draws, length)
    thick = between(draws, 0.1, 0.3)
    return [_plank(begin, end, low / length, high / length, thick) for low, high in solid_parts]


def _beside_doors(draws: Draws, length: float) -> list[Point]:
    """What is left of a wall between one or two doors, each from and to a distance along it [m]."""
    parts, begin = [], 0.0
    for door in sorted(draws.uniform(0.1, 0.9, int(draws.integers(1, 3))) * length):
        half = 0.5 * between(draws, 1.0, 3.0)
        parts.append((begin, door - half))
        begin = max(begin, door + half)
    return [(low, high) for low, high in [*parts, (begin, length)] if high - low > 0.05]


def _plank(begin: FloatArray, end: FloatArray, low: float, high: float, thick: float) -> Polygon:
    """The part of a wall between two shares of its length; it reaches into the walls that it ends at."""
    along = (end - begin) / math.dist(begin, end)
    first = begin + low * (end - begin) - 0.3 * along * (low == 0.0)
    last = begin + high * (end - begin) + 0.3 * along * (high == 1.0)
    across = 0.5 * thick * np.array([-along[1], along[0]])
    corners = np.array([first - across, last - across, last + across, first + across])
    return Polygon(tuple((x, y) for x, y in corners.round(3).tolist()))


def _obstacle(draws: Draws, x: float, y: float) -> Shape:
    """A pillar, a crate that may stand aslant, or something with three to seven corners."""
    sort = draws.integers(3)
    if sort == 0:
        return Circle(x, y, between(draws, 0.2, 0.8))
    if sort == 1:
        half = np.array([between(draws, 0.2, 1.2), between(draws, 0.2, 1.2)])
        corners = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]) * half
        turn = 0.0 if draws.random() < 0.5 else draws.uniform(0.0, 0.5 * math.pi)
        cosine, sine = math.cos(turn), math.sin(turn)
        points: FloatArray = corners @ np.array([[cosine, sine], [-sine, cosine]])
    else:
        count = int(draws.integers(3, 8))
        angles = 2.0 * math.pi * (np.arange(count) + draws.uniform(0.0, 0.6, count)) / count
        points = draws.uniform(0.4, 1.2, count)[:, None] * np.stack((np.cos(angles), np.sin(angles)), axis=-1)
    return Polygon(tuple((round(x + float(dx), 2), round(y + float(dy), 2)) for dx, dy in points))


def draw_sensors(draws: Draws, hall: Hall, least: int, most: int, rates: bool) -> tuple[SensorScene, ...]:
    """Return range finders like the LMS-200 on the walls; each hangs at the best of three random places.

    Parameters
    ----------
    draws : numpy.random.Generator
    hall : Hall
    least, most : int
        Their number lies between these.
    rates : bool
        Whether every device measures at a rate and offset of its own.
    """
    free = hall.free
    segments = ring_segments(shapely.orient_polygons(free))
    seen: BaseGeometry = shapely.Polygon()
    sensors: list[SensorScene] = []
    for number in range(1, int(draws.integers(least, most + 1)) + 1):
        gains: list[tuple[float, int, SensorScene, BaseGeometry]] = []
        for _ in range(_CANDIDATES):
            sensor = _sensor(draws, f"lms_{number}", hall, free, rates)
            view = visible_region(
                sensor.position, sensor.heading + sensor.angle_min, _VIEW, sensor.range_max, segments
            )
            gains.append((view.difference(seen).area, len(gains), sensor, view))
        _, _, sensor, view = max(gains, key=lambda gain: gain[:2])
        sensors.append(sensor)
        seen = seen.union(view)
    return tuple(sensors)


def _sensor(draws: Draws, name: str, hall: Hall, free: BaseGeometry, rates: bool) -> SensorScene:
    position, heading = _place(draws, hall, free)
    period = between(draws, 0.1, 0.5) if rates else None
    return SensorScene(
        id=name,
        device="lms200",
        position=position,
        heading=math.radians(round(math.degrees(heading)) % 360),
        field_of_view=_VIEW,
        resolution=math.radians(0.5),
        range_max=float(draws.choice(_RANGES, p=(0.3, 0.7))),
        angle_min=-0.5 * _VIEW,
        noise="lms200",
        scan_period=period,
        scan_offset=between(draws, 0.001, 0.9 * period, 3) if period else 0.0,
    )


def _place(draws: Draws, hall: Hall, free: BaseGeometry) -> tuple[Point, float]:
    """A place on the border and a heading inwards, or out of a corner along its diagonal."""
    border = np.array(hall.border.vertices)
    if not shapely.Polygon(border).exterior.is_ccw:
        border = border[::-1]
    for _ in range(_TRIES):
        index = int(draws.integers(len(border)))
        before, corner, after = border[index - 1], border[index], border[(index + 1) % len(border)]
        edge = (after - corner) / np.hypot(*(after - corner))
        if draws.random() < 0.4:
            last = (corner - before) / np.hypot(*(corner - before))
            direction = edge - last
            if edge[0] * last[1] - edge[1] * last[0] > -0.1 or np.hypot(*direction) < 0.1:
                continue  # no corner to hang in
            place, heading = corner, math.atan2(direction[1], direction[0])
        else:
            place = corner + draws.uniform(0.1, 0.9) * (after - corner)
            heading = math.atan2(edge[0], -edge[1]) + draws.uniform(-0.4, 0.4)
        inwards = math.atan2(edge[0], -edge[1]) if place is not corner else heading
        x, y = place + _OFF_WALL * np.array([math.cos(inwards), math.sin(inwards)])
        point = (round(float(x), 2), round(float(y), 2))
        if free.contains(shapely.Point(point).buffer(0.01)):
            return point, heading
    raise RuntimeError(f"no place for a range finder in {_TRIES} tries: {hall}")
