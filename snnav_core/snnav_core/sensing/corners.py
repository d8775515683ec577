"""Corners of obstacles that no beam hit: surfaces are continued between the beams, towards the sensor only."""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

from snnav_core.types import FloatArray

__all__ = ["continue_surfaces"]

_BASELINE = 3  # wedges that the direction of a surface is taken from, at most
_LEAST = 1e-4  # [m]; a smaller difference is no other surface
_LARGEST_CORNER = 8.0  # a corner stands out by at most this multiple of the gap between two beams
_UNSEEN = 0.5  # a right angle or a disk stands out of a chord by at most this share of it
_LEAST_SHARE = 0.05  # of the nearer return: no wedge is cut off altogether, which would leave no polygon
_UNSURE, _STRAIGHT, _CURVED = 0, 1, 2  # shapes of a surface
_SMOOTH = 3.0  # a disk bends from beam to beam by at most this multiple of its last bend


def continue_surfaces(
    lengths: FloatArray,
    measured: FloatArray,
    directions: FloatArray,
    jump: NDArray[np.bool_],
    closed: bool,
    tolerance: float = 0.0,
) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """Cap every wedge between two beams by the surfaces on both sides of it.

    The chord between two neighbouring returns cuts off what stands out between them: a convex corner by up to half the
    gap at a right angle (6.5 cm at 15 m and 0.5 degrees), the rim of a body in front of another one by up to the limit
    of a range jump. The line through the returns before the wedge and the one through those behind it tell:

    - one of them leads to the return behind the wedge: one surface, the chord,
    - both are straight and meet between the beams, nearer than the chord: a convex corner,
    - else each body may go on through the wedge: neither line is crossed.

    A return in front of the line through its neighbours begins a surface of its own, and one behind it may belong to
    another body, unless it bends no more than before (a disk). Such a surface, met by one beam for all one knows,
    stands out by up to half the chord: then the wedge ends in front of all right angles over the chord. At a range jump
    it ends half a gap in front of the shorter beam.

    Parameters
    ----------
    lengths : ndarray, shape (W, 2)
        Free length at both beams of each wedge [m].
    measured : ndarray, shape (W + 1,)
        Free length of every beam up to the surface that it hit [m]; 0 where nothing was seen, infinite where the beam
        ended free.
    directions : ndarray, shape (W + 1, 2)
        Unit vectors of the beams, counter-clockwise; the last repeats the first when the fan is closed.
    jump : ndarray of bool, shape (W,)
        Whether the two beams of a wedge, as measured, ended on different surfaces.
    closed : bool
    tolerance : float
        A line leads to a return that it misses by this or less: noise explains the difference [m].

    Returns
    -------
    lengths : ndarray, shape (W, 2)
        Not longer than before.
    corners : ndarray, shape (W, 2)
        Corner within each wedge, from the sensor [m].
    found : ndarray of bool, shape (W,)
        Whether there is one; then it is nearer than the chord.

    Notes
    -----
    Exact where two straight sides meet that three beams or more hit, conservative for convex bodies: a line through two
    points of one stays outside of it beyond them. What cannot be known from beams (C3-7): bodies and tips thinner than
    the gap between two beams, and by how much a corner sharper than 90 degrees stands out of which one beam alone met a
    side, or of which a side is so steep that its returns are range jumps (11 degrees to the beams). Noise beyond the
    tolerance turns the lines; what it adds is obstacle, never free space.
    """
    result = _continue(lengths, measured, directions, jump, closed, max(tolerance, _LEAST))
    return result[0], result[1], result[2]


@numba.njit(cache=True)
def _continue(lengths, measured, directions, jump, closed, tolerance):  # type: ignore[no-untyped-def]
    wedges = lengths.shape[0]
    result = lengths.copy()
    corners = np.zeros((wedges, 2))
    found = np.zeros(wedges, dtype=np.bool_)
    for k in range(wedges):
        near, far = measured[k], measured[k + 1]
        if near <= 0.0 or far <= 0.0 or (math.isinf(near) and math.isinf(far)):
            continue
        left, left_shape, u, past = _line(measured, directions, jump, closed, k, -1, tolerance)
        right, right_shape, w, before = _line(measured, directions, jump, closed, k + 1, 1, tolerance)
        first, second = directions[k], directions[k + 1]
        if jump[k]:
            near = far = min(near, far) * (1.0 - _UNSEEN * _sine(first, second))
        elif (left and abs(past - far) <= tolerance) or (right and abs(before - near) <= tolerance):
            continue
        elif left_shape == _STRAIGHT and right_shape == _STRAIGHT:
            p, q = result[k, 0] * first, result[k, 1] * second
            x, y = _corner(near * first, far * second, u, w, min(near, far) * _sine(first, second))
            # The beams may have been shortened since: only a corner nearer than the present chord counts.
            if (q[0] - p[0]) * (y - p[1]) - (q[1] - p[1]) * (x - p[0]) > 0.0 and (x != 0.0 or y != 0.0):
                corners[k, 0], corners[k, 1] = x, y
                found[k] = True
            if x != 0.0 or y != 0.0:
                continue
        elif left_shape == _UNSURE or right_shape == _UNSURE:
            near, far = _in_front_of_right_angles(near, far, first, second)
        if before < near - tolerance:
            near = before
        if past < far - tolerance:
            far = past
        least = _LEAST_SHARE * min(measured[k], measured[k + 1])
        result[k, 0] = min(result[k, 0], max(near, least))
        result[k, 1] = min(result[k, 1], max(far, least))
    return result, corners, found


@numba.njit(cache=True)
def _in_front_of_right_angles(near, far, first, second):  # type: ignore[no-untyped-def]
    """Lengths of both beams of a wedge in front of all right angles over the chord, which lie on a circle."""
    sine = _sine(first, second)
    flat = min(near, far) * (1.0 - _UNSEEN * sine)
    chord = math.hypot(far * second[0] - near * first[0], far * second[1] - near * first[1])
    parallel = 1.0 - _UNSEEN * chord * chord / (
        near * far * sine
    )  # to the chord, half of its length in front
    if parallel * (near + far) > 2.0 * flat:
        return parallel * near, parallel * far
    return flat, flat


@numba.njit(cache=True)
def _line(measured, directions, jump, closed, beam, side, tolerance):  # type: ignore[no-untyped-def]
    """Line on which the surface at a beam arrives there, coming from `side` (-1: lower beams, 1: higher).

    Returns whether there is one, what shape its surface has, its direction, and where it meets the beam on the other
    side of the wedge: the nearest of those over one, two and three wedges, of which the longest is the least noisy.
    """
    wedges = jump.shape[0]
    direction = (0.0, 0.0)
    reach, known, turn, turn_before = math.inf, 0, math.inf, 0.0
    if math.isinf(measured[beam]):
        return False, _UNSURE, direction, reach
    onto = directions[beam - side]
    x, y = np.empty(_BASELINE + 1), np.empty(_BASELINE + 1)
    x[0], y[0] = measured[beam] * directions[beam, 0], measured[beam] * directions[beam, 1]
    for j in range(_BASELINE):
        wedge = beam - 1 - j if side < 0 else beam + j
        if closed:
            wedge %= wedges
        elif wedge < 0 or wedge >= wedges:
            break
        if jump[wedge] or measured[wedge] <= 0.0 or measured[wedge + 1] <= 0.0:
            break
        reached = wedge if side < 0 else wedge + 1
        x[j + 1], y[j + 1] = (
            measured[reached] * directions[reached, 0],
            measured[reached] * directions[reached, 1],
        )
        if j == 1:
            turn = _excess(x[2], y[2], x[1], y[1], directions[beam], measured[beam])
        elif j == 2:
            middle = beam - 1 if side < 0 else beam + 1
            if closed:
                middle %= wedges
            turn_before = _excess(x[3], y[3], x[2], y[2], directions[middle], measured[middle])
        ux, uy = x[0] - x[j + 1], y[0] - y[j + 1]
        meets = _along_beam(x[0], y[0], ux, uy, onto[0], onto[1])
        if known == 0 or meets <= reach + tolerance:
            direction, reach = (ux, uy), meets
        known = j + 1
    if abs(turn) <= 2.0 * tolerance:
        return True, _STRAIGHT, direction, reach
    if turn * turn_before > 0.0 and abs(turn) <= _SMOOTH * abs(turn_before):
        return True, _CURVED, direction, reach
    if turn < 0.0:
        return False, _UNSURE, direction, math.inf  # a surface in front begins here
    return known > 0, _UNSURE, direction, reach


@numba.njit(cache=True)
def _excess(ax, ay, bx, by, beam, measured):  # type: ignore[no-untyped-def]
    """By how much a return is behind the line through the two before it, seen from the sensor [m]."""
    return measured - _along_beam(bx, by, bx - ax, by - ay, beam[0], beam[1])


@numba.njit(cache=True)
def _sine(a, b):  # type: ignore[no-untyped-def]
    return a[0] * b[1] - a[1] * b[0]


@numba.njit(cache=True)
def _corner(a, b, u, w, gap):  # type: ignore[no-untyped-def]
    """Where the lines a + s u and b + t w meet, if that is between the beams and nearer than the chord; else (0, 0)."""
    denominator = u[0] * w[1] - u[1] * w[0]
    chord = math.hypot(b[0] - a[0], b[1] - a[1])
    if abs(denominator) < 1e-12 or chord < 1e-12:
        return 0.0, 0.0
    s = ((b[0] - a[0]) * w[1] - (b[1] - a[1]) * w[0]) / denominator
    t = ((b[0] - a[0]) * u[1] - (b[1] - a[1]) * u[0]) / denominator
    x, y = a[0] + s * u[0], a[1] + s * u[1]
    height = ((b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])) / chord
    between = a[0] * y - a[1] * x > 0.0 and x * b[1] - y * b[0] > 0.0
    if s <= 0.0 or t <= 0.0 or height < _LEAST or not between:
        return 0.0, 0.0
    if height > _LARGEST_CORNER * gap:
        share = _LARGEST_CORNER * gap / height
        mx, my = 0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])
        x, y = mx + share * (x - mx), my + share * (y - my)
    return x, y


@numba.njit(cache=True)
def _along_beam(px, py, ux, uy, dx, dy):  # type: ignore[no-untyped-def]
    """Distance from the sensor at which the line p + s u, s > 0, meets the beam along d; infinite for none."""
    denominator = ux * dy - uy * dx
    if abs(denominator) < 1e-12:
        return math.inf
    s = (py * dx - px * dy) / denominator
    if s <= 0.0:
        return math.inf
    reach = (px + s * ux) * dx + (py + s * uy) * dy
    return reach if reach > 0.0 else math.inf
