"""Complete search: the shortest way to the target over a reduced area, from the robot's initial circles (C3-25)."""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numba
import numpy as np

from snnav_core.planning.curves import AreaCurves
from snnav_core.types import FloatArray, Pose2D

__all__ = ["GoalTree", "InitialCircle", "initial_circles"]

_CHUNK = 64
_FEW = 8  # nodes to which lines of sight are drawn at once, nearest by the whole way first


@dataclass(frozen=True)
class InitialCircle:
    """Circle that the robot can follow from its present pose (Ch. 3, initial circles).

    Parameters
    ----------
    centre : ndarray, shape (2,)
        [m, map].
    radius : float
        [m].
    rotation : int
        +1 when it is driven counter-clockwise (circle to the left), -1 clockwise.
    start_angle : float
        Direction from the centre to the robot [rad, map].
    """

    centre: FloatArray
    radius: float
    rotation: int
    start_angle: float

    def arc(self, angle: float, spacing: float) -> FloatArray:
        """Points from the robot along the circle, over the driven angle [rad], about `spacing` [m] apart."""
        count = max(1, math.ceil(angle * self.radius / spacing))
        swept = self.start_angle + self.rotation * np.linspace(0.0, angle, count + 1)
        return self.centre + self.radius * np.column_stack((np.cos(swept), np.sin(swept)))

    def departures(self, targets: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Where to leave the circle along its tangent towards each target (Ch. 3, B-point; C3-21).

        Parameters
        ----------
        targets : ndarray, shape (N, 2)
            [m, map].

        Returns
        -------
        angle : ndarray, shape (N,)
            Driven angle up to the tangent point [rad], in [0, 2 pi); NaN for targets inside the circle.
        points : ndarray, shape (N, 2)
            Tangent points [m, map].
        length : ndarray, shape (N,)
            From the tangent point to the target [m].
        """
        offset = targets - self.centre
        distance = np.linalg.norm(offset, axis=1)
        with np.errstate(invalid="ignore", divide="ignore"):
            opening = np.arccos(self.radius / distance)
        direction = np.arctan2(offset[:, 1], offset[:, 0]) - self.rotation * opening
        angle = np.mod(self.rotation * (direction - self.start_angle), 2.0 * math.pi)
        # A robot that heads for the target exactly would otherwise turn once around.
        angle = np.where(angle > 2.0 * math.pi - 1e-6, 0.0, angle)
        points = self.centre + self.radius * np.column_stack((np.cos(direction), np.sin(direction)))
        return angle, points, np.sqrt(np.maximum(distance**2 - self.radius**2, 0.0))


def initial_circles(pose: Pose2D, radius: float) -> tuple[InitialCircle, InitialCircle]:
    """The two circles of the given radius [m] that touch the robot's heading at its position: left, then right."""
    circles = []
    for rotation in (1, -1):
        normal = pose.heading + rotation * 0.5 * math.pi
        centre = pose.position + radius * np.array([math.cos(normal), math.sin(normal)])
        circles.append(InitialCircle(centre, radius, rotation, normal + math.pi))
    return circles[0], circles[1]


@numba.njit(cache=True, nogil=True)
def _shortest_distances(offsets, neighbours, lengths, to_goal):  # type: ignore[no-untyped-def]
    """Dijkstra from the goal, node `len(to_goal)`: distances of all nodes (inf: no way), and the next on the way."""
    goal = len(to_goal)
    distance = np.full(goal + 1, np.inf)
    before = np.full(goal + 1, -1)
    done = np.zeros(goal + 1, dtype=np.bool_)
    distance[goal] = 0.0
    open_nodes = [(0.0, goal)]
    while len(open_nodes) > 0:
        so_far, node = heapq.heappop(open_nodes)
        if done[node]:
            continue
        done[node] = True
        if node == goal:
            for corner in range(goal):
                if to_goal[corner] < np.inf:
                    distance[corner], before[corner] = to_goal[corner], goal
                    heapq.heappush(open_nodes, (to_goal[corner], corner))
            continue
        for k in range(offsets[node], offsets[node + 1]):
            other, length = neighbours[k], so_far + lengths[k]
            if length < distance[other]:
                distance[other], before[other] = length, node
                heapq.heappush(open_nodes, (length, other))
    return distance, before


class GoalTree:
    """Shortest distances to a target from all corners of a reduced area.

    Parameters
    ----------
    curves : AreaCurves
        Component that holds the target.
    target : ndarray, shape (2,)
        [m, map].
    """

    def __init__(self, curves: AreaCurves, target: FloatArray) -> None:
        self.curves = curves
        self.target = np.asarray(target, dtype=np.float64)
        corners = curves.starts[curves.corners]
        self.nodes: FloatArray = np.vstack((corners, self.target))
        to_goal = np.linalg.norm(corners - self.target, axis=1)
        to_goal[~self._sees(self.target)[:-1]] = math.inf
        self.distance: FloatArray
        self.distance, self._before = _shortest_distances(*curves.neighbours, to_goal)

    def _sees(self, point: FloatArray) -> np.ndarray:
        """Which nodes (corners, then the target) are seen from a point, tangent at the corner."""
        seen = np.zeros(len(self.nodes), dtype=bool)
        where = np.flatnonzero(self._touched(point))
        seen[where] = self._reached(point, where)
        return seen

    def _touched(self, point: FloatArray) -> np.ndarray:
        """At which nodes a line from a point is tangent; always at the target."""
        corners = self.curves.corners
        tangent = self.curves.touches_corner(point[None])[0] if len(corners) else np.empty(0, dtype=bool)
        return np.append(tangent, True)

    def _reached(self, point: FloatArray, nodes: np.ndarray) -> np.ndarray:
        """To which of some nodes a line from a point crosses no curve."""
        share, _ = self.curves.first_hits(np.broadcast_to(point, (len(nodes), 2)), self.nodes[nodes])
        return np.isinf(share)

    def chain(self, node: int) -> FloatArray:
        """Corners from a node to the target, both included, shape (M, 2) [m, map]."""
        goal = len(self.nodes) - 1
        order = [node]
        while order[-1] != goal:
            order.append(int(self._before[order[-1]]))
        return self.nodes[order]

    def from_point(self, point: FloatArray) -> FloatArray | None:
        """Shortest chain from a point of the component to the target, whatever the heading; None without any."""
        length = np.linalg.norm(self.nodes - point, axis=1) + self.distance
        possible = np.flatnonzero(self._touched(point) & np.isfinite(length))
        order = possible[np.argsort(length[possible], kind="stable")]
        for begin in range(0, len(order), _FEW):
            chunk = order[begin : begin + _FEW]
            seen = np.flatnonzero(self._reached(point, chunk))
            if len(seen):
                return np.vstack((point, self.chain(int(chunk[seen[0]]))))
        return None

    def options(self, circle: InitialCircle, climb: float) -> Iterator[tuple[float, float, FloatArray]]:
        """Ways to leave an initial circle towards a node, shortest first.

        Parameters
        ----------
        circle : InitialCircle
        climb : float
            Length of the straight part, from its start on, that may lie outside the area [m].

        Yields
        ------
        length, angle, chain
            Whole length [m], driven angle on the circle [rad], points (M, 2) [m, map] from the tangent point on. The
            straight part crosses no curve; the arc is not tested.
        """
        angle, points, straight = circle.departures(self.nodes)
        total = circle.radius * angle + straight + self.distance
        if len(self.nodes) > 1:
            total[:-1][~self._passes_outside(points[:-1])] = math.inf
        order = np.argsort(total, kind="stable")
        order = order[np.isfinite(total[order])]
        for begin in range(0, len(order), _CHUNK):
            chunk = order[begin : begin + _CHUNK]
            # Seen from the node: a start outside of the area is crossed last.
            share, _ = self.curves.first_hits(self.nodes[chunk], points[chunk])
            left = (1.0 - np.where(np.isfinite(share), share, 1.0)) * straight[chunk]
            for i in chunk[left <= climb]:
                yield float(total[i]), float(angle[i]), np.vstack((points[i], self.chain(int(i))))

    def _passes_outside(self, points: FloatArray) -> np.ndarray:
        """Whether the line from each point (N, 2) to its corner touches that corner from outside."""
        corners = self.curves.corners
        corner = self.nodes[:-1]
        line = corner - points
        back, ahead = self.curves.before[corners] - corner, self.curves.ends[corners] - corner
        with np.errstate(
            invalid="ignore"
        ):  # NaN where the circle has no tangent through the node: not outside
            ca = line[:, 0] * back[:, 1] - line[:, 1] * back[:, 0]
            cb = line[:, 0] * ahead[:, 1] - line[:, 1] * ahead[:, 0]
            return np.asarray(ca * cb >= -1e-9)
