"""The true world of a scene: walls, obstacles, moving bodies, and what can be seen of it at any time."""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from snnav_core.types import FloatArray
from snnav_sim.scene_types import Circle, Mover, Polygon, Scene, SensorScene, Shape
from snnav_sim.visibility import ring_segments, visible_region

__all__ = ["World", "mover_positions", "solid"]

_CIRCLE_CORNERS = (
    180  # of the circumscribed polygon that stands for a circle (0.2 permille of the radius too large)
)


class World:
    """Ground truth of a scene.

    Parameters
    ----------
    scene : Scene
        The border of its workspace is a wall. With recorded sensors the obstacles are unknown and the world is
        the empty workspace.

    Notes
    -----
    Robots are not part of it: range finders are mounted higher than any robot (assumption of ch. 3), except for those
    that a scene says to see robots; they are told where robots are.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        border = shapely.orient_polygons(shapely.Polygon(scene.workspace))
        segments, circles = _arrays(scene.obstacles)
        self._segments = np.concatenate((ring_segments(border), segments))
        self._circles = circles

    @property
    def static_segments(self) -> FloatArray:
        """Walls and polygons at rest, free space on their left [m, map], shape (S, 4)."""
        return self._segments

    @property
    def static_circles(self) -> FloatArray:
        """Disks at rest: x, y, radius [m, map], shape (C, 3)."""
        return self._circles

    def mover_shapes(self, time: float) -> tuple[FloatArray, FloatArray]:
        """Return segments (S, 4) and circles (C, 3) of the moving bodies at a time [s] [m, map]."""
        return _arrays([_shifted(mover, time) for mover in self.scene.movers])

    def is_covered(self, point: tuple[float, float], time: float) -> bool:
        """Whether a moving body stands on a point [m, map]."""
        where = shapely.Point(point)
        return any(solid(_shifted(mover, time)).intersects(where) for mover in self.scene.movers)

    def obstacle_clearance(self, points: FloatArray, time: float | FloatArray = 0.0) -> FloatArray:
        """Return the distance to the nearest true obstacle, mover or wall.

        Parameters
        ----------
        points : ndarray, shape (N, 2)
            [m, map]
        time : float or ndarray, shape (N,)
            One for all points or one for each [s].

        Returns
        -------
        ndarray, shape (N,)
            [m]; negative inside an obstacle or outside the workspace.
        """
        points = np.asarray(points, dtype=np.float64).reshape(-1, 2)
        times = np.broadcast_to(np.asarray(time, dtype=np.float64), (len(points),))
        clearance = -_distance(self.scene.border, points)
        for shape in self.scene.obstacles:
            np.minimum(clearance, _distance(shape, points), out=clearance)
        for mover in self.scene.movers:
            relative = points - mover_positions(mover, times)
            np.minimum(clearance, _distance(mover.shape, relative), out=clearance)
        return clearance

    @cached_property
    def static_region(self) -> BaseGeometry:
        """The workspace without the obstacles at rest [m, map]."""
        solids = [solid(shape) for shape in self.scene.obstacles]
        return shapely.Polygon(self.scene.workspace).difference(shapely.union_all(solids))

    def free_region(self, time: float) -> BaseGeometry:
        """Return the workspace without obstacles and movers at a time [s] [m, map]."""
        solids = [solid(_shifted(mover, time)) for mover in self.scene.movers]
        return self.static_region.difference(shapely.union_all(solids)) if solids else self.static_region

    def visible_regions(self, time: float) -> list[BaseGeometry]:
        """Return what each sensor can truly see at a time [s] [m, map]."""
        if not self.scene.movers:
            return self._static_views
        segments = ring_segments(self.free_region(time))
        return [
            shapely.Polygon() if self.is_covered(sensor.position, time) else _view(sensor, segments)
            for sensor in self.scene.sensors
        ]

    def true_unoccupied_area(self, time: float = 0.0) -> BaseGeometry:
        """Return the union of what all sensors can truly see at a time [s] [m, map].

        Field of view and range limit the view, beams do not: this is the exact visibility region.
        """
        return self._static_area if not self.scene.movers else shapely.union_all(self.visible_regions(time))

    @cached_property
    def _static_views(self) -> list[BaseGeometry]:
        segments = ring_segments(self.static_region)
        return [_view(sensor, segments) for sensor in self.scene.sensors]

    @cached_property
    def _static_area(self) -> BaseGeometry:
        return shapely.union_all(self._static_views)


def mover_positions(mover: Mover, times: float | FloatArray) -> FloatArray:
    """Return where the origin of a body is at times [s], shape (N,) -> (N, 2) [m, map]."""
    times = np.atleast_1d(np.asarray(times, dtype=np.float64))
    if mover.start is not None:
        positions: FloatArray = np.asarray(mover.start) + times[:, None] * np.asarray(mover.velocity)
        return positions
    corners = np.asarray(mover.waypoints)
    marks = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(corners, axis=0).T))))
    way = np.maximum(times, 0.0) * mover.speed
    if mover.loop:
        way = marks[-1] - np.abs(way % (2.0 * marks[-1]) - marks[-1])
    return np.stack([np.interp(way, marks, corners[:, axis]) for axis in range(2)], axis=-1)


def _shifted(mover: Mover, time: float) -> Shape:
    x, y = mover_positions(mover, time)[0].tolist()
    if isinstance(mover.shape, Circle):
        return Circle(mover.shape.x + x, mover.shape.y + y, mover.shape.radius)
    return Polygon(tuple((px + x, py + y) for px, py in mover.shape.vertices))


def solid(shape: Shape) -> BaseGeometry:
    """Return the shape as a polygon, a circle as one drawn round it."""
    if isinstance(shape, Polygon):
        return shapely.Polygon(shape.vertices)
    angles = np.arange(_CIRCLE_CORNERS) * (2.0 * math.pi / _CIRCLE_CORNERS)
    radius = shape.radius / math.cos(math.pi / _CIRCLE_CORNERS)
    return shapely.Polygon(
        np.stack((shape.x + radius * np.cos(angles), shape.y + radius * np.sin(angles)), axis=-1)
    )


def _arrays(shapes: tuple[Shape, ...] | list[Shape]) -> tuple[FloatArray, FloatArray]:
    """Return the segments of the polygons, outside on the left, and the circles."""
    segments, circles = [np.zeros((0, 4))], [np.zeros((0, 3))]
    for shape in shapes:
        if isinstance(shape, Circle):
            circles.append(np.array([[shape.x, shape.y, shape.radius]]))
        else:
            segments.append(ring_segments(shapely.Polygon(shape.vertices))[:, [2, 3, 0, 1]])
    return np.concatenate(segments), np.concatenate(circles)


def _view(sensor: SensorScene, segments: FloatArray) -> BaseGeometry:
    first = sensor.heading + sensor.angle_min
    return visible_region(sensor.position, first, sensor.field_of_view, sensor.range_max, segments)


def _distance(shape: Shape, points: FloatArray) -> FloatArray:
    """Return the signed distance of points (N, 2) to a solid shape, negative inside, shape (N,) [m]."""
    if isinstance(shape, Circle):
        to_circle: FloatArray = np.hypot(points[:, 0] - shape.x, points[:, 1] - shape.y) - shape.radius
        return to_circle
    corners = shape.points
    start, edge = corners, np.roll(corners, -1, axis=0) - corners
    relative = points[:, None, :] - start
    share = np.clip(np.sum(relative * edge, axis=-1) / np.sum(edge * edge, axis=-1), 0.0, 1.0)
    gap = relative - share[..., None] * edge
    distance = np.sqrt(np.min(np.sum(gap * gap, axis=-1), axis=1))
    inside = shapely.contains_xy(shapely.Polygon(corners), points[:, 0], points[:, 1])
    signed: FloatArray = np.where(inside, -distance, distance)
    return signed
