"""Which sensor saw what free last, as a sensor_msgs/PointCloud2 of points on a grid."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from snnav_core.area.planar import UnoccupiedArea
from snnav_core.types import FloatArray
from snnav_ros.convert.cloud import cloud_fields, cloud_to_message

__all__ = ["SEEN_FIELDS", "grid_points", "seen_to_message"]

_SEEN = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("sensor", "<i4"), ("age", "<f4")])

SEEN_FIELDS = cloud_fields(_SEEN)
"""Name, offset [byte] and datatype of every field of `unoccupied_area/seen`."""


def grid_points(area: UnoccupiedArea, spacing: float) -> FloatArray:
    """Return the points (N, 2) [m, map] inside of an area whose coordinates are multiples of a spacing [m]."""
    if area.is_empty:
        return np.empty((0, 2))
    low_x, low_y, high_x, high_y = (bound / spacing for bound in area.region.bounds)
    x = spacing * np.arange(np.ceil(low_x), np.floor(high_x) + 1)
    y = spacing * np.arange(np.ceil(low_y), np.floor(high_y) + 1)
    points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    inside: FloatArray = points[area.clearance(points) >= 0.0]
    return inside


def seen_to_message(points: FloatArray, sensor: NDArray[np.int64], age: FloatArray, stamp_ns: int) -> Any:
    """Return the PointCloud2 of which sensor saw points free last.

    Parameters
    ----------
    points : ndarray, shape (N, 2)
        Positions [m, map].
    sensor : ndarray of int, shape (N,)
        Index into the sorted ids of the sensors, -1 for none.
    age : ndarray, shape (N,)
        Time since then [s], NaN for never.
    stamp_ns : int
        Of the area [ns].
    """
    values = np.zeros(len(points), dtype=_SEEN)
    values["x"], values["y"] = points.T
    values["sensor"], values["age"] = sensor, age
    return cloud_to_message(values, stamp_ns, is_dense=not bool(np.isnan(age).any()))
