"""Hits that belong together: on one surface, or near to each other."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from snnav_core.area.returns import FusedReturns
from snnav_core.types import FloatArray

__all__ = ["cluster_returns"]

_SQUARE = 0.05  # [m]; hits in one square are one where distances between bodies matter


def cluster_returns(
    returns: FusedReturns,
    link_distance: float,
    labels: NDArray[np.int64],
    arrived: NDArray[np.bool_],
    leg_distance: float,
    apart: NDArray[np.bool_],
) -> NDArray[np.int64]:
    """Number the bodies that hits belong to.

    Parameters
    ----------
    returns : FusedReturns
    link_distance : float
        Hits no farther from each other, but for the 5 cm of a square, belong to one body [m].
    labels : ndarray of int, shape (K,)
        What each hit is known to belong to, -1 where nothing is known. Hits with different labels are never linked
        directly: bodies that come near to each other stay apart.
    arrived : ndarray of bool, shape (K,)
        Whether the same beams looked farther shortly before.
    leg_distance : float
        Two hits that have arrived belong to one body up to this distance [m], whatever their labels, ...
    apart : ndarray of bool, shape (L,)
        ... unless both their labels are marked here.

    Returns
    -------
    ndarray of int, shape (K,)
        0, 1, ...
    """
    count = len(returns)
    if count == 0:
        return np.zeros(0, dtype=np.int64)
    next_one = np.flatnonzero(np.diff(returns.surfaces) == 0)
    pairs = np.column_stack((next_one, next_one + 1))
    first, second = labels[pairs[:, 0]], labels[pairs[:, 1]]
    pairs = pairs[(first == second) | (first < 0) | (second < 0)]
    spots, inside = _spots(returns.points, labels, arrived)
    near = cKDTree(returns.points[spots]).query_pairs(link_distance, output_type="ndarray").reshape(-1, 2)
    near = spots[near]
    first, second = labels[near[:, 0]], labels[near[:, 1]]
    near = near[(first == second) | (first < 0) | (second < 0)]
    pairs = np.concatenate((pairs, inside, near))
    moved = spots[arrived[spots]]
    if len(moved) > 1:
        legs = cKDTree(returns.points[moved]).query_pairs(leg_distance, output_type="ndarray").reshape(-1, 2)
        legs = moved[legs]
        first, second = labels[legs[:, 0]], labels[legs[:, 1]]
        settled = np.append(apart, False)  # a label of -1 is never settled
        legs = legs[(first == second) | ~(settled[first] & settled[second])]
        pairs = np.concatenate((pairs, legs))
    graph = coo_array((np.ones(len(pairs), dtype=np.int8), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    _, numbers = connected_components(graph, directed=False)
    return np.asarray(numbers, dtype=np.int64)


def _spots(
    points: FloatArray, labels: NDArray[np.int64], arrived: NDArray[np.bool_]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """One hit for all in the same small square with the same label, and links to it from the others (M, 2).

    Several scanners lay hundreds of hits over each other on a wall; comparing squares keeps the number of pairs small.
    """
    cells = np.floor(points / _SQUARE).astype(np.int64)
    keys = np.column_stack((cells, labels, arrived))
    order = np.lexsort(keys.T)
    fresh = np.concatenate(([True], (np.diff(keys[order], axis=0) != 0).any(axis=1)))
    spots = order[fresh]
    inside = np.column_stack((spots[np.cumsum(fresh) - 1], order))
    return spots, inside[~fresh]
