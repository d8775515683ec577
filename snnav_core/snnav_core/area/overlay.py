"""Union, difference and intersection that do not fail on nearly degenerate outlines.

GEOS may refuse outlines whose edges almost coincide, as thousands of beams give them (TopologyException). Then the same
is computed once more on a grid, which never fails and moves no point by more than 0.1 um; reserves of millimetres cover
that.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import shapely
from shapely.errors import GEOSException
from shapely.geometry.base import BaseGeometry

__all__ = ["difference", "intersection", "union", "union_all"]

_GRID = 1e-7  # [m]


def union(first: BaseGeometry, second: BaseGeometry) -> BaseGeometry:
    """Points of either geometry [m]."""
    return _robust(shapely.union, first, second)


def union_all(geometries: Sequence[BaseGeometry] | np.ndarray) -> BaseGeometry:
    """Points of any of the geometries [m]."""
    return _robust(shapely.union_all, np.asarray(geometries, dtype=object))


def difference(first: BaseGeometry, second: BaseGeometry) -> BaseGeometry:
    """Points of the first geometry that are not in the second [m]."""
    return _robust(shapely.difference, first, second)


def intersection(first: BaseGeometry, second: BaseGeometry) -> BaseGeometry:
    """Points of both geometries [m]."""
    return _robust(shapely.intersection, first, second)


def _robust(operation: Callable[..., Any], *operands: Any) -> BaseGeometry:
    try:
        result: BaseGeometry = operation(*operands)
    except GEOSException:
        result = operation(*(shapely.make_valid(operand) for operand in operands), grid_size=_GRID)
    return result
