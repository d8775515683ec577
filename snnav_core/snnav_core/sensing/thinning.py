"""Fewer points on an outline, never more area: what follows costs in proportion to the points."""

from __future__ import annotations

import numba
import numpy as np

from snnav_core.types import FloatArray

__all__ = ["thin_ring"]

_ONE_LINE = 1e-9  # sine of an angle


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
    ring = np.ascontiguousarray(ring)
    kept: FloatArray = ring[_chosen(ring, tolerance, 0)]
    if len(kept) >= 3 and _turns_back(kept):
        kept = ring[_chosen(ring, tolerance, 1)]
    return kept if len(kept) >= 3 else ring


def _turns_back(ring: FloatArray) -> bool:
    """Whether the outline goes out from its first point and back on the same line: from a sensor along one beam.

    That is what is left of a wedge thinner than the tolerance, and no polygon.
    """
    (out_x, out_y), (on_x, on_y) = np.diff(ring[:3], axis=0).tolist()
    across, along = out_x * on_y - out_y * on_x, out_x * on_x + out_y * on_y
    return bool(along < 0.0 and abs(across) < _ONE_LINE * -along)


@numba.njit(cache=True)
def _chosen(ring, tolerance, first):  # type: ignore[no-untyped-def]
    """Greedy: from every chosen point the longest chord that no point left out lies inside of, or too far outside.

    No point up to the one numbered `first` is left out.
    """
    count = ring.shape[0]
    keep = np.zeros(count, dtype=np.bool_)
    keep[: first + 1] = True
    i = first
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
