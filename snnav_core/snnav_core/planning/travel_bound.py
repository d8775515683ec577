"""A lower bound of the travel time among bodies in uniform motion: the earliest arrival of a point in their gaps."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from snnav_core.errors import InvalidInput
from snnav_core.obstacles import MovingObstacle
from snnav_core.planning.spacetime_problem import SpacetimeProblem, TravelBound
from snnav_core.planning.travel_bound_kernel import START, TARGET, earliest_arrivals, free_intervals, nodes_of
from snnav_core.planning.workspace import workspace_region
from snnav_core.types import FloatArray

__all__ = ["travel_bound"]

_QUARTER_SEGMENTS = 8  # chords of a quarter arc; a way round it is short by 0.16 %
_SAME = 1e-6  # [m/s]; velocities that differ by less are one
_APART = 1e-7  # of the margin: outlines that touch by chance do not
_SLOWER = 0.999  # of the robot's speed: what is faster counts as absent
_START_RESERVE = 1e-6  # [m]
_INSTANT = 1e-9  # [s]
_OFF = 1e-5  # [m] from an outline
_EVER = 1e300  # [s]
_SLACK = 1e-3  # [s]; more than a robot needs for that


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
    counts with what it leaves; and where a body lays bare the corner of another one, the robot may have waited if it
    can have been there without that other one.

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
    places, owners, before, after = world.corners()
    nodes = _Nodes(
        np.vstack((start, target, places)),
        np.concatenate(([-1, -1], owners)),
        np.vstack((np.zeros((2, 2)), before)),
        np.vstack((np.zeros((2, 2)), after)),
    )
    route = _quickest(_Intervals(nodes, world, -1), speed)
    if len(route) == 0:
        return TravelBound(math.inf, route, left_out)
    time = float(route[-1, 2])
    route[:, 2] += problem.start_time
    return TravelBound(time, route, left_out)


@dataclass(frozen=True)
class _Nodes:
    """Start, target, corners: places at the start time (K, 2), groups (K,), directions to neighbours (K, 2)."""

    places: FloatArray
    owners: NDArray[np.int64]
    before: FloatArray
    after: FloatArray

    def without(self, group: int) -> _Nodes:
        """All nodes but the corners of a group; -1 for none."""
        kept = np.flatnonzero((self.owners != group) | (self.owners < 0))
        return _Nodes(self.places[kept], self.owners[kept], self.before[kept], self.after[kept])

    def joined(self, places: FloatArray, owners: NDArray[np.int64]) -> _Nodes:
        """With places that are no corners behind."""
        flat = np.zeros((len(places), 2))
        return _Nodes(
            np.vstack((self.places, places)),
            np.concatenate((self.owners, owners)),
            np.vstack((self.before, flat)),
            np.vstack((self.after, flat)),
        )


class _Intervals:
    """When every node is free of all groups but its own, and the search over these."""

    def __init__(self, nodes: _Nodes, world: _World, absent: int) -> None:
        self.nodes, self.world, self.absent = nodes, world, absent
        self.spans, self.first, self.left = free_intervals(
            nodes.places,
            nodes.owners,
            world.velocities,
            world.segments,
            world.offsets,
            world.inverted,
            absent,
        )

    @property
    def waits(self) -> NDArray[np.int64]:
        """Intervals that begin because something lays their node bare."""
        return np.flatnonzero((self.spans[:, 0] > _INSTANT) & (nodes_of(self.first) >= TARGET))

    def place(self, label: int | NDArray[np.int64], time: float | FloatArray) -> FloatArray:
        """Where the nodes of intervals are at times (N,) [s]: (N, 2) [m, map]."""
        node = nodes_of(self.first)[label]
        moved = self.world.velocities[self.nodes.owners[node]] * np.asarray(time)[..., None]
        where: FloatArray = self.nodes.places[node] + np.where(
            self.nodes.owners[node][..., None] >= 0, moved, 0.0
        )
        return where

    def search(
        self, speed: float, waits: NDArray[np.int64], through: int, until: float
    ) -> tuple[FloatArray, NDArray[np.int64]]:
        """Earliest arrivals, see `earliest_arrivals`; `waits` are the intervals for whose begin a robot may wait."""
        nodes, world, begins = self.nodes, self.world, self.spans[:, 0]
        way = np.linalg.norm(self.place(waits, begins[waits]) - nodes.places[START], axis=1)
        seeds = waits[way <= speed * begins[waits]]
        if self.first[1] > 0 and begins[0] <= _INSTANT:
            seeds = np.append(seeds, 0)
        reached, parents = earliest_arrivals(
            (nodes.places, nodes.owners, nodes.before, nodes.after),
            (world.velocities, world.segments, world.offsets, world.circles),
            self.spans,
            self.first,
            speed,
            seeds,
            through,
            until,
            self.absent,
        )
        return reached, parents

    def labels(self, reached: FloatArray, parents: NDArray[np.int64]) -> list[int]:
        """Intervals on the way to the target, the last one first; none if there is no way."""
        ends = np.arange(self.first[TARGET], self.first[TARGET + 1])
        if len(ends) == 0 or not np.isfinite(reached[ends]).any():
            return []
        labels = [int(ends[np.argmin(reached[ends])])]
        while parents[labels[-1]] >= 0:
            labels.append(int(parents[labels[-1]]))
        return labels


def _quickest(times: _Intervals, speed: float) -> FloatArray:
    """Places and times (N, 3) of the quickest way; empty if there is none.

    First a robot may wait for all that is laid bare. If the way begins so, those of the same group are looked at
    closely, and it is sought again.
    """
    waits, looked_at = times.waits, set[int]()
    while True:
        reached, parents = times.search(speed, waits, len(times.nodes.places), _EVER)
        labels = times.labels(reached, parents)
        if not labels:
            return np.empty((0, 3))
        node = int(nodes_of(times.first)[labels[-1]])
        group = int(times.nodes.owners[node])
        if node == START or group in looked_at:
            break
        looked_at.add(group)
        waits = _possible(times, waits, group, float(reached[labels[0]]), speed)
    order = np.array(labels[::-1])
    way = np.column_stack((times.place(order, reached[order]), reached[order]))
    return way if node == START else np.vstack(([*times.nodes.places[START], 0.0], way))


def _possible(
    times: _Intervals, waits: NDArray[np.int64], group: int, until: float, speed: float
) -> NDArray[np.int64]:
    """Those intervals for whose begin a robot may wait, without what it cannot do for the nodes of one group.

    When a body lays a node bare, the robot must be at that place on the outline of the body. This place is a node of
    its own, which moves with the body. The group of the node that is laid bare may cover it before: it counts as
    absent, which opens ways and closes none.
    """
    owners = times.nodes.owners[nodes_of(times.first)[waits]]
    asked = waits[(owners == group) & (times.spans[waits, 0] <= until)]
    bodies, velocities = times.left[asked], times.world.velocities
    away = (velocities[group] if group >= 0 else 0.0) - velocities[bodies]
    # a little way off the outline
    moments = times.spans[asked, 0] + _OFF / np.maximum(np.linalg.norm(away, axis=1), _SAME)
    spots = times.place(asked, moments) - velocities[bodies] * moments[:, None]
    rest = times.nodes.without(group)
    there = _Intervals(rest.joined(spots, bodies), times.world, group)
    through = len(rest.places)
    reached, _ = there.search(speed, there.waits, through, float(moments.max()) + 2.0 * _SLACK)
    refused = []
    for label, spot, moment in zip(asked, range(through, through + len(asked)), moments, strict=True):
        spans = slice(there.first[spot], there.first[spot + 1])
        holds = (there.spans[spans, 0] <= moment) & (moment <= there.spans[spans, 1])
        if holds.any() and not (reached[spans][holds] <= moment + _SLACK).any():
            refused.append(label)
    return np.setdiff1d(waits, refused)


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
