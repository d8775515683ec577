"""The exact shortest path in a polygonal region, as a yardstick for the planner (and independent of it)."""

from __future__ import annotations

import heapq
import math

import numba
import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from snnav_core.errors import GoalBlocked, GoalUnreachable, StartBlocked
from snnav_core.types import FloatArray

__all__ = ["reduced", "shortest_path"]

_SIMPLIFICATION = 0.005  # [m]
_TOUCH = 1e-9  # [m]
_ON_BORDER = 1e-6  # [m]; start and target may lie on the border of the region but for rounding
_QUARTER_SEGMENTS = 24  # chords of a quarter arc; a way round it is short by 0.02 %


def reduced(area: BaseGeometry, distance: float) -> BaseGeometry:
    """Return the points of an area at least `distance` [m] from its boundary, corners rounded by fine chords.

    The chords cut the corners, never by more than 0.06 % of the distance: the result is a little too large and the
    shortest path in it a little too short, so that ratios to it are not flattered.
    """
    return area.buffer(-distance, quad_segs=_QUARTER_SEGMENTS)


def shortest_path(
    region: BaseGeometry, start: tuple[float, float], target: tuple[float, float]
) -> tuple[float, FloatArray]:
    """Return the length and the corners of the shortest path.

    Parameters
    ----------
    region : shapely polygon or multipolygon
        Closed region that the path may use [m, map]; simplified by 5 mm, outwards where that shortens the path.
    start, target : pair of float
        [m, map]

    Returns
    -------
    length : float
        [m]
    points : ndarray, shape (N, 2)
        From start to target.

    Raises
    ------
    StartBlocked, GoalBlocked
        If an end lies outside the region.
    GoalUnreachable
        If both lie in different components.

    Notes
    -----
    A shortest path turns at reflex corners only and touches each of them from one side: a search by A* over the
    reflex corners whose edges are tests of sight made when they could improve a corner, no more.
    """
    component = _common_component(region, start, target)
    segments, corners, before, after = _outline(component)
    nodes = np.vstack((np.array([start, target], dtype=np.float64), corners))
    before = np.vstack((np.full((2, 2), np.nan), before))
    after = np.vstack((np.full((2, 2), np.nan), after))
    allowed = np.stack([_leaves_inwards(component, end, nodes) for end in (start, target)])
    parent = _search(nodes, before, after, segments, allowed)
    if parent[1] < 0:
        raise GoalUnreachable(f"no way from {start} to {target} inside the region")
    order = [1]
    while order[-1] != 0:
        order.append(int(parent[order[-1]]))
    points = nodes[order[::-1]]
    return float(np.hypot(*np.diff(points, axis=0).T).sum()), points


def _common_component(
    region: BaseGeometry, start: tuple[float, float], target: tuple[float, float]
) -> shapely.Polygon:
    """Return the polygon that holds both ends."""
    polygons = [part for part in shapely.get_parts(region) if isinstance(part, shapely.Polygon)]
    homes = []
    for point, failure in ((start, StartBlocked), (target, GoalBlocked)):
        where = shapely.Point(point)
        home = {i for i, polygon in enumerate(polygons) if polygon.distance(where) <= _ON_BORDER}
        if not home:
            raise failure(
                f"point ({point[0]:.3f}, {point[1]:.3f}) lies outside the region: choose another one"
            )
        homes.append(home)
    common = homes[0] & homes[1]
    if not common:
        raise GoalUnreachable(f"{start} and {target} lie in different components of the region")
    polygon = polygons[min(common)]
    simple = polygon.simplify(_SIMPLIFICATION)
    ends = shapely.MultiPoint([start, target])
    return simple if isinstance(simple, shapely.Polygon) and simple.covers(ends) else polygon


def _outline(polygon: shapely.Polygon) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return segments (S, 4) and the reflex corners (K, 2) with the corner before and after each."""
    segments, corners, before, after = [], [np.zeros((0, 2))], [np.zeros((0, 2))], [np.zeros((0, 2))]
    for ring in shapely.get_rings(shapely.orient_polygons(polygon)):
        points = shapely.get_coordinates(ring)[:-1]
        last, following = np.roll(points, 1, axis=0), np.roll(points, -1, axis=0)
        segments.append(np.hstack((points, following)))
        edge_in, edge_out = points - last, following - points
        reflex = edge_in[:, 0] * edge_out[:, 1] - edge_in[:, 1] * edge_out[:, 0] < 0.0
        corners.append(points[reflex])
        before.append(last[reflex])
        after.append(following[reflex])
    return np.concatenate(segments), np.concatenate(corners), np.concatenate(before), np.concatenate(after)


def _leaves_inwards(
    polygon: shapely.Polygon, end: tuple[float, float], nodes: FloatArray
) -> NDArray[np.bool_]:
    """Whether the straight way from an end to each node is inside; looked at only for an end on the border."""
    if polygon.boundary.distance(shapely.Point(end)) > _ON_BORDER:
        return np.ones(len(nodes), dtype=np.bool_)
    wide = polygon.buffer(2.0 * _ON_BORDER)
    shapely.prepare(wide)
    ways = np.stack((np.broadcast_to(end, nodes.shape), nodes), axis=1)
    inside: NDArray[np.bool_] = shapely.covers(wide, shapely.linestrings(ways))
    return inside


def _search(
    nodes: FloatArray, before: FloatArray, after: FloatArray, segments: FloatArray, allowed: NDArray[np.bool_]
) -> NDArray[np.int64]:
    """Return the parent of every node on the shortest path from node 0; -1 for none (A* towards node 1).

    `allowed`, shape (2, K), tells which nodes may follow the start and precede the target.
    """
    count = len(nodes)
    cost = np.full(count, np.inf)
    parent = np.full(count, -1, dtype=np.int64)
    done = np.zeros(count, dtype=np.bool_)
    rest = np.hypot(nodes[:, 0] - nodes[1, 0], nodes[:, 1] - nodes[1, 1])
    cost[0] = 0.0
    queue = [(float(rest[0]), 0)]
    while queue:
        _, node = heapq.heappop(queue)
        if done[node]:
            continue
        done[node] = True
        if node == 1:
            break
        there = cost[node] + np.hypot(nodes[:, 0] - nodes[node, 0], nodes[:, 1] - nodes[node, 1])
        open_nodes = ~done & (there < cost) & _supports(nodes, before, after, node)
        if node == 0:
            open_nodes &= allowed[0]
        open_nodes[1] &= allowed[1, node]
        hopeful = np.flatnonzero(open_nodes)
        for other in hopeful[_sees(nodes, node, hopeful, segments)].tolist():
            cost[other] = there[other]
            parent[other] = node
            heapq.heappush(queue, (float(there[other] + rest[other]), other))
    return parent


def _supports(nodes: FloatArray, before: FloatArray, after: FloatArray, node: int) -> NDArray[np.bool_]:
    """Whether the line from a node to each other one touches both corners from one side, shape (K,)."""
    way = nodes - nodes[node]

    def side(corner: FloatArray, neighbour: FloatArray) -> FloatArray:
        offset = neighbour - corner
        area: FloatArray = way[:, 0] * offset[..., 1] - way[:, 1] * offset[..., 0]
        area[np.abs(area) <= _TOUCH * np.hypot(way[:, 0], way[:, 1])] = 0.0
        return area

    far = side(nodes, before) * side(nodes, after)
    near = side(nodes[node], before[node]) * side(nodes[node], after[node])
    return ~(far < 0.0) & ~(near < 0.0)


@numba.njit(cache=True, error_model="numpy")
def _sees(nodes: FloatArray, node: int, others: NDArray[np.int64], segments: FloatArray) -> NDArray[np.bool_]:
    """Whether no segment of the outline (S, 4) stands between a node and each of the others."""
    out = np.ones(others.shape[0], dtype=np.bool_)
    ax, ay = nodes[node, 0], nodes[node, 1]
    for index in range(others.shape[0]):
        bx, by = nodes[others[index], 0], nodes[others[index], 1]
        dx, dy = bx - ax, by - ay
        length = math.sqrt(dx * dx + dy * dy)
        if length <= _TOUCH:
            continue
        dx, dy = dx / length, dy / length
        for s in range(segments.shape[0]):
            px, py, qx, qy = (
                segments[s, 0] - ax,
                segments[s, 1] - ay,
                segments[s, 2] - ax,
                segments[s, 3] - ay,
            )
            p_side, q_side = dx * py - dy * px, dx * qy - dy * qx
            if (p_side > _TOUCH and q_side > _TOUCH) or (p_side < -_TOUCH and q_side < -_TOUCH):
                continue
            p_along, q_along = dx * px + dy * py, dx * qx + dy * qy
            if abs(p_side) <= _TOUCH:
                # a corner on the way: the parts on both sides of it are edges of their own
                if _TOUCH < p_along < length - _TOUCH:
                    out[index] = False
                    break
            elif abs(q_side) > _TOUCH:
                along = p_along + (q_along - p_along) * p_side / (p_side - q_side)
                if _TOUCH < along < length - _TOUCH:
                    out[index] = False
                    break
    return out
