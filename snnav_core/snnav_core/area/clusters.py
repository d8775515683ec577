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
_CLOSE = 0.2  # [m]; what stands and what moves are one body only where they are nearer than this
_OFF_LINE = 0.05  # [m]; less is in line with a surface
_STEADY = 0.5  # share of the hits on what stands that were there before


def cluster_returns(
    returns: FusedReturns,
    link_distance: float,
    labels: NDArray[np.int64],
    arrived: NDArray[np.bool_],
    leg_distance: float,
    apart: NDArray[np.bool_],
    steady: NDArray[np.bool_],
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
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
    steady : ndarray of bool, shape (K,)
        Whether the same beams measured the same for a while. What stands is not linked to what may move.

    Returns
    -------
    numbers : ndarray of int, shape (K,)
        0, 1, ...
    stands : ndarray of bool, shape (K,)
        Whether nothing has arrived on what was hit, and most of it was there before.
    """
    count = len(returns)
    if count == 0:
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.bool_)
    next_one = np.flatnonzero(np.diff(returns.surfaces) == 0)
    pairs = np.column_stack((next_one, next_one + 1))
    first, second = labels[pairs[:, 0]], labels[pairs[:, 1]]
    pairs = pairs[(first == second) | (first < 0) | (second < 0)]
    spots, inside = _spots(returns.points, labels, arrived)
    near = cKDTree(returns.points[spots]).query_pairs(link_distance, output_type="ndarray").reshape(-1, 2)
    near = spots[near]
    first, second = labels[near[:, 0]], labels[near[:, 1]]
    near = near[(first == second) | (first < 0) | (second < 0)]
    close = np.hypot(*(returns.points[near[:, 0]] - returns.points[near[:, 1]]).T) < _CLOSE
    stands = _standing(_components(count, np.concatenate((pairs, inside, near[close]))), arrived, steady)
    near = near[(stands[near[:, 0]] == stands[near[:, 1]]) | _in_line(returns, near, stands)]
    pairs = np.concatenate((pairs, inside, near))
    moved = spots[arrived[spots]]
    if len(moved) > 1:
        legs = cKDTree(returns.points[moved]).query_pairs(leg_distance, output_type="ndarray").reshape(-1, 2)
        legs = moved[legs]
        first, second = labels[legs[:, 0]], labels[legs[:, 1]]
        settled = np.append(apart, False)  # a label of -1 is never settled
        legs = legs[(first == second) | ~(settled[first] & settled[second])]
        pairs = np.concatenate((pairs, legs))
    return _components(count, pairs), stands


def _in_line(returns: FusedReturns, pairs: NDArray[np.int64], stands: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Whether of each pair (M, 2) one lies on the line of the standing surface of the other: it goes on there."""
    first = stands[pairs[:, 0]]
    standing, other = np.where(first, *pairs.T), np.where(first, *pairs.T[::-1])
    normals = returns.normals[standing]
    off = np.sum(normals * (returns.points[other] - returns.points[standing]), axis=1)
    return np.asarray(normals.any(axis=1) & (np.abs(off) < _OFF_LINE), dtype=np.bool_)


def _components(count: int, pairs: NDArray[np.int64]) -> NDArray[np.int64]:
    graph = coo_array((np.ones(len(pairs), dtype=np.int8), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    _, numbers = connected_components(graph, directed=False)
    return np.asarray(numbers, dtype=np.int64)


def _standing(
    parts: NDArray[np.int64], arrived: NDArray[np.bool_], steady: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Whether each hit lies on a part on which nothing has arrived and of which most was there before."""
    none_arrived = np.bincount(parts, weights=arrived) == 0.0
    mostly = np.bincount(parts, weights=steady) >= _STEADY * np.bincount(parts)
    return np.asarray((none_arrived & mostly)[parts], dtype=np.bool_)


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
