"""The independent check of the shape of a path in space-time: whether the robot can drive it at its speed."""

from __future__ import annotations

import math

import numpy as np

from snnav_core.planning.spacetime_problem import SpacetimeProblem, SpacetimeSettings
from snnav_core.types import FloatArray, RobotSpec, TimedPath

__all__ = ["RADIUS_FACTOR", "least_radius", "place", "shape_fault"]

RADIUS_FACTOR = 0.95
"""Smallest circumscribed radius as a share of R_min (C0-9)."""

_ROUNDING = 1e-9  # [m]
_TIMELY = 1e-3  # [m]


def least_radius(path: TimedPath) -> float:
    """Least circumscribed radius abc / (4 area) of three successive points [m] (C0-9)."""
    points = path.points[:, :2]
    if len(points) < 3 or path.turn_to is not None:
        return math.inf
    before, after = points[1:-1] - points[:-2], points[2:] - points[1:-1]
    sides = np.hypot(*before.T) * np.hypot(*after.T) * np.hypot(*(before + after).T)
    doubled = np.abs(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0])
    with np.errstate(divide="ignore", invalid="ignore"):
        radius = np.where(doubled > 1e-12, sides / (2.0 * doubled), math.inf)
    radius[np.einsum("ij,ij->i", before, after) <= 0.0] = 0.0
    return float(radius.min())


def shape_fault(path: TimedPath, problem: SpacetimeProblem, settings: SpacetimeSettings) -> str:
    """Reason why the path cannot be driven or does not lead to the target, or an empty string."""
    points, robot, start = path.points[:, :2], problem.robot, problem.start.position
    if not (offset := math.dist(points[0], start)) <= 1e-6:
        return f"the path starts {offset:.3f} m away from the robot"
    if path.turn_to is not None:
        if (moved := float(np.abs(points - points[0]).max())) > 0.0:
            return f"a turn in place moves by {moved:.3f} m"
        return "" if robot.can_turn_in_place else f"robot {robot.id} cannot turn in place"
    link = robot.speed * path.step
    if (rest := math.dist(points[-1], problem.target)) > link + _ROUNDING:
        return f"the path ends {rest:.3f} m from the target, a link has {link:.3f} m"
    return (
        _link_fault(points, link, settings) or _heading_fault(points, problem) or _radius_fault(path, robot)
    )


def _link_fault(points: FloatArray, nominal: float, settings: SpacetimeSettings) -> str:
    links = np.hypot(*np.diff(points, axis=0).T)
    longest = settings.longest_link
    wrong = links > longest * nominal + _ROUNDING
    wrong[:-1] |= links[:-1] < (2.0 - longest) * nominal - _ROUNDING
    if not wrong.any():
        return _delay_fault(points, links - nominal, settings)
    first = int(np.argmax(wrong))
    return (
        f"link {first} at {place(points[first])} is {links[first]:.3f} m long, "
        f"the robot covers {nominal:.3f} m in a step"
    )


def _delay_fault(points: FloatArray, excess: FloatArray, settings: SpacetimeSettings) -> str:
    """Links a little too long, one after the other, leave the robot behind its timed path (C0-11)."""
    total = np.concatenate(([0.0], np.cumsum(excess)))
    behind = total - np.minimum.accumulate(total)
    worst, tolerated = int(np.argmax(behind)), settings.tracking_tolerance
    if behind[worst] <= tolerated + _TIMELY:
        return ""
    return (
        f"at {place(points[worst])} the robot at its speed is {behind[worst]:.3f} m behind its timed path, "
        f"tolerated {tolerated:.3f} m"
    )


def _heading_fault(points: FloatArray, problem: SpacetimeProblem) -> str:
    """A base that turns in place turns before it starts (C2-11)."""
    if problem.robot.can_turn_in_place or len(points) < 2:
        return ""
    way = points[1] - points[0]
    angle = abs(math.remainder(math.atan2(way[1], way[0]) - problem.start.heading, 2.0 * math.pi))
    reach = math.hypot(*way) / (2.0 * RADIUS_FACTOR * problem.robot.min_turn_radius)
    limit = math.asin(min(1.0, reach))
    if angle <= limit + 1e-6:
        return ""
    off, allowed = math.degrees(angle), math.degrees(limit)
    return f"the path starts {off:.1f} deg off the heading, allowed {allowed:.1f} deg"


def _radius_fault(path: TimedPath, robot: RobotSpec) -> str:
    limit = RADIUS_FACTOR * robot.min_turn_radius
    radius = least_radius(path)
    if radius >= limit - _ROUNDING:
        return ""
    return f"the least radius of the path is {radius:.3f} m, the robot needs {limit:.3f} m"


def place(point: FloatArray) -> str:
    """Where something is, in words."""
    return f"({point[0]:.2f}, {point[1]:.2f})"
