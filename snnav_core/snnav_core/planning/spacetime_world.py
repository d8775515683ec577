"""A problem in space-time laid out for the compiled planner: where everything is at the times of the path points."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np
import shapely

from snnav_core.area.clearance import NOWHERE, ClearanceField
from snnav_core.planning.spacetime_bodies import distances_over_time
from snnav_core.planning.spacetime_kernel import World
from snnav_core.planning.spacetime_problem import SpacetimeProblem, SpacetimeSettings
from snnav_core.types import FloatArray

__all__ = ["BORDER", "RADIUS_RESERVE", "Layout", "TurningReserve", "lay_out"]

BORDER = "workspace"
"""Name of the border of the workspace in messages and turns."""

RADIUS_RESERVE = 1.15
"""R_plan as a share of R_min (C0-9)."""

_MOST_POINTS = 3000
_SPARE = 50  # points beyond the longest candidate


class TurningReserve(Enum):
    """How much farther than the margin demands a path keeps from bodies, so that it holds the turning radius."""

    CORNERS = "corners"  # R_min and a reserve around corners of bodies that stand
    FOLLOWING = "following"  # (1 + beta)^2 as much around those in motion, to go all along them (C2-2)
    NONE = "none"  # for narrow passages


@dataclass(frozen=True)
class _Body:
    """Outline around the origin of its motion, where that origin is at all times, and what is kept."""

    name: str
    outline: FloatArray
    radius: float
    shifts: FloatArray
    share: float  # of the speed of the robot
    margin: float


@dataclass(frozen=True)
class Layout:
    """What the search works on.

    Parameters
    ----------
    world : World
    names : tuple of str
        Of the bodies in the order of their numbers; the last one is the border.
    link, step : float
        Length [m] and duration [s] of a link.
    margins : ndarray, shape (B + 1,)
        What the certificate demands from each [m].
    perimeters : ndarray, shape (B + 1,)
        Of what is kept clear around each [m].
    earliest, latest : int
        Points at which a path may end: as many as the straight line has, and so many times more (C2-3).
    """

    world: World
    names: tuple[str, ...]
    link: float
    step: float
    margins: FloatArray
    perimeters: FloatArray
    earliest: int
    latest: int

    @property
    def most_points(self) -> int:
        """Points at which the motion of the bodies is known, the longest candidate (C2-3)."""
        return int(self.world.shifts.shape[1])


def lay_out(problem: SpacetimeProblem, settings: SpacetimeSettings, reserve: TurningReserve) -> Layout:
    """Lay a problem out for the kernels.

    Parameters
    ----------
    problem : SpacetimeProblem
    settings : SpacetimeSettings
    reserve : TurningReserve

    Notes
    -----
    Deviations: the planning distance holds the margin along links too, also relative to bodies in motion (C0-7), and
    leaves corners the turning radius that `reserve` says (C2-2). Links are a fraction of v delta where C0-10
    and C2-10 demand it: at most half of the planning distance, the smallest radius of the path.
    """
    speed = problem.robot.speed
    parts = _parts(problem, settings)
    step = settings.sampling_interval / parts
    link = speed * step
    holes = _holes(problem)
    straight = math.dist(problem.start.position, problem.target)
    count = _most_points(problem, settings, straight, link, holes)
    times: FloatArray = problem.start_time + step * np.arange(float(count))
    bodies = _bodies(problem, settings, times, holes)
    turning = RADIUS_RESERVE * problem.robot.min_turn_radius
    margins = np.array(
        [*(body.margin for body in bodies), settings.safety_margin + settings.tracking_tolerance]
    )
    shares = np.array([*(body.share for body in bodies), 0.0])
    radii = np.array([*(body.radius for body in bodies), 0.0])
    least = np.hypot(margins, 0.5 * settings.longest_link * link * (1.0 + shares))
    if reserve is not TurningReserve.NONE:
        shares = shares if reserve is TurningReserve.FOLLOWING else np.zeros_like(shares)
        wanted = np.maximum(least, turning * (1.0 + shares) ** 2 - radii)
    else:
        wanted = least
    world = _pack(problem, bodies, wanted, count)
    earliest = int(straight / link)
    latest = min(int(settings.longest * straight / link) + 1, count)
    at_start, at_target = distances_over_time(world, earliest, latest)
    lengths = [_perimeter(body.outline) + 2.0 * math.pi * body.radius for body in bodies]
    lengths.append(_border_length(problem))
    return Layout(
        world._replace(kept=np.column_stack((wanted, at_start, at_target))),
        (*(body.name for body in bodies), BORDER),
        link,
        step,
        margins,
        np.array(lengths) + 2.0 * math.pi * wanted,
        earliest,
        latest,
    )


def _parts(problem: SpacetimeProblem, settings: SpacetimeSettings) -> int:
    """Links per v delta."""
    stride = problem.robot.speed * settings.sampling_interval
    fastest = max((body.speed for body in problem.obstacles), default=0.0) / problem.robot.speed
    near = min([settings.safety_margin, *(other.distance for other in problem.others)])
    wide = max(near, RADIUS_RESERVE * problem.robot.min_turn_radius)
    return max(1, math.ceil(2.0 * stride / wide - 1e-9), math.ceil(1.01 * stride * (1.0 + fastest) / near))


def _most_points(
    problem: SpacetimeProblem,
    settings: SpacetimeSettings,
    straight: float,
    link: float,
    holes: list[FloatArray],
) -> int:
    around = sum(_perimeter(body.outline) + 2.0 * math.pi * body.radius for body in problem.obstacles)
    around += sum(_perimeter(hole) for hole in holes) + _border_length(problem)
    count = len(problem.obstacles) + len(problem.others) + len(holes)
    around += 2.0 * math.pi * settings.safety_margin * count
    return int(min((settings.longest * straight + around) / link, _MOST_POINTS)) + _SPARE


def _perimeter(outline: FloatArray) -> float:
    return float(np.hypot(*(np.roll(outline, -1, axis=0) - outline).T).sum())


def _border_length(problem: SpacetimeProblem) -> float:
    rings = problem.workspace or ()
    return sum(_perimeter(ring) for ring in rings if _is_shell(ring))


def _is_shell(ring: FloatArray) -> bool:
    return bool(shapely.is_ccw(shapely.LinearRing(ring)))


def _holes(problem: SpacetimeProblem) -> list[FloatArray]:
    """Holes of the workspace as outlines of bodies, counter-clockwise."""
    holes = []
    for ring in problem.workspace or ():
        if not _is_shell(ring):
            closed = len(ring) > 1 and bool((ring[0] == ring[-1]).all())
            holes.append(np.asarray(ring[:-1] if closed else ring, dtype=np.float64)[::-1])
    return holes


def _bodies(
    problem: SpacetimeProblem, settings: SpacetimeSettings, times: FloatArray, holes: list[FloatArray]
) -> list[_Body]:
    speed, margin = problem.robot.speed, settings.safety_margin + settings.tracking_tolerance
    bodies = [
        _Body(
            body.id,
            body.outline,
            body.radius,
            (times - body.stamp)[:, None] * body.velocity,
            body.speed / speed,
            margin,
        )
        for body in problem.obstacles
    ]
    standing = np.zeros((len(times), 2))
    bodies += [_Body(f"{BORDER} hole {i}", hole, 0.0, standing, 0.0, margin) for i, hole in enumerate(holes)]
    for other in problem.others:
        places = other.path.positions_at(times)[:, :2]
        links = np.hypot(*np.diff(other.path.points[:, :2], axis=0).T)
        share = float(links.max(initial=0.0)) / (other.path.step * speed)
        kept = other.distance + 2.0 * settings.tracking_tolerance
        bodies.append(_Body(other.id, np.zeros((1, 2)), 0.0, places, share, kept))
    return bodies


def _pack(problem: SpacetimeProblem, bodies: list[_Body], keep: FloatArray, count: int) -> World:
    vertices = [body.outline for body in bodies]
    radii = np.array([body.radius for body in bodies])
    boxes = [0.5 * (outline.min(axis=0) + outline.max(axis=0)) for outline in vertices]
    reach = [float(np.hypot(*(outline - box).T).max()) for outline, box in zip(vertices, boxes, strict=True)]
    circles = np.column_stack((np.array(boxes).reshape(-1, 2), np.array(reach) + radii, radii))
    return World(
        vertices=np.concatenate([np.zeros((0, 2)), *vertices]),
        offsets=np.cumsum([0, *(len(outline) for outline in vertices)]),
        shifts=np.array([body.shifts for body in bodies]).reshape(-1, count, 2),
        circles=circles,
        kept=np.column_stack((keep, np.full((len(keep), 2), np.inf))),
        ends=np.array([problem.start.position, problem.target], dtype=np.float64),
        border=_border(problem),
    )


def _border(problem: SpacetimeProblem) -> tuple[object, ...]:
    """The exterior rings of the workspace, prepared for distances."""
    shells = [ring for ring in problem.workspace or () if _is_shell(ring)]
    if not shells:
        return NOWHERE
    return ClearanceField(shells).arrays
