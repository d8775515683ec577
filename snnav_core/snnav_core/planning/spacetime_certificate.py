"""The independent check of a path in space-time: nothing is handed to a robot that this module did not accept.

It shares no code with the planner. In the frame of a body in uniform motion every link of a path is a straight segment,
so that its least distance from the body over the whole link is exact, by shapely.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from snnav_core.obstacles import MovingObstacle
from snnav_core.planning.boundary_index import BoundaryIndex
from snnav_core.planning.drivable import least_radius, place, shape_fault
from snnav_core.planning.spacetime_problem import OtherRobot, SpacetimeProblem, SpacetimeSettings
from snnav_core.planning.workspace import workspace_region
from snnav_core.types import Certificate, FloatArray, TimedPath

__all__ = ["DEVIATIONS", "certify_in_spacetime"]

DEVIATIONS = 3.0
"""Up to `valid_until` nothing is touched should every body be off by so many of its standard deviations."""

_ROUNDING = 1e-9  # [m]
_STALL = 1e-6  # [m] to the demand: a body that comes so near has come
_ADVANCES = 200  # of a body towards a robot that stands, at most
_REACH = 1e7  # [s]: nothing is foretold beyond


def certify_in_spacetime(
    path: TimedPath, problem: SpacetimeProblem, settings: SpacetimeSettings
) -> Certificate:
    """Check a path among bodies in uniform motion (Ch. 2, "collision-free path" and the non-holonomic constraint).

    Parameters
    ----------
    path : TimedPath
        Starts at the robot, at any time (a plan that is under way is checked again from where the robot is); with
        `turn_to` the robot stands and turns.
    problem : SpacetimeProblem
    settings : SpacetimeSettings

    Returns
    -------
    Certificate
        `accepted` only if for all times of the path, along its links and not at its points only, the centre of the
        robot keeps d_s + tracking tolerance from every body and from the border of the workspace, and from every
        other robot its `distance` + twice the tolerance (both may be off their paths), also from those who pass the
        end of the path later; links, one by one and together (a robot at its speed is nowhere behind its timed path
        by more than the tolerance), circumscribed radii (C0-9), start and arrival (C0-16) hold.
        `valid_until`: until then the robot may follow the path and stand at its end [s], see Notes.
        `least_clearance`: to bodies and workspace [m]; `least_separation`: to the centres of other robots [m]; both
        over the whole path, infinite without any.

    Notes
    -----
    Deviations: links instead of points (C0-7). A robot that starts closer to a body than demanded (it may have come as
    near as it is off its path) comes no nearer to it, and keeps what is demanded once it has it (C3-13); that takes it
    no longer than one sampling interval and what it lacks at half the robot's speed.

    What is promised is promised for bodies in uniform motion. The margin does not grow with their deviations: no path
    is long that keeps clear of all that a body could do. Who measures grows `MovingObstacle.radius` by the offset that
    is tolerated before a new plan is made; the margin then holds until that offset is left. The deviations limit
    `valid_until` instead: up to it the robot touches nothing (its radius instead of d_s) should a body be off by
    `DEVIATIONS` standard deviations of its position and velocity. It ends as well when a body comes nearer than
    demanded to the robot that stands at its end (C2-14).
    """
    check = _Check(path, problem, settings)
    reason = shape_fault(path, problem, settings) or check.fault()
    return Certificate(
        robot_id=problem.robot.id,
        accepted=not reason,
        valid_until=check.valid_until() if not reason else path.start_time,
        least_clearance=check.least_clearance,
        least_separation=min((gap.least for gap in check.gaps), default=math.inf),
        least_radius=least_radius(path),
        area_stamp=problem.start_time,
        path_digest=path.digest(),
        reason=reason,
    )


@dataclass(frozen=True)
class _Pieces:
    """Parts of the path that are straight in space-time: times (M, 2) [s] and ends (M, 2, 2) [m, map]."""

    times: FloatArray
    ends: FloatArray

    def seen_from(self, body: MovingObstacle) -> FloatArray:
        """Ends in the frame of a body, where the outline is: shape (M, 2, 2) [m]."""
        return self.ends - body.velocity * (self.times - body.stamp)[..., None]


@dataclass(frozen=True)
class _Gap:
    """How near another robot comes: least distance [m], while the path lasts, and the first failure."""

    least: float
    failure: tuple[float, str] | None


class _Check:
    """One path under check."""

    def __init__(self, path: TimedPath, problem: SpacetimeProblem, settings: SpacetimeSettings) -> None:
        self.path, self.problem, self.settings = path, problem, settings
        self.robot = problem.robot
        self.points: FloatArray = np.asarray(path.points[:, :2])
        # when the robot is at the end if it drives the last link, which may be shorter, at full speed
        last = math.dist(*self.points[-2:].tolist()) if len(self.points) > 1 else 0.0
        links = max(len(self.points) - 2, 0)
        self.early = min(path.end_time, path.start_time + links * path.step + last / self.robot.speed)
        self.pieces = self._pieces()
        self.margin = settings.safety_margin + settings.tracking_tolerance
        self.gaps = [self._gap(other) for other in problem.others]

    def _pieces(self) -> _Pieces:
        """All links; the last one also driven at full speed and then stood at its end."""
        count = len(self.points)
        knots = self.path.start_time + self.path.step * np.arange(count)
        if count == 1:
            return _Pieces(np.array([[knots[0], knots[0]]]), self.points[[0, 0]][None])
        times = np.column_stack((knots[:-1], knots[1:]))
        ends = np.stack((self.points[:-1], self.points[1:]), axis=1)
        if self.early < times[-1, 1]:
            times = np.vstack((times, [[times[-1, 0], self.early], [self.early, times[-1, 1]]]))
            ends = np.concatenate((ends, [ends[-1], ends[-1, [1, 1]]]))
        return _Pieces(times, ends)

    @cached_property
    def bodies(self) -> list[BaseGeometry]:
        """Outlines at their stamps; one that crosses itself counts as its convex hull."""
        return [_geometry(body.outline) for body in self.problem.obstacles]

    @cached_property
    def distances(self) -> FloatArray:
        """Least distance of every piece from every body, shape (B, M) [m].

        Infinite where it is more than any demand and more than the least of all: those are not worked out.
        """
        obstacles, count = self.problem.obstacles, len(self.pieces.times)
        if not obstacles:
            return np.full((0, count), math.inf)
        radii = np.array([body.radius for body in obstacles])[:, None]
        seen = np.stack([self.pieces.seen_from(body) for body in obstacles])
        first = np.stack([body.outline[0] for body in obstacles])[:, None]
        size = np.array([np.hypot(*(body.outline - body.outline[0]).T).max() for body in obstacles])[:, None]
        middle = np.hypot(*np.moveaxis(seen.mean(axis=2) - first, 2, 0)) - radii
        halves = 0.5 * np.hypot(*np.moveaxis(seen[:, :, 1] - seen[:, :, 0], 2, 0))
        enough = np.maximum(self.margin + self._doubts, float(middle.min())) + _STALL
        near = middle - size - halves <= enough
        which = np.nonzero(near)[0]
        result = np.full((len(obstacles), count), math.inf)
        geometries: NDArray[np.object_] = np.empty(len(obstacles), dtype=object)
        geometries[:] = self.bodies
        result[near] = shapely.distance(_lines(seen[near]), geometries[which]) - radii[which, 0]
        return result

    @cached_property
    def _doubts(self) -> FloatArray:
        """By how much bodies may be elsewhere at the end of every piece, shape (B, M) [m]."""
        obstacles = self.problem.obstacles
        offset = np.array([body.position_deviation for body in obstacles])[:, None]
        speed = np.array([body.velocity_deviation for body in obstacles])[:, None]
        stamps = np.array([body.stamp for body in obstacles])[:, None]
        age = np.abs(self.pieces.times[:, 1] - stamps)
        doubts: FloatArray = DEVIATIONS * (offset + speed * age)
        return doubts

    @cached_property
    def walls(self) -> FloatArray:
        """Least distance of every piece from the border of the workspace (M,) [m], 0 outside; infinite if none."""
        rings = self.problem.workspace
        if rings is None:
            return np.full(len(self.pieces.times), math.inf)
        return BoundaryIndex(workspace_region(rings)).distances(self.pieces.ends)

    @property
    def least_clearance(self) -> float:
        """Least distance of the whole path from bodies and workspace [m]."""
        return float(min(self.distances.min(initial=math.inf), self.walls.min()))

    def _kept(self, distances: FloatArray, begins: FloatArray, margin: float, at_start: float) -> FloatArray:
        """What successive distances from the times `begins` [s] on must be [m]."""
        if not 0.0 < at_start < margin:
            return np.full(len(distances), margin - _ROUNDING)
        patience = self.settings.sampling_interval + 2.0 * (margin - at_start) / self.robot.speed
        late = begins >= self.path.start_time + patience
        reached = late | (np.maximum.accumulate(distances) >= margin)
        return np.where(reached, margin, at_start) - _ROUNDING

    def fault(self) -> str:
        """What comes too near first, or an empty string."""
        failures = [gap.failure for gap in self.gaps if gap.failure is not None]
        begins = self.pieces.times[:, 0]
        for index, body in enumerate(self.problem.obstacles):
            row = self.distances[index]
            start = self.pieces.seen_from(body)[0, 0]
            at_start = float(shapely.distance(shapely.Point(start), self.bodies[index])) - body.radius
            demanded = self._kept(row, begins, self.margin, at_start)
            if (row < demanded).any():
                failures.append(self._failure(index, int(np.argmax(row < demanded)), demanded))
        if self.problem.workspace is not None:
            region = workspace_region(self.problem.workspace)
            at_start = float(region.boundary.distance(shapely.Point(self.points[0])))
            demanded = self._kept(self.walls, begins, self.margin, at_start)
            wrong = (self.walls < demanded) | (self.walls <= 0.0)
            if wrong.any():
                first = int(np.argmax(wrong))
                where = self.pieces.ends[first].mean(axis=0)
                text = f"{self.walls[first]:.3f} m from the border of the workspace"
                failures.append(self._told(text, where, self.pieces.times[first, 0], demanded[first]))
        return min(failures)[1] if failures else ""

    def _failure(self, index: int, piece: int, demanded: FloatArray) -> tuple[float, str]:
        body, seen = (
            self.problem.obstacles[index],
            self.pieces.seen_from(self.problem.obstacles[index])[piece],
        )
        way, line = seen[1] - seen[0], _lines(seen[None])[0]
        nearest = shapely.get_coordinates(shapely.shortest_line(line, self.bodies[index]))[0]
        share = float(np.clip((nearest - seen[0]) @ way / max(float(way @ way), 1e-18), 0.0, 1.0))
        (begin, end), (here, there) = self.pieces.times[piece], self.pieces.ends[piece]
        text = f"{self.distances[index, piece]:.3f} m from body {body.id}"
        where, time = here + share * (there - here), begin + share * (end - begin)
        return self._told(text, where, time, demanded[piece])

    def _told(self, text: str, where: FloatArray, time: float, demanded: float) -> tuple[float, str]:
        after = time - self.path.start_time
        return time, f"{text} at {place(where)} after {after:.2f} s, demanded {demanded:.3f} m"

    def _gap(self, other: OtherRobot) -> _Gap:
        """Compare with a robot, up to the later end of both; between common knots both move uniformly."""
        path, limit = self.path, other.distance + 2.0 * self.settings.tracking_tolerance
        own_knots, knots = (p.start_time + p.step * np.arange(len(p)) for p in (path, other.path))
        times = np.unique(np.concatenate((own_knots, [self.early], knots[knots > path.start_time])))
        theirs = other.path.positions_at(times)[:, :2]
        own = path.positions_at(times)[:, :2]
        quick = np.where((times >= self.early)[:, None], self.points[-1], own)
        if len(own_knots) > 1:
            inside = (times > own_knots[-2]) & (times < self.early)
            share = (times[inside] - own_knots[-2]) / (self.early - own_knots[-2])
            quick[inside] = self.points[-2] + share[:, None] * (self.points[-1] - self.points[-2])
        nearest = np.minimum(_least_norms(own - theirs), _least_norms(quick - theirs))
        within = times[:-1] < path.end_time if len(times) > 1 else np.ones(1, dtype=np.bool_)
        at_start = math.dist(own[0], theirs[0])
        demanded = self._kept(nearest, times[: len(nearest)], limit, at_start)
        least = float(nearest[within].min(initial=at_start))
        wrong = nearest < demanded
        if not wrong.any():
            return _Gap(least, None)
        first = int(np.argmax(wrong))
        text = f"{nearest[first]:.3f} m from robot {other.id}"
        return _Gap(least, self._told(text, own[first], float(times[first]), float(demanded[first])))

    def valid_until(self) -> float:
        """Until when a path without fault holds [s]."""
        obstacles = self.problem.obstacles
        touch = min(self.margin, self.robot.radius + self.settings.tracking_tolerance)
        doubtful = (self._doubts > 0.0) & (self.distances < touch + self._doubts)
        ends = [float(self.pieces.times[np.nonzero(doubtful)[1], 0].min())] if doubtful.any() else []
        ends += [
            self._comes_at(body, geometry, touch)
            for body, geometry in zip(obstacles, self.bodies, strict=True)
        ]
        return max(self.path.start_time, min(ends, default=math.inf))

    def _comes_at(self, body: MovingObstacle, geometry: BaseGeometry, touch: float) -> float:
        """When a body comes too near to the robot at the end of its path [s]: not later than that.

        The body is moved on by what it is away, again and again, so that it never gets there unnoticed.
        """
        end, time = self.points[-1], self.path.end_time
        doubt_speed = DEVIATIONS * body.velocity_deviation
        closing = body.speed + doubt_speed
        if closing == 0.0:
            return math.inf
        for _ in range(_ADVANCES):
            if time > _REACH + self.path.end_time:
                return math.inf
            centre = shapely.Point(end - body.velocity * (time - body.stamp))
            distance = float(shapely.distance(centre, geometry)) - body.radius
            doubt = DEVIATIONS * body.position_deviation + doubt_speed * abs(time - body.stamp)
            left = min(distance - self.margin, distance - doubt - touch if doubt > 0.0 else math.inf)
            if left <= _STALL:
                return time
            time += left / closing
        return time


def _geometry(outline: FloatArray) -> BaseGeometry:
    if len(outline) == 1:
        return shapely.Point(outline[0])
    if len(outline) == 2:
        return shapely.LineString(outline)
    polygon = shapely.Polygon(outline)
    return polygon if polygon.is_valid else shapely.convex_hull(shapely.MultiPoint(outline))


def _lines(segments: FloatArray) -> NDArray[np.object_]:
    """Segments (N, 2, 2) as geometries; for shapely two equal points are a line of no length."""
    lines: NDArray[np.object_] = shapely.linestrings(segments)
    return lines


def _least_norms(offsets: FloatArray) -> FloatArray:
    """Distance of the origin from every link of a chain (N, 2), shape (N - 1,); of its point when N is 1."""
    if len(offsets) == 1:
        distances: FloatArray = np.linalg.norm(offsets, axis=1)
        return distances
    first, way = offsets[:-1], np.diff(offsets, axis=0)
    square = np.einsum("ij,ij->i", way, way)
    share = np.clip(-np.einsum("ij,ij->i", first, way) / np.maximum(square, 1e-300), 0.0, 1.0)
    least: FloatArray = np.linalg.norm(first + share[:, None] * way, axis=1)
    return least
