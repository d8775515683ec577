"""Where rays from one point meet boxes, prisms, spheres and triangles; ranges shrink in place."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable

import numpy as np
from numba import njit
from numpy.typing import NDArray

from snnav_core.types import FloatArray

__all__ = ["cast_boxes", "cast_prisms", "cast_spheres", "cast_triangles", "leave_box", "mesh_caster"]

_FAR = 1e30  # [m]; embree answers a ray that hits nothing with more


def leave_box(origin: FloatArray, rays: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """Return where rays (R, 3) from a point inside or on a box leave it, (R,) [m]."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ways = np.where(rays > 0.0, (high - origin) / rays, (low - origin) / rays)
    ways[rays == 0.0] = np.inf
    return np.asarray(np.maximum(ways.min(axis=1), 0.0))


@njit(cache=True, nogil=True)
def cast_boxes(
    origin: FloatArray, rays: FloatArray, boxes: FloatArray, ranges: FloatArray
) -> None:  # pragma: no cover - compiled
    """Let ranges end at upright boxes, by slabs.

    Parameters
    ----------
    origin : ndarray, shape (3,)
        [m, map]
    rays : ndarray, shape (R, 3)
        Unit vectors [map].
    boxes : ndarray, shape (K, 6)
        Lowest and highest corners [m, map]; one that holds the origin is not seen.
    ranges : ndarray, shape (R,)
        [m]; changed in place where a box is nearer.
    """
    count = 0
    near = np.empty((len(boxes), 6))
    for k in range(len(boxes)):
        for axis in range(3):
            near[count, axis] = boxes[k, axis] - origin[axis]
            near[count, axis + 3] = boxes[k, axis + 3] - origin[axis]
        outside = False
        for axis in range(3):
            outside = outside or near[count, axis] > 0.0 or near[count, axis + 3] < 0.0
        count += outside
    for n in range(len(rays)):
        ix = 1.0 / rays[n, 0] if rays[n, 0] != 0.0 else 1e300
        iy = 1.0 / rays[n, 1] if rays[n, 1] != 0.0 else 1e300
        iz = 1.0 / rays[n, 2] if rays[n, 2] != 0.0 else 1e300
        best = ranges[n]
        for k in range(count):
            a, b = near[k, 0] * ix, near[k, 3] * ix
            enter, leave = min(a, b), max(a, b)
            a, b = near[k, 1] * iy, near[k, 4] * iy
            enter, leave = max(enter, min(a, b)), min(leave, max(a, b))
            a, b = near[k, 2] * iz, near[k, 5] * iz
            enter, leave = max(enter, min(a, b)), min(leave, max(a, b))
            if 0.0 < enter <= leave and enter < best:
                best = enter
        ranges[n] = best


@njit(cache=True, nogil=True)
def cast_prisms(
    origin: FloatArray,
    rays: FloatArray,
    corners: FloatArray,
    first: NDArray[np.int64],
    heights: FloatArray,
    ranges: FloatArray,
) -> None:  # pragma: no cover - compiled
    """Let ranges end at upright prisms over simple polygons.

    Parameters
    ----------
    origin, rays, ranges
        As in `cast_boxes`.
    corners : ndarray, shape (V, 2)
        Of all polygons, one after the other [m, map].
    first : ndarray of int, shape (P + 1,)
        Where each polygon begins.
    heights : ndarray, shape (P, 2)
        Bottom and top [m, map].
    """
    for p in range(len(heights)):
        outline = corners[first[p] : first[p + 1]]
        low, high = heights[p]
        middle = np.array([outline[:, 0].mean(), outline[:, 1].mean(), 0.5 * (low + high)])
        reach = 0.0
        for v in range(len(outline)):
            reach = max(reach, (outline[v, 0] - middle[0]) ** 2 + (outline[v, 1] - middle[1]) ** 2)
        reach += 0.25 * (high - low) ** 2
        gap = middle - origin
        squared = gap[0] ** 2 + gap[1] ** 2 + gap[2] ** 2
        for n in range(len(rays)):
            along = gap[0] * rays[n, 0] + gap[1] * rays[n, 1] + gap[2] * rays[n, 2]
            if squared - along * along > reach or (along < 0.0 and squared > reach):
                continue
            way = _meet_prism(origin, rays[n], outline, low, high)
            if way < ranges[n]:
                ranges[n] = way


@njit(cache=True, nogil=True)
def _meet_prism(
    origin: FloatArray, ray: FloatArray, outline: FloatArray, low: float, high: float
) -> float:  # pragma: no cover - compiled
    """Least way to a side, the bottom or the top; inf where a ray meets none."""
    best = np.inf
    count = len(outline)
    for v in range(count):
        w = v + 1 if v + 1 < count else 0
        ax, ay = outline[v, 0] - origin[0], outline[v, 1] - origin[1]
        ex, ey = outline[w, 0] - outline[v, 0], outline[w, 1] - outline[v, 1]
        across = ray[0] * ey - ray[1] * ex
        if across == 0.0:
            continue
        way = (ax * ey - ay * ex) / across
        share = (ax * ray[1] - ay * ray[0]) / across
        height = origin[2] + way * ray[2]
        if 0.0 < way < best and 0.0 <= share <= 1.0 and low <= height <= high:
            best = way
    if ray[2] != 0.0:
        way = ((low if ray[2] > 0.0 else high) - origin[2]) / ray[2]
        if 0.0 < way < best:
            x, y = origin[0] + way * ray[0], origin[1] + way * ray[1]
            inside = False
            for v in range(count):
                w = v + 1 if v + 1 < count else 0
                if (outline[v, 1] > y) != (outline[w, 1] > y):
                    slope = (outline[w, 0] - outline[v, 0]) / (outline[w, 1] - outline[v, 1])
                    if x < outline[v, 0] + slope * (y - outline[v, 1]):
                        inside = not inside
            if inside:
                best = way
    return best


@njit(cache=True, nogil=True)
def cast_spheres(
    origin: FloatArray, rays: FloatArray, spheres: FloatArray, ranges: FloatArray
) -> None:  # pragma: no cover - compiled
    """Let ranges end at spheres (K, 4): centre and radius [m, map]; other parameters as in `cast_boxes`."""
    for k in range(len(spheres)):
        gap = spheres[k, :3] - origin
        rest = gap[0] ** 2 + gap[1] ** 2 + gap[2] ** 2 - spheres[k, 3] ** 2
        for n in range(len(rays)):
            along = gap[0] * rays[n, 0] + gap[1] * rays[n, 1] + gap[2] * rays[n, 2]
            inside = along * along - rest
            if along > 0.0 and inside >= 0.0 and rest > 0.0:
                ranges[n] = min(ranges[n], along - np.sqrt(inside))


@njit(cache=True, nogil=True)
def cast_triangles(
    origin: FloatArray, rays: FloatArray, triangles: FloatArray, ranges: FloatArray
) -> None:  # pragma: no cover - compiled
    """Let ranges end at triangles (T, 3, 3) [m, map]; other parameters as in `cast_boxes`."""
    for t in range(len(triangles)):
        a = triangles[t, 0] - origin
        u, v = triangles[t, 1] - triangles[t, 0], triangles[t, 2] - triangles[t, 0]
        nx, ny, nz = u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]
        level = a[0] * nx + a[1] * ny + a[2] * nz
        for n in range(len(rays)):
            rx, ry, rz = rays[n, 0], rays[n, 1], rays[n, 2]
            down = rx * nx + ry * ny + rz * nz
            if down == 0.0:
                continue
            way = level / down
            if way <= 0.0 or way >= ranges[n]:
                continue
            # w = way ray - a, in the plane; its shares of u and v
            cx, cy, cz = ry * a[2] - rz * a[1], rz * a[0] - rx * a[2], rx * a[1] - ry * a[0]
            one = -(v[0] * cx + v[1] * cy + v[2] * cz) / down
            two = (u[0] * cx + u[1] * cy + u[2] * cz) / down
            if one >= 0.0 and two >= 0.0 and one + two <= 1.0:
                ranges[n] = way


def mesh_caster(triangles: FloatArray) -> Callable[[FloatArray, FloatArray, FloatArray], None]:
    """Return a function (origin, rays, ranges) that lets ranges end at many triangles (T, 3, 3) [m, map].

    By embree where its package has a wheel for this machine, else by `cast_triangles`.
    """
    if importlib.util.find_spec("embreex") is None:
        return lambda origin, rays, ranges: cast_triangles(origin, rays, triangles, ranges)
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    scene = EmbreeScene()
    TriangleMesh(scene, triangles.astype(np.float32))

    def cast(origin: FloatArray, rays: FloatArray, ranges: FloatArray) -> None:
        begin = np.broadcast_to(origin.astype(np.float32), rays.shape).copy()
        ways = scene.run(begin, rays.astype(np.float32), query="DISTANCE")
        np.minimum(ranges, np.where(ways < _FAR, ways, np.inf), out=ranges)

    return cast
