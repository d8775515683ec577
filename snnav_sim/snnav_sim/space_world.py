"""The true world of a scene in space: what rays meet, and how far points are from it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
import shapely
from numba import njit
from numpy.typing import NDArray

from snnav_core.types import FloatArray
from snnav_sim.raycast3d import cast_boxes, cast_prisms, leave_box, mesh_caster
from snnav_sim.scene_types import Circle, Polygon
from snnav_sim.space_types import Box, Mesh, Point3, Prism, Solid, SpaceMover, SpaceScene

__all__ = ["SpaceWorld", "boxes_of", "outline_of", "triangles_of"]

_CIRCLE_CORNERS = 24  # of the circumscribed polygon that stands for a circle (0.9 % of the radius too large)


class SpaceWorld:
    """Ground truth of a scene in space.

    Parameters
    ----------
    scene : SpaceScene
        Its workspace is a closed room.
    """

    def __init__(self, scene: SpaceScene) -> None:
        self.scene = scene
        self.low, self.high = np.array(scene.low), np.array(scene.high)
        still = [body.solid for body in scene.obstacles]
        self.boxes = _boxes([solid for solid in still if isinstance(solid, Box)])
        self._prisms = _prisms([solid for solid in still if isinstance(solid, Prism)])
        meshes = [triangles_of(solid) for solid in still if isinstance(solid, Mesh)]
        self.triangles = np.concatenate([np.zeros((0, 3, 3)), *meshes])
        self._mesh = mesh_caster(self.triangles) if len(self.triangles) else None
        self._moving = [_Moving(mover) for mover in scene.movers]

    def still_ranges(self, origin: FloatArray, rays: FloatArray) -> FloatArray:
        """Return how far rays (R, 3) from a point go to what stands, (R,) [m]."""
        ranges = leave_box(origin, rays, self.low, self.high)
        cast_boxes(origin, rays, self.boxes, ranges)
        cast_prisms(origin, rays, *self._prisms, ranges)
        if self._mesh is not None:
            self._mesh(origin, rays, ranges)
        return ranges

    def shorten(self, origin: FloatArray, rays: FloatArray, time: float, ranges: FloatArray) -> None:
        """Let ranges end at moving bodies where they are at a time [s], in place; 0 for all inside one."""
        for moving in self._moving:
            place = moving.mover.positions(time)[0]
            if moving.clearance((origin - place)[None])[0] <= 0.0:
                ranges[:] = 0.0
                return
            cast_boxes(origin, rays, moving.boxes + np.tile(place, 2), ranges)
            corners, first, heights = moving.prism
            cast_prisms(origin, rays, corners + place[:2], first, heights + place[2], ranges)

    def clearance(self, points: FloatArray, times: float | FloatArray = 0.0) -> FloatArray:
        """Return the distance to the nearest body, floor, wall or ceiling.

        Parameters
        ----------
        points : ndarray, shape (N, 3)
            [m, map]
        times : float or ndarray, shape (N,)
            One for all points or one for each [s].

        Returns
        -------
        ndarray, shape (N,)
            [m]; negative inside a box or prism and outside the workspace. Inside a mesh it is the distance to its
            surface.
        """
        points = np.ascontiguousarray(points, dtype=np.float64).reshape(-1, 3)
        clearance: FloatArray = np.minimum(points - self.low, self.high - points).min(axis=1)
        np.minimum(clearance, self.body_clearance(points), out=clearance)
        times = np.broadcast_to(np.asarray(times, dtype=np.float64), len(points))
        for moving in self._moving:
            relative = points - moving.mover.positions(times)
            np.minimum(clearance, moving.clearance(relative), out=clearance)
        return clearance

    def body_clearance(self, points: FloatArray) -> FloatArray:
        """Return the distance of points (N, 3) to the nearest body that stands, (N,) [m]; inf without any."""
        clearance = np.full(len(points), np.inf)
        for box in self.boxes:
            np.minimum(clearance, box_distance(points, box), out=clearance)
        corners, first, heights = self._prisms
        for index, (low, high) in enumerate(heights.tolist()):
            outline = corners[first[index] : first[index + 1]]
            np.minimum(clearance, prism_distance(points, outline, low, high), out=clearance)
        if len(self.triangles):
            np.minimum(clearance, triangle_distance(points, self.triangles), out=clearance)
        return clearance

    def known_cells(self) -> NDArray[np.uint8]:
        """Return which cells of the grid a body reaches into that is known never to move, (nx, ny, nz)."""
        grid = self.scene.grid
        walls = np.zeros(grid.shape, dtype=np.uint8)
        known = [body.solid for body in self.scene.obstacles if body.known_static]
        tolerance = 1e-6 * grid.spacing
        for box in _boxes([solid for solid in known if isinstance(solid, Box)]):
            first = np.floor((box[:3] - grid.origin + tolerance) / grid.spacing).astype(int)
            last = np.ceil((box[3:] - grid.origin - tolerance) / grid.spacing).astype(int)
            first, last = np.maximum(first, 0), np.minimum(last, grid.shape)
            walls[first[0] : last[0], first[1] : last[1], first[2] : last[2]] = 1
        others = [solid for solid in known if not isinstance(solid, Box)]
        if others:
            centres = grid.centres().reshape(-1, 3)
            for solid in others:
                near = _distance(solid, centres) <= grid.half_diagonal
                walls.reshape(-1)[near] = 1
        return walls


class _Moving:
    """A moving body about its own origin."""

    def __init__(self, mover: SpaceMover) -> None:
        self.mover = mover
        solid = mover.solid
        self.boxes = _boxes([solid] if isinstance(solid, Box) else [])
        self.prism = _prisms([solid] if isinstance(solid, Prism) else [])

    def clearance(self, points: FloatArray) -> FloatArray:
        """Distance of points (N, 3) about its origin [m]."""
        return _distance(self.mover.solid, points)


def boxes_of(box: Box) -> list[tuple[Point3, Point3]]:
    """Return boxes without holes that make up one with holes; they touch and do not overlap."""
    parts = [(box.low, box.high)]
    for low, high in box.holes:
        parts = [piece for part in parts for piece in _cut(part, low, high)]
    return parts


def _cut(part: tuple[Point3, Point3], low: Point3, high: Point3) -> list[tuple[Point3, Point3]]:
    """Return what is left of a box when another one is taken out."""
    begin, end = list(part[0]), list(part[1])
    if any(high[axis] <= begin[axis] or low[axis] >= end[axis] for axis in range(3)):
        return [part]
    pieces = []
    for axis in range(3):
        if low[axis] > begin[axis]:
            top = [*end]
            top[axis] = low[axis]
            pieces.append(((begin[0], begin[1], begin[2]), (top[0], top[1], top[2])))
            begin[axis] = low[axis]
        if high[axis] < end[axis]:
            bottom = [*begin]
            bottom[axis] = high[axis]
            pieces.append(((bottom[0], bottom[1], bottom[2]), (end[0], end[1], end[2])))
            end[axis] = high[axis]
    return pieces


def outline_of(shape: Polygon | Circle) -> FloatArray:
    """Return the corners of an outline (V, 2) [m], of a circle as of a polygon drawn round it."""
    if isinstance(shape, Polygon):
        return shape.points
    angles = np.arange(_CIRCLE_CORNERS) * (2.0 * math.pi / _CIRCLE_CORNERS)
    radius = shape.radius / math.cos(math.pi / _CIRCLE_CORNERS)
    return np.stack((shape.x + radius * np.cos(angles), shape.y + radius * np.sin(angles)), axis=-1)


@lru_cache(maxsize=16)
def _load(file: str) -> FloatArray:
    import trimesh  # takes a second to import

    mesh = trimesh.load_mesh(file)
    triangles = np.ascontiguousarray(mesh.triangles, dtype=np.float64)
    triangles.setflags(write=False)
    return triangles


def triangles_of(mesh: Mesh) -> FloatArray:
    """Return the triangles of a mesh, shape (T, 3, 3) [m]."""
    return _load(mesh.file)


def _boxes(boxes: Sequence[Box]) -> FloatArray:
    return np.array([[*low, *high] for box in boxes for low, high in boxes_of(box)]).reshape(-1, 6)


def _prisms(prisms: Sequence[Prism]) -> tuple[FloatArray, NDArray[np.int64], FloatArray]:
    outlines = [outline_of(prism.outline) for prism in prisms]
    first = np.cumsum([0, *(len(outline) for outline in outlines)]).astype(np.int64)
    heights = np.array([[prism.bottom, prism.top] for prism in prisms]).reshape(-1, 2)
    return np.concatenate([np.zeros((0, 2)), *outlines]), first, heights


def _distance(solid: Solid, points: FloatArray) -> FloatArray:
    """Return the distance of points (N, 3) to a body, (N,) [m]."""
    if isinstance(solid, Mesh):
        return np.asarray(triangle_distance(np.ascontiguousarray(points), triangles_of(solid)))
    if isinstance(solid, Prism):
        return prism_distance(points, outline_of(solid.outline), solid.bottom, solid.top)
    parts = [box_distance(points, box) for box in _boxes([solid])]
    return np.asarray(np.min(parts, axis=0))


def _signed(beyond: FloatArray) -> FloatArray:
    """Return the distance to what is bounded along some directions, by how far points are beyond each, (N, k)."""
    outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
    return np.asarray(outside + np.minimum(beyond.max(axis=1), 0.0))


def box_distance(points: FloatArray, box: FloatArray) -> FloatArray:
    """Return the distance of points (N, 3) to a box (6,), negative inside, (N,) [m]."""
    return _signed(np.maximum(box[:3] - points, points - box[3:]))


def prism_distance(points: FloatArray, outline: FloatArray, low: float, high: float) -> FloatArray:
    """Return the distance of points (N, 3) to a prism over an outline (V, 2), negative inside, (N,) [m]."""
    edge = np.roll(outline, -1, axis=0) - outline
    relative = points[:, None, :2] - outline
    share = np.clip(np.sum(relative * edge, axis=-1) / np.sum(edge * edge, axis=-1), 0.0, 1.0)
    gap = relative - share[..., None] * edge
    level = np.sqrt(np.min(np.sum(gap * gap, axis=-1), axis=1))
    inside = shapely.contains_xy(shapely.Polygon(outline), points[:, 0], points[:, 1])
    beyond = np.maximum(low - points[:, 2], points[:, 2] - high)
    return _signed(np.column_stack((np.where(inside, -level, level), beyond)))


@njit(cache=True, nogil=True)
def triangle_distance(points: FloatArray, triangles: FloatArray) -> FloatArray:  # pragma: no cover - compiled
    """Return the distance of points (N, 3) to the nearest of triangles (T, 3, 3), (N,) [m]."""
    best: FloatArray = np.full(len(points), np.inf)
    for t in range(len(triangles)):
        a = triangles[t, 0]
        u, v = triangles[t, 1] - a, triangles[t, 2] - a
        uu, uv, vv = (u * u).sum(), (u * v).sum(), (v * v).sum()
        area = uu * vv - uv * uv
        for n in range(len(points)):
            w = points[n] - a
            wu, wv, ww = (w * u).sum(), (w * v).sum(), (w * w).sum()
            if area > 0.0:
                one, two = (vv * wu - uv * wv) / area, (uu * wv - uv * wu) / area
                if one >= 0.0 and two >= 0.0 and one + two <= 1.0:
                    flat = ww - one * wu - two * wv
                    best[n] = min(best[n], max(flat, 0.0))
                    continue
            for side in range(3):
                start = triangles[t, side]
                edge = triangles[t, (side + 1) % 3] - start
                gap = points[n] - start
                length = (edge * edge).sum()
                share = min(max((gap * edge).sum() / length, 0.0), 1.0) if length > 0.0 else 0.0
                away = gap - share * edge
                best[n] = min(best[n], (away * away).sum())
    distance: FloatArray = np.sqrt(best)
    return distance
