"""Candidates for one robot: at which distance to plan, along which ways."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from snnav_core.errors import GoalBlocked, GoalUnreachable, StartBlocked
from snnav_core.navigator.context import AreaContext, Disks
from snnav_core.navigator.settings import NavigatorSettings, RobotDistances
from snnav_core.planning.curves import AreaCurves
from snnav_core.planning.shortest import initial_circles
from snnav_core.planning.tangent_graph import Candidate, rule_candidates
from snnav_core.types import FloatArray, PathSource, Pose2D, RobotSpec

__all__ = ["Route", "find_route", "next_corner", "route_candidates", "shortest_way"]

_LEVELS = (1.0, 0.6, 0.3, 0.0)
_DETOUR = 1.02
_MAX_TRIED = 60
_AT_CORNER = 0.03  # [m]; a robot stops within about this of the corner that it drove to


@dataclass(frozen=True)
class Route:
    """Where a robot can plan: the curves of the area reduced by `distance` [m], and the target that it plans for."""

    curves: AreaCurves
    distance: float
    target: FloatArray
    start_inside: bool


def find_route(
    context: AreaContext,
    robot: RobotSpec,
    pose: Pose2D,
    goal: FloatArray,
    distances: RobotDistances,
    settings: NavigatorSettings,
    disks: Disks,
) -> Route:
    """Find the largest distance in [d_s, d_s + T delta V_max] at which start and target are connected (C3-12).

    Raises
    ------
    StartBlocked, GoalBlocked, GoalUnreachable
        Each with the value and the remedy.
    """
    start = pose.position
    present = context.clearance(start)
    if present < robot.radius:
        raise StartBlocked(
            f"robot {robot.id} at ({start[0]:.2f}, {start[1]:.2f}) has {present:.2f} m to the boundary of the "
            f"unoccupied area, less than its radius {robot.radius:.2f} m; free its surroundings or cover them by a "
            "sensor"
        )
    target = _reachable_target(context, robot, goal, distances, settings, disks)
    at_target = context.clearance(target)
    top = max(float(distances.demanded()[-1]), distances.turn_radius)
    for level in _LEVELS:
        distance = context.rounded(distances.tightest + level * (top - distances.tightest))
        if distance > at_target:
            continue
        curves = context.curves(distance, disks, target)
        if curves is None:
            continue
        inside = curves.covers(start)
        if inside or _can_climb(context, curves, start, present, distance, distances.tightest):
            return Route(curves, distance, target, inside)
    raise GoalUnreachable(
        f"robot {robot.id}: no way at {distances.tightest:.3f} m from the boundary leads from "
        f"({start[0]:.2f}, {start[1]:.2f}) to ({goal[0]:.2f}, {goal[1]:.2f}); widen what the sensors see or reduce "
        f"the safety margin ({settings.safety_margin:.2f} m)"
    )


def _reachable_target(
    context: AreaContext,
    robot: RobotSpec,
    goal: FloatArray,
    distances: RobotDistances,
    settings: NavigatorSettings,
    disks: Disks,
) -> FloatArray:
    """The goal itself, or the nearest point that can be planned for when that still counts as arrived."""
    clearance, tightest = context.clearance(goal), context.rounded(distances.tightest)
    outside_disks = all(math.hypot(goal[0] - x, goal[1] - y) > radius for x, y, radius in disks)
    if clearance >= 1.012 * tightest and outside_disks:
        return goal
    nearest = context.nearest_inside(goal, tightest, disks) if math.isfinite(clearance) else None
    if nearest is None or float(np.linalg.norm(nearest - goal)) > 0.8 * distances.arrival:
        raise GoalBlocked(
            f"target ({goal[0]:.2f}, {goal[1]:.2f}) of robot {robot.id} has {clearance:.2f} m to the boundary of the "
            f"unoccupied area, needs {distances.tightest:.3f} m (safety margin {settings.safety_margin:.2f} m); move "
            "the target or let a sensor see its surroundings"
        )
    return nearest


def _can_climb(
    context: AreaContext, curves: AreaCurves, start: FloatArray, present: float, distance: float, least: float
) -> bool:
    """Whether a robot that stands nearer than the planning distance can go straight to where that distance holds."""
    entry = curves.nearest(start)
    length = float(np.linalg.norm(entry - start))
    if length > 2.0 * max(distance - present, 0.0) + 0.1:
        return False
    line = start + np.linspace(0.0, 1.0, 9)[:, None] * (entry - start)
    return bool((context.area.clearance(line) >= min(present, least) - 1e-3).all())


def route_candidates(
    context: AreaContext,
    route: Route,
    pose: Pose2D,
    distances: RobotDistances,
    settings: NavigatorSettings,
) -> list[Candidate]:
    """Candidate paths, shortest first.

    The six rules come first. The complete search is added when the rules yield none, or when it is more than 2 %
    shorter than the best of them (deviation C3-25: the rules know tangents to the target only).
    """
    candidates: list[Candidate] = []
    if route.start_inside:
        candidates = rule_candidates(
            route.curves, pose, route.target, distances.circle_radius, 0.5 * distances.link
        )
    complete = _complete_candidates(context, route, pose, distances, settings)
    if complete and (not candidates or complete[0].length * _DETOUR < candidates[0].length):
        candidates = sorted(candidates + complete, key=lambda candidate: candidate.length)
    return candidates


def _complete_candidates(
    context: AreaContext, route: Route, pose: Pose2D, distances: RobotDistances, settings: NavigatorSettings
) -> list[Candidate]:
    tree = context.goal_tree(route.curves, route.target)
    demanded = np.minimum(distances.demanded(), route.distance)
    climb = 0.0
    if not route.start_inside:
        climb = 2.0 * (route.distance - context.clearance(pose.position)) + 2.0 * distances.circle_radius
    found: list[Candidate] = []
    for circle in initial_circles(pose, distances.circle_radius):
        for tried, (length, angle, chain) in enumerate(tree.options(circle, climb)):
            if tried >= _MAX_TRIED or (found and length > 1.5 * found[0].length):
                break
            arc = circle.arc(angle, 0.5 * distances.link)
            if not _is_clear(context, np.vstack((arc, chain[1:2])), demanded, route, distances, settings):
                continue
            polyline = np.vstack((arc, chain[1:]))
            found.append(Candidate(polyline, circle.rotation, PathSource.SHORTEST_PATH, length))
            break
    return sorted(found, key=lambda candidate: candidate.length)


def _is_clear(
    context: AreaContext,
    polyline: FloatArray,
    demanded: FloatArray,
    route: Route,
    distances: RobotDistances,
    settings: NavigatorSettings,
) -> bool:
    """Whether an arc with the straight line behind it keeps the distance that adjustment needs to start from."""
    lengths = np.linalg.norm(np.diff(polyline, axis=0), axis=1)
    along = np.concatenate(([0.0], np.cumsum(lengths)))
    stations = np.linspace(0.0, along[-1], max(2, math.ceil(along[-1] / (0.5 * distances.link)) + 1))
    points = np.stack([np.interp(stations, along, polyline[:, axis]) for axis in range(2)], axis=-1)
    # Nothing more is needed; the chain starts inside and cannot get outside unnoticed.
    clearance = context.area.clearance(points, route.distance + distances.link)
    index = np.minimum((stations / distances.link).astype(np.int64), len(demanded) - 1)
    # The reduced area was simplified: what follows its boundary is as much nearer at most. Chords take their share.
    needed = np.minimum(demanded[index], route.distance) - 0.5 * distances.link
    needed = np.maximum(needed, 0.9 * settings.safety_margin)
    present = float(clearance[0])
    if present < route.distance:
        climbing = stations <= 2.0 * (route.distance - present) + 3.0 * distances.circle_radius
        needed[climbing] = np.minimum(needed[climbing], min(present, settings.safety_margin) - 1e-3)
    return bool((clearance >= needed).all())


def next_corner(context: AreaContext, route: Route, pose: Pose2D) -> FloatArray | None:
    """Where the shortest way to the target bends first, (2,) [m, map], when the present heading does not matter.

    None when the target cannot be reached, or the robot is there.
    """
    way = shortest_way(context, route, pose)
    if way is None:
        return None
    ahead: FloatArray = way[np.linalg.norm(way - pose.position, axis=1) > _AT_CORNER]
    return ahead[0] if len(ahead) else None


def shortest_way(context: AreaContext, route: Route, pose: Pose2D) -> FloatArray | None:
    """The shortest way to the target whatever the present heading, (N, 2) [m, map], N >= 2; None without any."""
    start = pose.position
    entry = start if route.start_inside else route.curves.nearest(start)
    chain = context.goal_tree(route.curves, route.target).from_point(entry)
    return None if chain is None else np.vstack((start, chain))
