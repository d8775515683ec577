"""Random problems for the global planner in space-time: each depends on its kind and seed only."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from snnav_core.obstacles import MovingObstacle
from snnav_core.planning.spacetime_problem import SpacetimeProblem, SpacetimeSettings
from snnav_core.types import FloatArray, Pose2D, RobotSpec
from snnav_sim.campaign.halls import Draws, between

__all__ = ["SpacetimeCase", "dynamic_case", "static_case"]

_STREAM = 0x57AC3  # keeps these random numbers apart from those of campaigns
_TRIES = 500
_RESERVE = 0.05  # [m] that start and target are farther from everything than they must be
_WAY = 0.5  # from start to target at least, as a share of the root of the area
_STRAIGHT = 0.1  # share of the draws with nothing in the straight way that are kept
_APART = 0.5  # share of the dynamic problems whose grown bodies never overlap (Ch. 2, assumption)
_LASTING = 20.0  # straight ways: for so long nothing comes to the target
_FASTEST = 0.8  # of the robot's speed


@dataclass(frozen=True)
class SpacetimeCase:
    """A problem, and the settings that it is to be solved with."""

    problem: SpacetimeProblem
    settings: SpacetimeSettings

    @property
    def margin(self) -> float:
        """What a path must keep from bodies and workspace [m]."""
        return self.settings.safety_margin + self.settings.tracking_tolerance


def static_case(seed: int) -> SpacetimeCase:
    """Return a hall with one to twelve bodies that stand, non-convex ones among them, and may overlap.

    Whether there is a way is left to chance.
    """
    draws = np.random.default_rng([_STREAM, 0, seed])
    for _ in range(_TRIES):
        case = _draw_static(draws)
        if case is not None:
            return case
    raise RuntimeError(f"no static problem with seed {seed} in {_TRIES} tries")


def dynamic_case(seed: int) -> SpacetimeCase:
    """Return an open plane or a hall with one to twelve bodies, most of them in uniform motion.

    Notes
    -----
    They are free to leave the hall and, in half of the problems, to pass through each other. None comes near the
    target while the robot may be there; any may come over the start once the robot has left.
    Their speed is limited as in Ch. 2: a robot that runs along the grown corner of a body at the share beta of its
    speed turns with (1 + beta)^2 times the rate (C2-2).
    """
    draws = np.random.default_rng([_STREAM, 1, seed])
    for _ in range(_TRIES):
        case = _draw_dynamic(draws)
        if case is not None:
            return case
    raise RuntimeError(f"no dynamic problem with seed {seed} in {_TRIES} tries")


def _robot(draws: Draws) -> tuple[RobotSpec, SpacetimeSettings]:
    speed = between(draws, 0.3, 1.0)
    settings = SpacetimeSettings(
        sampling_interval=round(0.15 / speed, 3), safety_margin=between(draws, 0.5, 0.9)
    )
    turn_radius = between(draws, 0.15, 0.3)
    return RobotSpec("robot_1", 0.25, speed, round(speed / turn_radius, 3)), settings


def _draw_static(draws: Draws) -> SpacetimeCase | None:
    robot, settings = _robot(draws)
    width, depth = between(draws, 8.0, 20.0, 1), between(draws, 8.0, 20.0, 1)
    hall = _hall(width, depth)
    bodies = []
    for number in range(int(draws.integers(1, 13))):
        outline, radius = _shape(draws)
        place = draws.uniform(0.0, 1.0, 2) * (width, depth)
        bodies.append(MovingObstacle(f"body_{number + 1}", (outline + place).round(3), radius))
    solid = shapely.union_all([_solid(body) for body in bodies])
    keep = settings.safety_margin + settings.tracking_tolerance + _RESERVE
    free = shapely.Polygon(hall).difference(solid).buffer(-keep)
    start, target = _place(draws, free), _place(draws, free)
    if start is None or target is None or math.dist(start, target) < _WAY * math.sqrt(width * depth):
        return None
    return _case(draws, robot, settings, start, target, tuple(bodies), (hall,))


def _draw_dynamic(draws: Draws) -> SpacetimeCase | None:
    robot, settings = _robot(draws)
    width, depth = between(draws, 8.0, 20.0, 1), between(draws, 8.0, 20.0, 1)
    hall = _hall(width, depth)
    keep = settings.safety_margin + settings.tracking_tolerance + _RESERVE
    ends = shapely.Polygon(hall).buffer(-keep)
    start, target = _place(draws, ends), _place(draws, ends)
    if start is None or target is None or math.dist(start, target) < _WAY * math.sqrt(width * depth):
        return None
    lasting = _LASTING * math.dist(start, target) / robot.speed
    beta = min(_FASTEST, math.sqrt(keep / robot.min_turn_radius) - 1.0)
    apart = draws.random() < _APART
    bodies: list[MovingObstacle] = []
    wanted = int(draws.integers(1, 13))
    for _ in range(10 * wanted):
        body = _mover(draws, f"body_{len(bodies) + 1}", (width, depth), beta * robot.speed)
        crowded = apart and any(_approach(body, other, lasting) < 2.0 * keep for other in bodies)
        if not crowded and _spares(body, start, 0.0, keep) and _spares(body, target, lasting, keep):
            bodies.append(body)
        if len(bodies) == wanted:
            break
    if not bodies:
        return None
    walls = (hall,) if draws.random() < 0.5 else None
    return _case(draws, robot, settings, start, target, tuple(bodies), walls)


def _case(
    draws: Draws,
    robot: RobotSpec,
    settings: SpacetimeSettings,
    start: tuple[float, float],
    target: tuple[float, float],
    bodies: tuple[MovingObstacle, ...],
    workspace: tuple[FloatArray, ...] | None,
) -> SpacetimeCase | None:
    pose = Pose2D(*start, between(draws, -math.pi, math.pi))
    case = SpacetimeCase(
        SpacetimeProblem(robot, pose, 0.0, np.array(target), bodies, (), workspace), settings
    )
    return case if _bends(case) or draws.random() < _STRAIGHT else None


def _bends(case: SpacetimeCase) -> bool:
    """Whether a body is in the straight way of the robot."""
    start, target = case.problem.start.position, case.problem.target
    lasting = math.dist(start, target) / case.problem.robot.speed
    return any(
        _solid(body).distance(shapely.LineString([start, target - body.velocity * lasting])) < case.margin
        for body in case.problem.obstacles
    )


def _hall(width: float, depth: float) -> FloatArray:
    return np.array([(0.0, 0.0), (width, 0.0), (width, depth), (0.0, depth)])


def _mover(draws: Draws, name: str, size: tuple[float, float], fastest: float) -> MovingObstacle:
    outline, radius = _shape(draws)
    place = draws.uniform(0.0, 1.0, 2) * size
    # towards somewhere in the middle: not away from everything at once
    way = draws.uniform(0.2, 0.8, 2) * size - place
    speed = 0.0 if draws.random() < 0.2 else draws.uniform(0.1, 1.0) * fastest
    velocity = speed * way / max(math.hypot(*way), 1e-9)
    return MovingObstacle(name, (outline + place).round(3), radius, velocity.round(3))


def _shape(draws: Draws) -> tuple[FloatArray, float]:
    """Outline about the origin, and radius [m]: a disk, a crate, a bar, an L, a U or something with 4 to 8 corners."""
    sort = draws.integers(6)
    if sort == 0:
        return np.zeros((1, 2)), between(draws, 0.2, 0.9)
    if sort == 1:
        return _turned(
            draws, np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * draws.uniform(0.2, 1.0, 2)
        ), 0.0
    if sort == 2:
        half = draws.uniform(0.4, 1.5)
        return _turned(draws, np.array([(-half, 0.0), (half, 0.0)])), between(draws, 0.1, 0.3)
    long, wide, thick = draws.uniform(1.0, 2.6), draws.uniform(1.0, 2.6), draws.uniform(0.2, 0.5)
    if sort == 3:
        corners = [(0, 0), (long, 0), (long, thick), (thick, thick), (thick, wide), (0, wide)]
        return _turned(draws, np.array(corners) - (0.5 * long, 0.5 * wide)), 0.0
    if sort == 4:
        corners = [(0, 0), (long, 0), (long, wide), (long - thick, wide), (long - thick, thick)]
        corners += [(thick, thick), (thick, wide), (0, wide)]
        return _turned(draws, np.array(corners) - (0.5 * long, 0.5 * wide)), 0.0
    count = int(draws.integers(4, 9))
    angles = 2.0 * math.pi * (np.arange(count) + draws.uniform(0.0, 0.6, count)) / count
    reach = draws.uniform(0.3, 1.4, count)
    return np.column_stack((reach * np.cos(angles), reach * np.sin(angles))), 0.0


def _turned(draws: Draws, points: FloatArray) -> FloatArray:
    angle = draws.uniform(0.0, 2.0 * math.pi)
    cosine, sine = math.cos(angle), math.sin(angle)
    turned: FloatArray = points @ np.array([[cosine, sine], [-sine, cosine]])
    return turned


def _solid(body: MovingObstacle) -> BaseGeometry:
    """A body where its outline is, arcs by fine chords."""
    few = len(body.outline) < 3
    shape = shapely.MultiPoint(body.outline).convex_hull if few else shapely.Polygon(body.outline)
    return shape.buffer(body.radius, quad_segs=24) if body.radius else shape


def _place(draws: Draws, free: BaseGeometry) -> tuple[float, float] | None:
    """A random point of a region, to the millimetre; None where there is none soon."""
    if free.is_empty:
        return None
    west, south, east, north = free.bounds
    for _ in range(20):
        x, y = round(float(draws.uniform(west, east)), 3), round(float(draws.uniform(south, north)), 3)
        if shapely.contains_xy(free, x, y):
            return x, y
    return None


def _spares(body: MovingObstacle, point: tuple[float, float], lasting: float, keep: float) -> bool:
    """Whether a body stays away from a point [m] for a time [s]."""
    seen = shapely.LineString([point, np.array(point) - body.velocity * lasting])
    return bool(_solid(body).distance(seen) >= keep)


def _approach(body: MovingObstacle, other: MovingObstacle, lasting: float) -> float:
    """Least distance of two bodies within a time [m], not more than it is."""
    shape, relative = _solid(body), (body.velocity - other.velocity) * lasting
    moved = shapely.affinity.translate(shape, *relative)
    swept = shapely.union_all([shape, moved]).convex_hull
    return float(swept.distance(_solid(other)))
