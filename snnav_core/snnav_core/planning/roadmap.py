"""Rough paths in space by a probabilistic roadmap (Ch. 4, A1-A7)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from snnav_core.area.spatial import SpatialArea
from snnav_core.planning.flight_edges import NOBODY, Spheres, clear_edges, outside
from snnav_core.types import FloatArray

__all__ = ["Roadmap", "RoadmapSettings", "build_roadmap", "rough_path"]

_NARROW = 5  # cells


@dataclass(frozen=True, slots=True)
class RoadmapSettings:
    """How dense the roadmap is; neither number is given in the thesis (C4-6).

    Parameters
    ----------
    samples : int
        N_s.
    neighbours : int
        N_c.
    attempts : int
        When no path is found, the number of samples is doubled, up to so many roadmaps in all.
    narrow : bool
        Half of the samples lie where the reduced region is narrow: holes hold too few of those that lie anywhere.
    """

    samples: int = 600
    neighbours: int = 12
    attempts: int = 3
    narrow: bool = False


@dataclass(frozen=True)
class Roadmap:
    """Vertices in the reduced region and the valid edges between them.

    Parameters
    ----------
    points : ndarray, shape (N, 3)
        [m, map]
    edges : ndarray of int, shape (E, 2)
    lengths : ndarray, shape (E,)
        [m]
    distance, growth : float
        What it was built for [m].
    """

    points: FloatArray
    edges: NDArray[np.int64]
    lengths: FloatArray
    distance: float
    growth: float


def build_roadmap(
    area: SpatialArea,
    distance: float,
    growth: float,
    settings: RoadmapSettings,
    rng: np.random.Generator,
    spheres: Spheres = NOBODY,
) -> Roadmap:
    """Sample the region R[A, d] and connect near samples (Ch. 4, A1-A3).

    Parameters
    ----------
    area : SpatialArea
    distance : float
        Clearance of vertices and edges [m].
    growth : float
        How far what may move may have come nearer [m]: T delta V_max.
    settings : RoadmapSettings
    rng : numpy.random.Generator
    spheres : ndarray, shape (K, 4)
        Other robots, which are avoided as if they stood (C4-8).
    """
    region = area.reduced(distance, growth)
    cells = np.flatnonzero(region)
    if len(cells) == 0:
        return Roadmap(np.empty((0, 3)), np.empty((0, 2), dtype=np.int64), np.empty(0), distance, growth)
    chosen = cells[rng.integers(len(cells), size=settings.samples)]
    thin = np.flatnonzero(_thin(region)) if settings.narrow else cells[:0]
    if len(thin):
        half = settings.samples // 2
        chosen[:half] = thin[rng.integers(len(thin), size=half)]
    jitter = rng.uniform(-0.5, 0.5, (settings.samples, 3))
    places = np.stack(np.unravel_index(chosen, region.shape), axis=-1)
    centres = area.grid.origin + area.grid.spacing * (places + 0.5)
    points = centres + area.grid.spacing * jitter
    kept = area.clearance_at(points, growth) >= distance
    points = np.where(kept[:, None], points, centres)
    points = points[outside(points, spheres)]
    if len(points) < 2:
        return Roadmap(points, np.empty((0, 2), dtype=np.int64), np.empty(0), distance, growth)
    count = min(settings.neighbours + 1, len(points))
    _, near = cKDTree(points).query(points, k=count)
    pairs = np.column_stack((np.repeat(np.arange(len(points)), count), np.asarray(near).ravel()))
    low, high = pairs.min(axis=1), pairs.max(axis=1)
    keys = np.unique((low * len(points) + high)[low != high])
    pairs = np.column_stack((keys // len(points), keys % len(points)))
    valid = clear_edges(area, points[pairs[:, 0]], points[pairs[:, 1]], distance, growth, spheres)
    edges = pairs[valid]
    lengths = np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)
    return Roadmap(points, edges, lengths, distance, growth)


def _thin(region: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Cells of a region that no cube of some cells inside it holds."""
    held = ndimage.minimum_filter(region.astype(np.uint8), _NARROW)
    thin: NDArray[np.bool_] = region & (ndimage.maximum_filter(held, _NARROW) == 0)
    return thin


def rough_path(
    area: SpatialArea,
    roadmap: Roadmap,
    start: FloatArray,
    goal: FloatArray,
    growth_per_metre: float,
    settings: RoadmapSettings,
    spheres: Spheres = NOBODY,
) -> FloatArray | None:
    """Shortest way from start to goal through a roadmap (Ch. 4, A4-A6).

    Parameters
    ----------
    area : SpatialArea
    roadmap : Roadmap
    start, goal : ndarray, shape (3,)
        [m, map]
    growth_per_metre : float
        V_max / v: how much nearer what moves may come per metre of way.
    settings : RoadmapSettings
    spheres : ndarray, shape (K, 4)

    Returns
    -------
    ndarray, shape (M, 3), or None
        Vertices of the way [m, map]; None when there is none in this roadmap.

    Notes
    -----
    Deviations: edges at the start are tested with what can have moved until the robot is there, not with the whole
    window, and the robot may stand nearer than the distance (C4-5); no cone at the start (C4-4); the direct edge from
    start to goal is tried (C4-6).
    """
    vertices = np.vstack((roadmap.points, start, goal))
    count = len(roadmap.points)
    edges, lengths = [roadmap.edges], [roadmap.lengths]
    for index, point, growing in ((count, start, True), (count + 1, goal, False)):
        others = np.arange(count) if index == count else np.arange(count + 1)
        if len(others) == 0:
            continue
        away = np.linalg.norm(vertices[others] - point, axis=1)
        nearest = others[np.argsort(away, kind="stable")[: 4 * settings.neighbours]]
        if index == count + 1 and count not in nearest:
            nearest = np.append(nearest, count)
        ends = vertices[nearest]
        begins = np.repeat(point[None], len(nearest), axis=0)
        from_start = growing | (nearest == count)
        per_metre = np.where(from_start, growth_per_metre, math.inf)
        if not growing:  # the direct edge starts at the start
            begins[nearest == count], ends = start, np.where((nearest == count)[:, None], point, ends)
        valid = clear_edges(area, begins, ends, roadmap.distance, roadmap.growth, spheres, per_metre)
        good = nearest[valid]
        edges.append(np.column_stack((np.full(len(good), index), good)))
        lengths.append(np.linalg.norm(vertices[good] - point, axis=1))
    pairs, weights = np.concatenate(edges), np.concatenate(lengths)
    graph = csr_matrix((weights, (pairs[:, 0], pairs[:, 1])), shape=(count + 2, count + 2))
    reached, before = dijkstra(graph, directed=False, indices=count, return_predecessors=True)
    if not math.isfinite(reached[count + 1]):
        return None
    way = [count + 1]
    while way[-1] != count:
        way.append(int(before[way[-1]]))
    return np.asarray(vertices[way[::-1]])
