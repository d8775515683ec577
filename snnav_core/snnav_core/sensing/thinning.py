"""Fewer points on an outline, never more area: what follows costs in proportion to the points."""

from __future__ import annotations

import numba
import numpy as np

from snnav_core.types import FloatArray

__all__ = ["thin_ring"]


def thin_ring(ring: FloatArray, tolerance: float) -> FloatArray:
    """Leave out points of a ring that a chord replaces from inside.

    Parameters
    ----------
    ring : ndarray, shape (N, 2)
        Open counter-clockwise ring [m] that is a star around some point; the first point stays.
    tolerance : float
        A point is left out only where it is at most this far outside of the chord that replaces it [m].

    Returns
    -------
    ndarray, shape (M, 2)
        A subset of the points in the same order, at least three of three or more. The enclosed region is a subset of
        the given one; a sliver thinner than the tolerance is left as it is.
    """
    if tolerance <= 0.0 or len(ring) < 4:
        return ring
    kept: FloatArray = ring[_chosen(np.ascontiguousarray(ring), tolerance)]
    return kept if len(kept) >= 3 else ring


@numba.njit(cache=True)
def _chosen(ring, tolerance):  # type: ignore[no-untyped-def]
    """Greedy: from every chosen point the longest chord that no point left out lies inside of, or too far outside."""
    count = ring.shape[0]
    keep = np.zeros(count, dtype=np.bool_)
    keep[0] = True
    i = 0
    while i < count - 1:
        best = i + 1
        for j in range(i + 2, min(i + 64, count)):
            dx, dy = ring[j, 0] - ring[i, 0], ring[j, 1] - ring[i, 1]
            limit = tolerance * np.sqrt(dx * dx + dy * dy)
            fits = True
            for m in range(i + 1, j):
                # Negative to the right of the chord: outside.
                across = dx * (ring[m, 1] - ring[i, 1]) - dy * (ring[m, 0] - ring[i, 0])
                along = dx * (ring[m, 0] - ring[i, 0]) + dy * (ring[m, 1] - ring[i, 1])
                if across > 0.0 or across < -limit or along < 0.0 or along > dx * dx + dy * dy:
                    fits = False
                    break
            if fits:
                best = j
            elif j > best + 8:
                break
        keep[best] = True
        i = best
    return keep
