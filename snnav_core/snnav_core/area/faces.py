"""Motion of a body from its faces: hits of all times, laid over each other, lie on a few lines."""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

from snnav_core.types import FloatArray

__all__ = ["face_information", "on_faces"]

_REACH = 0.6  # [m] from hit to hit on one face
_OFF = 4.0  # deviations of a range by which a hit may lie off its face
_MOST_BESIDE = 0.03  # [m]
_FACING = 0.05  # cosine between the normal of a face and the way back to a sensor that sees it
_LEAST_HITS = 4
_LEAST_BASE = 4.0  # times the tolerance: nearer hits do not tell where a face leads
_ROUNDS = 4  # in which a face grows
_LEAST_BENT = 8  # hits, from which a face may be found to be bent
_BENT = 3.0  # deviations by which a curvature is significant
_LEAST_SQUARE = 1e-4  # share of a column that others do not explain


def face_information(
    points: FloatArray,
    normals: FloatArray,
    beams: FloatArray,
    times: FloatArray,
    velocity: FloatArray,
    range_noise: float,
    deviation: float = 0.0,
) -> tuple[FloatArray, FloatArray]:
    """What hits on faces tell of a velocity that is nearly known.

    Of every face place and angle are unknown, and its curvature where it is bent: what is left of the motion square to
    it, when hits of all times are taken together, counts. Few hits on a face that beams graze tell by that what no
    pairs of them would.

    Parameters
    ----------
    points, normals, beams : ndarray, shape (n, 2)
        Hits [m, map], unit normals of their surfaces (0, 0 where none is known), unit vectors of the beams.
    times : ndarray, shape (n,)
        [s]
    velocity : ndarray, shape (2,)
        Where it is sought [m/s].
    range_noise : float
        Standard deviation of a range [m].
    deviation : float
        Of the velocity, where it is sought [m/s]: by that hits of one face may lie beside each other.

    Returns
    -------
    information, pull : ndarray, shapes (2, 2), (2,)
    """
    since = times - times.mean()
    laid = points - since[:, None] * velocity
    tolerance = _OFF * range_noise + min(_MOST_BESIDE, deviation * float(since.std()))
    numbers, ways = _grow_faces(laid, normals, beams, tolerance)
    information, pull = np.zeros((2, 2)), np.zeros(2)
    for face, way in enumerate(ways):
        own = numbers == face
        told = _told(laid[own], since[own], way, range_noise)
        if told is not None:
            weight, speed = told
            information += weight * np.outer(way, way)
            pull += weight * (speed + float(way @ velocity)) * way
    return information, pull


def on_faces(
    points: FloatArray, normals: FloatArray, beams: FloatArray, range_noise: float
) -> NDArray[np.int64]:
    """Number of the face that each hit (n, 2) on a body lies on, its motion undone; -1 for none."""
    numbers, _ = _grow_faces(points, normals, beams, _OFF * range_noise)
    return np.asarray(numbers, dtype=np.int64)


def _told(
    laid: FloatArray, since: FloatArray, way: FloatArray, range_noise: float
) -> tuple[float, float] | None:
    """Information on the speed square to a face, and how far it is off [m/s]; None where nothing is told."""
    along = laid @ np.array([-way[1], way[0]])
    along -= along.mean()
    off = laid @ way
    straight = np.column_stack((np.ones(len(off)), along))
    found = _slope(straight, since, off, range_noise)
    if found is not None and len(off) >= _LEAST_BENT:
        bend = _slope(np.column_stack((straight, since)), along**2, off, range_noise)
        if bend is not None and abs(bend[1]) > _BENT / math.sqrt(bend[0]):
            found = _slope(np.column_stack((straight, along**2)), since, off, range_noise)
    return found


def _slope(
    besides: FloatArray, column: FloatArray, values: FloatArray, range_noise: float
) -> tuple[float, float] | None:
    """Information on what a column (n,) is multiplied by, and that factor, where others (n, m) are unknown as well."""
    basis, _ = np.linalg.qr(besides)
    own = column - basis @ (basis.T @ column)
    square = float(own @ own)
    if square <= _LEAST_SQUARE * float(column @ column) or len(values) <= besides.shape[1] + 1:
        return None
    factor = float(own @ values) / square
    rest = values - basis @ (basis.T @ values) - factor * own
    variance = max(range_noise**2, float(rest @ rest) / (len(values) - besides.shape[1] - 1))
    return square / variance, factor


@numba.njit(cache=True, nogil=True)
def _grow_faces(points, normals, beams, tolerance):  # type: ignore[no-untyped-def]
    """Number of the face of every hit, -1 for none, and the normals of the faces (F, 2): long ones first."""
    count = points.shape[0]
    numbers = np.full(count, -1)
    near = np.empty(count)
    ways, faces = np.empty((count, 2)), 0
    known = (normals[:, 0] != 0.0) | (normals[:, 1] != 0.0)
    for with_normal in (True, False):  # what is left then is little
        for i in range(count):
            asked = known[i] == with_normal and numbers[i] < 0
            near[i] = _seed(points, normals, beams, numbers, i, tolerance)[0] if asked else 0.0
        for i in np.argsort(-near, kind="mergesort"):
            if near[i] < _LEAST_HITS:
                break
            if numbers[i] >= 0:
                continue
            left, nx, ny = _seed(points, normals, beams, numbers, i, tolerance)
            if left < _LEAST_HITS:
                continue
            members, nx, ny = _grow(points, beams, numbers, i, nx, ny, tolerance)
            if members.sum() < _LEAST_HITS:
                continue
            for j in range(count):
                if members[j]:
                    numbers[j] = faces
            ways[faces, 0], ways[faces, 1] = nx, ny
            faces += 1
    return numbers, ways[:faces]


@numba.njit(cache=True, nogil=True)
def _seed(points, normals, beams, numbers, i, tolerance):  # type: ignore[no-untyped-def]
    """Number of hits in line with one: by its normal, or with the other one with which most are; and the normal."""
    nx, ny = normals[i, 0], normals[i, 1]
    if nx != 0.0 or ny != 0.0:
        return _near_line(points, beams, numbers, i, nx, ny, tolerance), nx, ny
    most = 0
    for j in range(points.shape[0]):
        dx, dy = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1]
        length = math.sqrt(dx * dx + dy * dy)
        if numbers[j] >= 0 or length > _REACH or length < _LEAST_BASE * tolerance:
            continue
        sign = -1.0 if dx * beams[i, 1] - dy * beams[i, 0] > 0.0 else 1.0
        wx, wy = -sign * dy / length, sign * dx / length
        near = _near_line(points, beams, numbers, i, wx, wy, tolerance)
        if near > most:
            most, nx, ny = near, wx, wy
    return most, nx, ny


@numba.njit(cache=True, nogil=True)
def _near_line(points, beams, numbers, seed, nx, ny, tolerance):  # type: ignore[no-untyped-def]
    """Number of hits near another one and on a line through it."""
    near = 0
    for j in range(points.shape[0]):
        dx, dy = points[j, 0] - points[seed, 0], points[j, 1] - points[seed, 1]
        if (
            numbers[j] < 0
            and abs(nx * dx + ny * dy) < tolerance
            and dx * dx + dy * dy < _REACH * _REACH
            and nx * beams[j, 0] + ny * beams[j, 1] < -_FACING
        ):
            near += 1
    return near


@numba.njit(cache=True, nogil=True)
def _grow(points, beams, numbers, seed, nx, ny, tolerance):  # type: ignore[no-untyped-def]
    """Hits on the face around a seed, and its normal."""
    count = points.shape[0]
    cx, cy, low, high = points[seed, 0], points[seed, 1], -_REACH, _REACH
    members = np.zeros(count, dtype=np.bool_)
    for _ in range(_ROUNDS):
        members[:] = False
        number, mx, my, first, last = 0, 0.0, 0.0, np.inf, -np.inf
        for j in range(count):
            dx, dy = points[j, 0] - cx, points[j, 1] - cy
            along = nx * dy - ny * dx
            if (
                numbers[j] < 0
                and abs(nx * dx + ny * dy) < tolerance
                and low <= along <= high
                and nx * beams[j, 0] + ny * beams[j, 1] < -_FACING
            ):
                members[j] = True
                number, mx, my = number + 1, mx + dx, my + dy
                first, last = min(first, along), max(last, along)
        if number < 2:
            break
        mx, my = mx / number, my / number
        xx = xy = yy = 0.0
        for j in range(count):
            if members[j]:
                dx, dy = points[j, 0] - cx - mx, points[j, 1] - cy - my
                xx, xy, yy = xx + dx * dx, xy + dx * dy, yy + dy * dy
        angle = 0.5 * math.atan2(2.0 * xy, xx - yy)
        fx, fy = -math.sin(angle), math.cos(angle)
        if fx * nx + fy * ny < 0.0:
            fx, fy = -fx, -fy
        middle = nx * my - ny * mx
        low, high = first - middle - _REACH, last - middle + _REACH
        nx, ny, cx, cy = fx, fy, cx + mx, cy + my
    return members, nx, ny
