"""Typed reasons why no path can be planned in space-time: who is in the way, where and when."""

from __future__ import annotations

import math

import shapely
from shapely.geometry.base import BaseGeometry

from snnav_core.errors import GoalBlocked, GoalUnreachable, StartBlocked
from snnav_core.planning.spacetime_bodies import distance
from snnav_core.planning.spacetime_problem import SpacetimeProblem
from snnav_core.planning.spacetime_world import BORDER, Layout
from snnav_core.planning.workspace import workspace_region

__all__ = ["check_ends", "unreachable"]

_MOST_NAMES = 6
_TOUCHING = 1e-6  # [m]


def check_ends(problem: SpacetimeProblem, layout: Layout) -> None:
    """See that robot and target have room.

    Raises
    ------
    StartBlocked
        If something is nearer to the robot than its own radius.
    GoalBlocked
        If something is nearer to the target than the margin while the robot may be there: from the time at which it
        could be there at the earliest to that of the longest candidate (C2-14).
    """
    kept, margins, start = layout.world.kept, layout.margins, problem.start
    for body, close in enumerate(kept[:, 1]):
        if close < min(problem.robot.radius, margins[body]):
            raise StartBlocked(
                f"robot {problem.robot.id} at ({start.x:.2f}, {start.y:.2f}) is {close:.2f} m from "
                f"{layout.names[body]} at {problem.start_time:.2f} s, its radius is {problem.robot.radius:.2f} m: "
                "move one of them"
            )
    for body, close in enumerate(kept[:, 2]):
        if close < margins[body]:
            time, there = _blocked_at(problem, layout, body)
            raise GoalBlocked(
                f"target {_target(problem)} of robot {problem.robot.id} is {there:.2f} m from {layout.names[body]} at "
                f"{time:.2f} s, demanded {margins[body]:.2f} m: choose another target"
            )


def _target(problem: SpacetimeProblem) -> str:
    return f"({problem.target[0]:.2f}, {problem.target[1]:.2f})"


def _blocked_at(problem: SpacetimeProblem, layout: Layout, body: int) -> tuple[float, float]:
    """When a body is first too near to the target [s], and how near [m]; not before the robot can be there."""
    x, y = problem.target
    rho = math.inf
    for k in range(layout.earliest, layout.latest):
        rho, _, _ = distance(layout.world, body, k, x, y)
        if rho < layout.margins[body]:
            break
    return problem.start_time + k * layout.step, float(rho)


def unreachable(problem: SpacetimeProblem, layout: Layout) -> GoalUnreachable:
    """The reason for a target to which there is no way, with those who enclose the robot.

    Parameters
    ----------
    problem : SpacetimeProblem
    layout : Layout
    """
    start = problem.start
    names = _around(problem, layout)
    by = ", ".join(names[:_MOST_NAMES]) + (" and others" if len(names) > _MOST_NAMES else "")
    return GoalUnreachable(
        f"robot {problem.robot.id} at ({start.x:.2f}, {start.y:.2f}) has no way to {_target(problem)} from "
        f"{problem.start_time:.2f} s on: {by} leave no gap of twice {layout.margins.min():.2f} m"
    )


def _around(problem: SpacetimeProblem, layout: Layout) -> list[str]:
    """Names of what encloses the robot at its start time; of the target, if that is what is enclosed."""
    grown: dict[str, BaseGeometry] = {}
    for body, margin in zip(problem.obstacles, layout.margins, strict=False):
        outline = body.outline_at(problem.start_time)
        shape = shapely.MultiPoint(outline).convex_hull if len(outline) < 4 else shapely.Polygon(outline)
        grown[body.id] = shape.buffer(body.radius + margin)
    free: BaseGeometry = shapely.box(*_extent(problem, grown))
    if problem.workspace is not None:
        region = workspace_region(problem.workspace).buffer(-float(layout.margins[-1]))
        grown[BORDER] = free.difference(region)
    free = free.difference(shapely.union_all(list(grown.values())))
    rooms = []
    for place in (problem.start.position, problem.target):
        point = shapely.Point(place)
        parts = shapely.get_parts(free)
        nearest = min(parts, key=point.distance, default=None)
        if nearest is not None:
            rooms.append(nearest)
    if not rooms:
        return list(grown)
    enclosed = min(rooms, key=lambda room: float(room.area))
    return [name for name, shape in grown.items() if shape.distance(enclosed) < _TOUCHING]


def _extent(problem: SpacetimeProblem, grown: dict[str, BaseGeometry]) -> tuple[float, float, float, float]:
    """A box around everything, with room on all sides."""
    everything = [*grown.values(), shapely.MultiPoint([problem.start.position, problem.target])]
    if problem.workspace is not None:
        everything.append(workspace_region(problem.workspace))
    west, south, east, north = shapely.total_bounds(everything).tolist()
    return west - 1.0, south - 1.0, east + 1.0, north + 1.0
