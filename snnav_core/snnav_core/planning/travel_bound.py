"""A lower bound of the travel time among bodies in uniform motion: the earliest arrival of a point in their gaps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from snnav_core.errors import InvalidInput
from snnav_core.obstacles import MovingObstacle
from snnav_core.planning.spacetime_problem import SpacetimeProblem, TravelBound
from snnav_core.planning.travel_bound_kernel import earliest_arrival, free_intervals
from snnav_core.planning.workspace import workspace_region
from snnav_core.types import FloatArray

__all__ = ["travel_bound"]

_QUARTER_SEGMENTS = 8  # chords of a quarter arc; a way round it is short by 0.16 %
_SAME = 1e-6  # [m/s]; velocities that differ by less are one
_APART = 1e-7  # of the margin: outlines that touch by chance do not
_SLOWER = 0.999  # of the robot's speed: what is faster counts as absent
_START_RESERVE = 1e-6  # [m]


def travel_bound(problem: SpacetimeProblem, margin: float) -> TravelBound:
    """Return a time that no path takes less of.

    Parameters
    ----------
    problem : SpacetimeProblem
    margin : float
        Distance that a path must keep from bodies and from the border of the workspace [m].

    Returns
    -------
    TravelBound
        Infinite when there is no way at all.

    Raises
    ------
    InvalidInput
        If the margin is not positive.

    Notes
    -----
    What is relaxed, so that the bound never exceeds the true optimum: the robot is a point that turns at once, waits
    as it likes and moves at `robot.speed` at most; bodies grown by the margin are inscribed polygons; bodies at the
    speed of the robot or faster (`left_out`) and other robots are absent; a body nearer than the margin at the start
    counts with what it leaves; and where a body lays bare the corner of another one, the robot may have waited.

    The rest is exact (K. Fujimura and H. Samet, "Planning a time-minimal motion among moving obstacles", Algorithmica
    10, 1993). A quickest path runs straight and at full speed from corner to corner, which it meets where they are by
    then, and touches them from one side, as seen from the body. A robot can stay with a corner for as long as no other
    body covers it, so that the earliest arrival within each such interval is all that has to be known of it.
    Without motion this is the visibility graph.
    """
    if not margin > 0.0:
        raise InvalidInput(f"margin of the travel bound is {margin} m, must be positive")
    speed = problem.robot.speed
    slow = [body for body in problem.obstacles if body.speed <= _SLOWER * speed]
    left_out = tuple(body.id for body in problem.obstacles if body.speed > _SLOWER * speed)
    start, target = problem.start.position, np.asarray(problem.target, dtype=np.float64)
    world = _World(problem, slow, margin)
    corners, owners, before, after = world.corners()
    places = np.vstack((start, target, corners))
    owners = np.concatenate(([-1, -1], owners))
    before, after = (np.vstack((np.zeros((2, 2)), arms)) for arms in (before, after))
    spans, first = free_intervals(
        places, owners, world.velocities, world.segments, world.offsets, world.inverted
    )
    route = earliest_arrival(
        places,
        owners,
        before,
        after,
        world.velocities,
        world.segments,
        world.offsets,
        world.circles,
        spans,
        first,
        speed,
    )
    if len(route) == 0:
        return TravelBound(float("inf"), np.empty((0, 3)), left_out)
    time = float(route[-1, 2])
    route[:, 2] += problem.start_time
    return TravelBound(time, route, left_out)


class _World:
    """Groups of what moves alike, at the start time, as outlines grown by the margin."""

    def __init__(self, problem: SpacetimeProblem, bodies: Sequence[MovingObstacle], margin: float) -> None:
        self._start = shapely.Point(problem.start.position)
        self._time = problem.start_time
        groups: dict[tuple[int, int], list[MovingObstacle]] = {(0, 0): []}
        for body in bodies:
            key = tuple(np.rint(body.velocity / _SAME).astype(int).tolist())
            groups.setdefault(key, []).append(body)
        shapes: list[BaseGeometry] = []
        velocities: list[FloatArray] = []
        for number, (key, members) in enumerate(groups.items()):
            distance = margin * (1.0 - _APART * (number + 1))
            shape = shapely.union_all([self._grown(body, distance) for body in members])
            if key == (0, 0) and problem.workspace is not None:
                shape = self._room(workspace_region(problem.workspace), distance).difference(shape)
            if members or key == (0, 0):
                shapes.append(shape)
                velocities.append(members[0].velocity if key != (0, 0) else np.zeros(2))
        self._shapes = shapes
        self.velocities: FloatArray = np.array(velocities)
        self.inverted: NDArray[np.bool_] = np.zeros(len(shapes), dtype=np.bool_)
        self.inverted[0] = problem.workspace is not None
        rings = [_rings(shape) for shape in shapes]
        pieces = [
            np.concatenate([np.hstack((ring, np.roll(ring, -1, axis=0))) for ring in of_group])
            if of_group
            else np.empty((0, 4))
            for of_group in rings
        ]
        self._rings = rings
        self.segments: FloatArray = np.concatenate(pieces)
        self.offsets: NDArray[np.int64] = np.concatenate(
            ([0], np.cumsum([len(piece) for piece in pieces], dtype=np.int64))
        )
        self.circles: FloatArray = np.array([_circle(piece) for piece in pieces])

    def _grown(self, body: MovingObstacle, margin: float) -> BaseGeometry:
        """Inscribed polygon of a body grown by the margin; by less if the robot starts nearer."""
        points = body.outline_at(self._time)
        shape = shapely.MultiPoint(points).convex_hull if len(points) < 4 else shapely.Polygon(points)
        shape = shape if shape.is_valid else shape.buffer(0.0)
        least = float(shape.distance(self._start)) - _START_RESERVE
        return shape.buffer(min(body.radius + margin, least), quad_segs=_QUARTER_SEGMENTS)

    def _room(self, region: BaseGeometry, margin: float) -> BaseGeometry:
        least = float(region.boundary.distance(self._start)) - _START_RESERVE
        if not region.covers(self._start):
            raise InvalidInput(
                f"start ({self._start.x:.2f}, {self._start.y:.2f}) lies outside the workspace: move it inside"
            )
        return region.buffer(-max(min(margin, least), 0.0), quad_segs=_QUARTER_SEGMENTS)

    def corners(self) -> tuple[FloatArray, NDArray[np.int64], FloatArray, FloatArray]:
        """Corners that stick out into the free space (K, 2), their groups (K,), and directions to both neighbours."""
        found, owners = [np.empty((0, 6))], [np.empty(0, dtype=np.int64)]
        for group, rings in enumerate(self._rings):
            for ring in rings:
                back, ahead = np.roll(ring, 1, axis=0) - ring, np.roll(ring, -1, axis=0) - ring
                # Outlines run so that the body is on the left of bodies and the room on the left of a room.
                left = ahead[:, 0] * back[:, 1] - ahead[:, 1] * back[:, 0] > 0.0
                out = ~left if self.inverted[group] else left
                found.append(np.hstack((ring, back, ahead))[out])
                owners.append(np.full(int(out.sum()), group, dtype=np.int64))
        table = np.concatenate(found)
        back, ahead = (arm / np.linalg.norm(arm, axis=1)[:, None] for arm in (table[:, 2:4], table[:, 4:]))
        return table[:, :2], np.concatenate(owners), back, ahead


def _rings(shape: BaseGeometry) -> list[FloatArray]:
    """Rings of all polygons without the repeated point, what they enclose on the left."""
    polygons = [part for part in shapely.get_parts(shape) if isinstance(part, shapely.Polygon)]
    oriented = shapely.orient_polygons(
        np.array([part for part in polygons if not part.is_empty], dtype=object)
    )
    return [shapely.get_coordinates(ring)[:-1] for ring in shapely.get_rings(oriented)]


def _circle(segments: FloatArray) -> tuple[float, float, float]:
    """Centre and radius of a circle around segments (M, 4)."""
    if len(segments) == 0:
        return 0.0, 0.0, 0.0
    centre = 0.5 * (segments[:, :2].min(axis=0) + segments[:, :2].max(axis=0))
    return float(centre[0]), float(centre[1]), float(np.hypot(*(segments[:, :2] - centre).T).max())
