"""Where a robot can wait out of the way of others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from snnav_core.area.planar import as_multipolygon
from snnav_core.navigator.context import AreaContext, Disks
from snnav_core.navigator.settings import RobotDistances
from snnav_core.planning.shortest import GoalTree
from snnav_core.types import FloatArray

__all__ = ["Claim", "Place", "nearest_place"]

_REACH = 15.0  # [m]; places farther away are not looked at
_SPACING = 0.5  # [m] between places that are looked at
_MOST = 60  # places to which ways are sought
_HAIR = 0.01  # [m] inside of the region
_IN_THE_WAY = (
    4.0  # [m] of detour that are worth keeping out of somebody's way, or not having to push somebody aside
)


@dataclass(frozen=True)
class Claim:
    """Where a robot drives or stands, and the distance that another one keeps from it [m]."""

    line: BaseGeometry
    distance: float


@dataclass(frozen=True)
class Place:
    """A place to wait (2,) [m, map], and what it costs to get there [m]."""

    point: FloatArray
    cost: float


def nearest_place(
    context: AreaContext,
    start: FloatArray,
    distances: RobotDistances,
    fixed: Disks,
    claims: Sequence[Claim],
    avoid: Sequence[Claim],
) -> Place | None:
    """The nearest place off all claims that can be reached; None without any.

    Parameters
    ----------
    context : AreaContext
    start : ndarray, shape (2,)
        Where the robot is [m, map].
    distances : RobotDistances
        Of the robot.
    fixed : Disks
        Robots that cannot be driven through on the way there.
    claims : sequence of Claim
        Where it must not stand.
    avoid : sequence of Claim
        Where it should not stand, or drive through, when there is something else nearby.
    """
    for distance in (float(distances.demanded()[-1]), 1.012 * distances.tightest + _HAIR):
        free: BaseGeometry = context.region(distance, ())
        free = shapely.clip_by_rect(free, *(start - _REACH), *(start + _REACH))
        taken = [claim.line.buffer(claim.distance) for claim in claims]
        taken += [shapely.Point(x, y).buffer(radius) for x, y, radius in fixed]
        free = shapely.difference(free, shapely.union_all(taken)) if taken else free
        found = _cheapest(context, start, distances, fixed, avoid, _candidates(free, start))
        if found is not None:
            return found
    return None


def _candidates(free: BaseGeometry, start: FloatArray) -> FloatArray:
    """Points of a region (N, 2) [m, map], nearest to the start first."""
    points = [np.empty((0, 2))]
    here = shapely.points(start)
    inner = free.buffer(-_HAIR)
    points += [
        shapely.get_coordinates(shapely.shortest_line(part, here))[:1]
        for part in shapely.get_parts(as_multipolygon(inner))
    ]
    steps = np.arange(-_REACH, _REACH + 0.5 * _SPACING, _SPACING)
    grid = start + np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    shapely.prepare(inner)
    points.append(grid[shapely.contains_xy(inner, grid[:, 0], grid[:, 1])])
    found = np.concatenate(points)
    return found[np.argsort(np.linalg.norm(found - start, axis=1), kind="stable")]


def _cheapest(
    context: AreaContext,
    start: FloatArray,
    distances: RobotDistances,
    fixed: Disks,
    avoid: Sequence[Claim],
    candidates: FloatArray,
) -> Place | None:
    if len(candidates) == 0:
        return None
    inside = context.nearest_inside(start, 1.012 * distances.tightest, fixed)
    if inside is None:
        return None
    curves = context.curves(distances.tightest, fixed, inside)
    if curves is None:
        return None
    tree = GoalTree(curves, inside)
    best: Place | None = None
    tried = 0
    for point in candidates:
        straight = float(np.linalg.norm(point - start))
        if tried >= _MOST or (best is not None and straight >= best.cost):
            break
        if not curves.covers(point):
            continue
        tried += 1
        chain = tree.from_point(point)
        if chain is None:
            continue
        chain = np.vstack((chain, start))
        length = float(np.linalg.norm(np.diff(chain, axis=0), axis=1).sum())
        if best is not None and length >= best.cost:
            continue
        cost = length + _IN_THE_WAY * _touched(point, chain, avoid)
        if best is None or cost < best.cost:
            best = Place(point, cost)
    return best


def _touched(point: FloatArray, chain: FloatArray, avoid: Sequence[Claim]) -> int:
    """How many of the robots to avoid stand in the way there, or would find the place taken."""
    here, way = shapely.points(point), shapely.linestrings(chain)
    return sum(
        claim.line.distance(way if claim.line.geom_type == "Point" else here) < claim.distance
        for claim in avoid
    )
