"""What is computed once per unoccupied area and shared by all robots: reductions, curves, goal trees."""

from __future__ import annotations

import hashlib
import math
import os
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property

import numpy as np
import shapely
from shapely.geometry import MultiPolygon
from shapely.geometry.base import BaseGeometry

from snnav_core.area.planar import (
    UnoccupiedArea,
    as_multipolygon,
    component_at,
    reduce_area,
    remove_disks,
    shrink,
)
from snnav_core.navigator.settings import NavigatorSettings
from snnav_core.planning.boundary_index import BoundaryIndex
from snnav_core.planning.curves import AreaCurves
from snnav_core.planning.shortest import GoalTree
from snnav_core.types import TIME_TOLERANCE, FloatArray

__all__ = ["AreaContext", "Disks", "aged"]

_NARROW_SHARE, _WIDE_SHARE = 0.00125, 0.01  # of the distance: below 1 m passages matter, above speed does


_SHARED = 2  # asked for so often in a step, something is worth preparing for the next one
_MOST_KEPT = 128  # sets of standing robots that are remembered
_MOST_TARGETS = 1024

Disks = tuple[tuple[float, float, float], ...]
"""Disks of standing robots: x, y, radius [m, map]; a hashable value."""


class AreaContext:
    """One unoccupied area with everything that was derived from it.

    Parameters
    ----------
    area : UnoccupiedArea
    simplification : float
        Upper limit for the reductions [m], see `reduce_area`; never more than 1 % of their distance, below 1 m
        than 0.125 %: more would close narrow passages.
    grain : float
        Of a crowd: distances are rounded up to multiples of this [m], so that robots of several kinds share reductions,
        disks of robots have fewer corners, and reductions are the quick ones; 0 for none of that.
    """

    def __init__(self, area: UnoccupiedArea, simplification: float, grain: float = 0.0) -> None:
        self.area = area
        self.simplification, self.grain = simplification, grain
        self._reduced: dict[float, MultiPolygon] = {}
        self._without: dict[tuple[float, Disks], MultiPolygon] = {}
        self._curves: dict[bytes, AreaCurves] = {}
        self._trees: dict[tuple[AreaCurves, float, float], GoalTree] = {}
        self._opened: dict[tuple[float, float], BaseGeometry] = {}
        self._used: dict[float, float] = {}  # distances that were asked for, by what they are rounded to
        self._asked: dict[
            tuple[float, Disks], set[tuple[float, float]]
        ] = {}  # targets that curves were asked for

    def prepare(self, before: AreaContext) -> None:
        """Compute on all cores what several robots asked of the last area, before they ask for it one by one.

        Parameters
        ----------
        before : AreaContext
            The area of the decision before.

        Notes
        -----
        Shapely and the compiled parts run without the GIL. What comes out does not depend on the number of threads.
        """
        keys = [key for key, targets in before._asked.items() if len(targets) >= _SHARED]
        distances = sorted(before._used.values())
        workers = min(os.cpu_count() or 1, len(distances))
        if workers < 2:
            return
        with ThreadPoolExecutor(workers) as pool:
            list(pool.map(self._reduction, distances))
            list(pool.map(lambda key: self._connect(key, before._asked[key]), keys))

    def _connect(self, key: tuple[float, Disks], targets: set[tuple[float, float]]) -> None:
        """Work out the tangent graphs of the components that hold the targets."""
        distance, disks = key
        components = {self._curves_at(distance, disks, np.array(target)) for target in targets}
        for curves in components - {None}:
            assert curves is not None
            _ = curves.neighbours

    def rounded(self, distance: float) -> float:
        """A distance [m] rounded up to one that robots of several kinds share."""
        return distance if self.grain == 0.0 else math.ceil(distance / self.grain - 1e-6) * self.grain

    @cached_property
    def digest(self) -> bytes:
        """Identifies the region: equal for equal rings."""
        content = hashlib.sha256()
        for ring in self.area.rings:
            content.update(len(ring).to_bytes(8, "little"))
            content.update(ring.tobytes())
        return content.digest()

    @cached_property
    def boundary(self) -> BoundaryIndex:
        """For the certificate check."""
        return BoundaryIndex(self.area.region)

    def clearance(self, point: FloatArray) -> float:
        """Signed distance of one point (2,) [m, map] to the boundary [m]."""
        return float(self.area.clearance(np.asarray(point)[None])[0])

    def region(self, distance: float, disks: Disks) -> MultiPolygon:
        """The area reduced by `distance` [m], without the disks of standing robots."""
        distance = self.rounded(distance)
        self._used.setdefault(round(distance, 6), distance)
        return self._without_disks(distance, disks)

    def _reduction(self, distance: float) -> MultiPolygon:
        key = round(distance, 6)
        if key not in self._reduced:
            share = _NARROW_SHARE if distance < 1.0 else _WIDE_SHARE
            tolerance = min(self.simplification, share * distance)
            reduced = reduce_area(self.area.region, distance, tolerance, quick=self.grain > 0.0)
            self._reduced.setdefault(key, reduced)
        return self._reduced[key]

    def _without_disks(self, distance: float, disks: Disks) -> MultiPolygon:
        if not disks:
            return self._reduction(distance)
        key = round(distance, 6)
        if (key, disks) not in self._without:
            if len(self._without) >= _MOST_KEPT:
                # In an area that never changes, robots stop here and there for days.
                for kept in (self._without, self._curves, self._trees, self._asked):
                    kept.clear()
            values = np.array(disks)
            simple = self.grain > 0.0
            without = remove_disks(self._reduction(distance), values[:, :2], values[:, 2], simple)
            self._without.setdefault((key, disks), without)
        return self._without[key, disks]

    def opened(self, distance: float, half: float) -> BaseGeometry:
        """Where a disk of radius `half` [m] fits into the area reduced by `distance` [m]: the union of all such disks.

        Two robots fit side by side there.
        """
        key = (round(self.rounded(distance + half), 6), round(half, 6))
        if key not in self._opened:
            self._opened[key] = self.region(distance + half, ()).buffer(1.05 * half, quad_segs=4)
            shapely.prepare(self._opened[key])
        return self._opened[key]

    def curves(self, distance: float, disks: Disks, target: FloatArray) -> AreaCurves | None:
        """Curves of the component of the reduced area that holds the target (2,) [m, map], or None."""
        distance = self.rounded(distance)
        self._used.setdefault(round(distance, 6), distance)
        asked = self._asked.setdefault((distance, disks), set())
        asked.add((float(target[0]), float(target[1])))
        return self._curves_at(distance, disks, target)

    def _curves_at(self, distance: float, disks: Disks, target: FloatArray) -> AreaCurves | None:
        polygon = component_at(self._without_disks(distance, disks), target)
        if polygon is None:
            return None
        key = shapely.to_wkb(polygon)
        if key not in self._curves:
            self._curves.setdefault(key, AreaCurves(polygon))
        return self._curves[key]

    def goal_tree(self, curves: AreaCurves, target: FloatArray) -> GoalTree:
        """Shortest distances to the target (2,) [m, map] over the curves."""
        key = (curves, float(target[0]), float(target[1]))
        if key not in self._trees:
            if len(self._trees) >= _MOST_TARGETS:
                self._trees.clear()
            self._trees[key] = GoalTree(curves, target)
        return self._trees[key]

    def nearest_inside(self, point: FloatArray, distance: float, disks: Disks) -> FloatArray | None:
        """Point of the reduced area nearest to the given one, (2,) [m, map]; None when nothing is left."""
        region = as_multipolygon(self.region(distance, disks))
        if region.is_empty:
            return None
        line = shapely.shortest_line(region, shapely.points(point))
        nearest = np.asarray(shapely.get_coordinates(line)[0])
        # A hair inwards, so that it is covered in spite of rounding.
        away = nearest - point
        length = float(np.linalg.norm(away))
        return nearest + away / length * 1e-6 if length > 0.0 else nearest


def aged(area: UnoccupiedArea, time: float, settings: NavigatorSettings) -> UnoccupiedArea:
    """The part of an older area that is free for sure at `time` [s]; nothing when it is older than the window."""
    age, interval = time - area.stamp, settings.sampling_interval
    if not -interval <= age <= settings.time_window * interval:
        return UnoccupiedArea(area.stamp, MultiPolygon(), area.contradictions, area.lost)
    if age <= TIME_TOLERANCE:
        return area
    region = shrink(area.region, age * settings.boundary_speed)
    return UnoccupiedArea(area.stamp, region, area.contradictions, area.lost)
