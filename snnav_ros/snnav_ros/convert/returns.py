"""The hits of all sensors at one instant as a PointCloud2: where, when, by which beam of which sensor."""

from __future__ import annotations

from typing import Any

import numpy as np

from snnav_core.area.returns import FusedReturns
from snnav_core.errors import InvalidInput
from snnav_ros.convert.cloud import cloud_fields, cloud_from_message, cloud_to_message

__all__ = ["RETURN_FIELDS", "returns_from_message", "returns_to_message"]

_HIT = np.dtype(
    [
        *((name, "<f8") for name in ("x", "y", "z", "stamp", "origin_x", "origin_y", "increment")),
        ("sensor", "<u4"),
        ("beam", "<u4"),
    ]
)
_MOST_SENSORS = 100_000

RETURN_FIELDS = cloud_fields(_HIT)
"""Name, offset [byte] and datatype of every field."""


def returns_to_message(returns: FusedReturns, stamp_ns: int) -> Any:
    """Return the PointCloud2 of hits; sensors without any are not part of it."""
    hits = np.zeros(len(returns), dtype=_HIT)
    hits["x"], hits["y"] = returns.points.T
    hits["stamp"] = returns.times
    hits["origin_x"], hits["origin_y"] = returns.origins[returns.sensors].T
    hits["increment"] = returns.increments[returns.sensors]
    hits["sensor"], hits["beam"] = returns.sensors, returns.beams
    return cloud_to_message(hits, stamp_ns)


def returns_from_message(message: Any, topic: str = "unoccupied_area/returns") -> FusedReturns:
    """Return the hits of a PointCloud2.

    Raises
    ------
    InvalidInput
        If fields, sizes or frame are not as they must be, a number is not finite, or the hits of a sensor disagree
        about where it is.
    """
    hits = cloud_from_message(message, _HIT, topic, "the returns of scans")
    sensors = hits["sensor"].astype(np.int64)
    count = int(sensors.max()) + 1 if len(sensors) else 0
    if count > _MOST_SENSORS:
        raise InvalidInput(f"{topic}: sensor number {count - 1}; number the sensors 0, 1, 2, ...")
    points = np.column_stack((hits["x"], hits["y"]))
    places = np.column_stack((hits["origin_x"], hits["origin_y"], hits["increment"]))
    known = np.zeros((count, 3))
    known[sensors] = places
    if not (known[sensors] == places).all():
        raise InvalidInput(
            f"{topic}: hits of one sensor disagree about its origin, or have none; write the same at all of them"
        )
    try:
        beams = hits["beam"].astype(np.int64)
        return FusedReturns(points, hits["stamp"], sensors, beams, known[:, :2], known[:, 2])
    except InvalidInput as error:
        raise InvalidInput(f"{topic}: {error}") from None
