"""Where a robot can wait out of the way of others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from snnav_core.area.planar import as_multipolygon, component_at, remove_disks
from snnav_core.navigator.context import AreaContext, Disks
from snnav_core.navigator.settings import RobotDistances
from snnav_core.planning.curves import AreaCurves
from snnav_core.planning.shortest import GoalTree
from snnav_core.types import FloatArray

__all__ = ["Claim", "Place", "PlaceSearch"]

_REACH = 15.0  # [m]; places farther away are not looked at
_SPACING = 0.5  # [m] between places that are looked at
_MOST = 60  # places to which ways are sought
_LOCKED_IN = 20.0  # [m] of detour that are worth having a way on afterwards
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


class PlaceSearch:
    """Looks for a place where one robot can wait.

    Parameters
    ----------
    context : AreaContext
    start : ndarray, shape (2,)
        Where the robot is [m, map].
    distances : RobotDistances
        Of the robot.
    goal : ndarray, shape (2,)
        Where it wants to go afterwards [m, map].
    """

    def __init__(
        self, context: AreaContext, start: FloatArray, distances: RobotDistances, goal: FloatArray
    ) -> None:
        self._context, self._start, self._distances, self._goal = context, start, distances, goal

    def nearest(
        self, fixed: Disks, later: Disks, claims: Sequence[Claim], avoid: Sequence[Claim]
    ) -> Place | None:
        """The nearest place off all claims that can be reached; None without any.

        Parameters
        ----------
        fixed : Disks
            Robots that cannot be driven through on the way there.
        later : Disks
            Where those that pass will stand then: a place from where they leave no way to the goal is a poor one.
        claims : sequence of Claim
            Where it must not stand.
        avoid : sequence of Claim
            Where it should not stand, or drive through, when there is something else nearby.
        """
        distances = self._distances
        for distance in (float(distances.demanded()[-1]), 1.012 * distances.tightest + _HAIR):
            free: BaseGeometry = self._context.region(distance, ())
            free = shapely.clip_by_rect(free, *(self._start - _REACH), *(self._start + _REACH))
            taken = [claim.line.buffer(claim.distance) for claim in claims]
            taken += [shapely.Point(x, y).buffer(radius) for x, y, radius in fixed]
            free = shapely.difference(free, shapely.union_all(taken)) if taken else free
            found = self._cheapest(_candidates(free, self._start), fixed, later, avoid)
            if found is not None:
                return found
        return None

    def _cheapest(
        self, candidates: FloatArray, fixed: Disks, later: Disks, avoid: Sequence[Claim]
    ) -> Place | None:
        context, start, distances = self._context, self._start, self._distances
        found = self._curves(fixed) if len(candidates) else None
        if found is None:
            return None
        curves, inside = found
        open_again = component_at(context.region(distances.tightest, later), self._goal)
        tree, others = GoalTree(curves, inside), _Others(avoid)
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
            cost = length + _IN_THE_WAY * others.touched(point, chain)
            if open_again is not None and not shapely.intersects_xy(open_again, *point):
                cost += _LOCKED_IN
            if best is None or cost < best.cost:
                best = Place(point, cost)
        return best

    def _curves(self, fixed: Disks) -> tuple[AreaCurves, FloatArray] | None:
        """What ways are sought in, without disks that cannot be driven through, and where they start (2,) [m, map].

        In a crowd only what lies around the robot: its tangent graph is of no use to anybody else.
        """
        context, start, tightest = self._context, self._start, self._distances.tightest
        if context.grain == 0.0:
            inside = context.nearest_inside(start, 1.012 * tightest, fixed)
            curves = None if inside is None else context.curves(tightest, fixed, inside)
            return None if inside is None or curves is None else (curves, inside)
        corners = (*(start - _REACH), *(start + _REACH))
        near = as_multipolygon(shapely.clip_by_rect(context.region(tightest, ()), *corners))
        disks = np.array(fixed).reshape(-1, 3)
        near = remove_disks(near, disks[:, :2], disks[:, 2], simple=True)
        if near.is_empty:
            return None
        part = min(near.geoms, key=lambda polygon: float(shapely.distance(polygon, shapely.points(start))))
        curves = AreaCurves(part)
        return curves, start if curves.covers(start) else curves.nearest(start)


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


class _Others:
    """The robots to avoid, all compared at once."""

    def __init__(self, avoid: Sequence[Claim]) -> None:
        stand = [claim.line.geom_type == "Point" for claim in avoid]
        self._spots = _arrays([claim for claim, stands in zip(avoid, stand, strict=True) if stands])
        self._ways = _arrays([claim for claim, stands in zip(avoid, stand, strict=True) if not stands])

    def touched(self, point: FloatArray, chain: FloatArray) -> int:
        """How many of them stand in the way (N, 2), or would find the place (2,) taken."""
        here, way = shapely.points(point), shapely.linestrings(chain)
        return sum(
            int(np.count_nonzero(shapely.distance(lines, geometry) < distances))
            for (lines, distances), geometry in ((self._spots, way), (self._ways, here))
        )


def _arrays(claims: Sequence[Claim]) -> tuple[np.ndarray, FloatArray]:
    lines = np.array([claim.line for claim in claims], dtype=object)
    return lines, np.array([claim.distance for claim in claims])
