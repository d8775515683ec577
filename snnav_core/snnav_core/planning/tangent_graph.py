"""Candidate paths by the graph of Ch. 3: points (A), (A'), (B), (B'), (S), (V) and the six rules."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from snnav_core.planning.curves import AreaCurves
from snnav_core.planning.shortest import InitialCircle, initial_circles
from snnav_core.types import FloatArray, PathSource, Pose2D

__all__ = ["Candidate", "chain_length", "rule_candidates"]


@dataclass(frozen=True)
class Candidate:
    """A path before adjustment.

    Parameters
    ----------
    polyline : ndarray, shape (M, 2)
        From the robot to the target [m, map].
    rotation : int
        Side of the initial circle it starts on: +1 left, -1 right.
    source : PathSource
    length : float
        [m].
    """

    polyline: FloatArray
    rotation: int
    source: PathSource
    length: float


@dataclass(frozen=True)
class _Walk:
    """A candidate under way: about to walk along a curve."""

    points: tuple[FloatArray, ...]
    edge: int
    direction: int


def chain_length(polyline: FloatArray) -> float:
    """Length of a polygonal chain [m]."""
    return float(np.linalg.norm(np.diff(polyline, axis=0), axis=1).sum())


def rule_candidates(
    curves: AreaCurves, pose: Pose2D, target: FloatArray, radius: float, spacing: float, limit: int = 32
) -> list[Candidate]:
    """Target-reaching candidate paths, shortest first (Ch. 3, rules 1-6).

    Parameters
    ----------
    curves : AreaCurves
        Component of the reduced area that holds robot and target.
    pose : Pose2D
        Robot [map].
    target : ndarray, shape (2,)
        [m, map].
    radius : float
        Radius of the initial circles [m].
    spacing : float
        Distance of points on arcs [m].
    limit : int
        At most so many candidates (C3-24).

    Notes
    -----
    Deviations: an A-point is left only in the direction of travel (C3-18); a curve may block its own tangent (C3-19);
    tangents at concave stretches are none (C3-20); the S-point is the farthest hit of the ray (C3-22); from a V-point
    the branch with the smaller change of heading is taken (C3-23); one perimeter per curve, every A'-point is visited
    once per direction (C3-24).
    """
    graph = _RuleGraph(curves, pose, np.asarray(target, dtype=np.float64), spacing)
    found: list[Candidate] = []
    for circle in initial_circles(pose, radius):
        found.extend(
            Candidate(polyline, circle.rotation, PathSource.TANGENT_GRAPH, chain_length(polyline))
            for polyline in graph.follow(circle, limit - len(found))
        )
    return sorted(found, key=lambda candidate: candidate.length)


class _RuleGraph:
    def __init__(self, curves: AreaCurves, pose: Pose2D, target: FloatArray, spacing: float) -> None:
        self.curves, self.target, self.spacing = curves, target, spacing
        self.stop_edge = self._farthest_stop(pose.position)
        self.is_tangent = np.zeros(len(curves.starts), dtype=bool)
        if len(curves.corners):
            self.is_tangent[curves.corners] = curves.touches_corner(target[None])[0]

    def _farthest_stop(self, position: FloatArray) -> int:
        """Edge of C_0 that holds the S-point, -1 for none."""
        away = position - self.target
        distance = float(np.linalg.norm(away))
        if distance < 1e-9:
            return -1
        exterior = self.curves.rings[0]
        reach = float(np.linalg.norm(exterior - position, axis=1).max()) + 1.0
        # Seen from far outside, the first hit is the farthest one.
        outside = position + away / distance * reach
        hits = _edge_hits(outside, position, exterior, np.roll(exterior, -1, axis=0))
        return int(np.argmin(hits)) if np.isfinite(hits).any() else -1

    def follow(self, circle: InitialCircle, limit: int) -> list[FloatArray]:
        """All candidates that start on one initial circle."""
        angle, points, _ = circle.departures(self.target[None])
        whole = float(angle[0]) if math.isfinite(float(angle[0])) else 2.0 * math.pi
        arc = circle.arc(whole, self.spacing)
        inside = np.array([self.curves.covers(point) for point in arc])
        if not inside.any():
            return []
        entered = int(np.argmax(inside))
        share, edge = self.curves.first_hits(arc[entered:-1], arc[entered + 1 :])
        crossing = np.flatnonzero(np.isfinite(share))
        finished: list[FloatArray] = []
        pending: list[_Walk] = []
        visited: set[tuple[int, int]] = set()
        if len(crossing):
            first = entered + int(crossing[0])
            hit = arc[first] + float(share[crossing[0]]) * (arc[first + 1] - arc[first])
            walked = np.vstack((arc[: first + 1], hit))
            self._start_at_curve(walked, int(edge[crossing[0]]), pending)
        elif math.isfinite(float(angle[0])) and inside[-1]:
            self._go_straight((arc,), points[0], pending, finished, visited)
        while pending and len(finished) < limit:
            self._walk(pending.pop(), pending, finished, visited)
        return finished

    def _start_at_curve(self, walked: FloatArray, edge: int, pending: list[_Walk]) -> None:
        """Rule 4: from a V-point along the curve, in the direction nearer to the present heading."""
        heading = walked[-1] - walked[-2]
        along = self.curves.ends[edge] - self.curves.starts[edge]
        pending.append(_Walk((walked,), edge, 1 if float(heading @ along) >= 0.0 else -1))

    def _go_straight(
        self,
        points: tuple[FloatArray, ...],
        start: FloatArray,
        pending: list[_Walk],
        finished: list[FloatArray],
        visited: set[tuple[int, int]],
    ) -> None:
        """Rules 2, 3 and 6: from an A- or B-point towards the target; fork where a curve is in the way."""
        share, edge = self.curves.first_hits(start[None], self.target[None])
        if not math.isfinite(float(share[0])):
            finished.append(np.vstack((*points, self.target[None])))
            return
        hit = start + float(share[0]) * (self.target - start)
        for direction in (1, -1):
            if (int(edge[0]), direction) not in visited:
                visited.add((int(edge[0]), direction))
                pending.append(_Walk((*points, hit[None]), int(edge[0]), direction))

    def _walk(
        self, walk: _Walk, pending: list[_Walk], finished: list[FloatArray], visited: set[tuple[int, int]]
    ) -> None:
        """Rules 3 to 5: along a curve until an A-point that can be left, or an S-point."""
        curve, index = self.curves.locate(walk.edge)
        offset, size = int(self.curves.offsets[curve]), len(self.curves.rings[curve])
        steps = np.arange(1, size + 1) if walk.direction == 1 else -np.arange(size)
        order = offset + (index + steps) % size
        vertices = self.curves.starts[order]
        came_from = self.curves.before[order] if walk.direction == 1 else self.curves.ends[order]
        forward = np.einsum("ij,ij->i", vertices - came_from, self.target - vertices) > 0.0
        usable = np.flatnonzero(self.is_tangent[order] & forward)
        if len(usable) == 0:
            return
        last = int(usable[0])
        if curve == 0 and self.stop_edge >= 0:
            # Edge e leads from vertex e to e + 1: walked forwards when vertex e + 1 is reached, backwards at e.
            reached = self.stop_edge + 1 if walk.direction == 1 else self.stop_edge
            if (offset + reached % size) in order[: last + 1] and self.stop_edge != index:
                return
        points = (*walk.points, vertices[: last + 1])
        self._go_straight(points, vertices[last], pending, finished, visited)


def _edge_hits(source: FloatArray, target: FloatArray, starts: FloatArray, ends: FloatArray) -> FloatArray:
    """Share of the segment source -> target at which it crosses each edge, inf for no crossing."""
    direction = target - source
    edge = ends - starts
    offset = starts - source
    denominator = direction[0] * edge[:, 1] - direction[1] * edge[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        along = (offset[:, 0] * edge[:, 1] - offset[:, 1] * edge[:, 0]) / denominator
        across = (offset[:, 0] * direction[1] - offset[:, 1] * direction[0]) / denominator
    hit = (along >= 0.0) & (along <= 1.0) & (across >= 0.0) & (across <= 1.0)
    return np.where(hit, along, np.inf)
