"""Compiled loops over all pairs of hits of different times, laid over each other."""

from __future__ import annotations

import math

import numba

__all__ = ["densest", "lay_over"]

_SAME_SIDE = 0.7  # cosine between the normals of hits on one place
_SEARCHED, _STEP = 1.0, 0.1  # [m/s] how far around a velocity, and how closely, others are looked at
_WIDE = 0.15  # [m] within which hits count as near each other in that


@numba.njit(cache=True, nogil=True)
def densest(points, normals, times, offsets, around):  # type: ignore[no-untyped-def]
    """The velocity around another one at which most hits lie over those of other samples."""
    groups, best, found = offsets.shape[0] - 1, -1.0, around.copy()
    count = int(round(_SEARCHED / _STEP))
    for a in range(-count, count + 1):
        for b in range(-count, count + 1):
            vx, vy, total = around[0] + a * _STEP, around[1] + b * _STEP, 0.0
            for g in range(groups):
                for i in range(offsets[g], offsets[g + 1]):
                    for h in range(groups):
                        nearest = _WIDE * _WIDE
                        if h == g:
                            continue
                        for j in range(offsets[h], offsets[h + 1]):
                            passed = times[j] - times[i]
                            dx = points[j, 0] - points[i, 0] - vx * passed
                            dy = points[j, 1] - points[i, 1] - vy * passed
                            alike = normals[i, 0] * normals[j, 0] + normals[i, 1] * normals[j, 1]
                            if alike > _SAME_SIDE:
                                nearest = min(nearest, dx * dx + dy * dy)
                        total += 1.0 - nearest / (_WIDE * _WIDE)
            if total > best:
                best = total
                found[0], found[1] = vx, vy
    return found


@numba.njit(cache=True, nogil=True)
def lay_over(points, normals, baselines, times, offsets, velocity, gate, scale):  # type: ignore[no-untyped-def]
    """Normal equations of the velocity over all pairs of samples: xx, xy, yy, bx, by, squares, weight, leaning."""
    xx = xy = yy = bx = by = squares = total = leaning = 0.0
    groups = offsets.shape[0] - 1
    for g in range(groups):
        for i in range(offsets[g], offsets[g + 1]):
            for h in range(groups):
                if h == g:
                    continue
                best, found = gate * gate, -1
                for j in range(offsets[h], offsets[h + 1]):
                    passed = times[j] - times[i]
                    dx = points[j, 0] - points[i, 0] - velocity[0] * passed
                    dy = points[j, 1] - points[i, 1] - velocity[1] * passed
                    square = dx * dx + dy * dy
                    if square < best and (
                        normals[i, 0] * normals[j, 0] + normals[i, 1] * normals[j, 1] > _SAME_SIDE
                    ):
                        best, found = square, j
                if found < 0:
                    continue
                passed = times[found] - times[i]
                nx, ny = normals[i, 0] + normals[found, 0], normals[i, 1] + normals[found, 1]
                length = math.sqrt(nx * nx + ny * ny)
                nx, ny = nx / length, ny / length
                along = nx * (points[found, 0] - points[i, 0]) + ny * (points[found, 1] - points[i, 1])
                rest = along - passed * (nx * velocity[0] + ny * velocity[1])
                weight = 0.5 / (1.0 + (rest / scale) ** 2)  # every pair is met from both sides
                xx += weight * passed * passed * nx * nx
                xy += weight * passed * passed * nx * ny
                yy += weight * passed * passed * ny * ny
                bx += weight * passed * nx * along
                by += weight * passed * ny * along
                squares += weight * rest * rest
                total += weight
                lean = 1.0 / baselines[i] ** 2 + 1.0 / baselines[found] ** 2
                leaning += 0.25 * weight * passed * passed * lean
    return xx, xy, yy, bx, by, squares, total, leaning
