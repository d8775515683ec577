"""The unoccupied area as a PointCloud2 of boundary vertices: fields x y z (float64) and ring (uint32).

Vertices come ring by ring, the first not repeated: an exterior counter-clockwise, then its holes clockwise, then the
next exterior. An area without vertices says that nothing is known to be free.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from snnav_core.area.planar import UnoccupiedArea
from snnav_core.errors import InvalidInput
from snnav_core.types import FloatArray
from snnav_ros.convert.cloud import cloud_fields, cloud_from_message, cloud_to_message
from snnav_ros.convert.stamps import nanoseconds, seconds_from_stamp

__all__ = ["AREA_FIELDS", "area_from_message", "area_to_message", "rings_from_message", "rings_to_message"]

_VERTEX = np.dtype([("x", "<f8"), ("y", "<f8"), ("z", "<f8"), ("ring", "<u4")])

AREA_FIELDS = cloud_fields(_VERTEX)
"""Name, offset [byte] and datatype of every field."""


def area_to_message(area: UnoccupiedArea) -> Any:
    """Return the PointCloud2 of an area; the counts of contradictions are not part of it."""
    return rings_to_message(area.rings, nanoseconds(area.stamp))


def area_from_message(message: Any, topic: str = "unoccupied_area") -> UnoccupiedArea:
    """Return the area of a PointCloud2.

    Parameters
    ----------
    message : sensor_msgs/PointCloud2
    topic : str
        For messages of errors.

    Raises
    ------
    InvalidInput
        If fields, sizes, frame, the order of the rings or a coordinate are not as they must be.
    """
    rings = rings_from_message(message, topic)
    try:
        return UnoccupiedArea.from_rings(seconds_from_stamp(message.header.stamp), rings)
    except InvalidInput as error:
        raise InvalidInput(f"{topic}: {error}") from None


def rings_to_message(rings: Sequence[FloatArray], stamp_ns: int) -> Any:
    """Return the PointCloud2 of rings, each (N, 2) [m, map]."""
    vertices = np.zeros(sum(len(ring) for ring in rings), dtype=_VERTEX)
    if rings:
        vertices["x"], vertices["y"] = np.concatenate(rings).T
        vertices["ring"] = np.repeat(np.arange(len(rings)), [len(ring) for ring in rings])
    return cloud_to_message(vertices, stamp_ns)


def rings_from_message(message: Any, topic: str) -> tuple[FloatArray, ...]:
    """Return the rings of a PointCloud2, each (N, 2) [m, map].

    Raises
    ------
    InvalidInput
        If fields, sizes, frame or the order of the rings are not as they must be.
    """
    vertices = cloud_from_message(message, _VERTEX, topic, "boundary vertices")
    number = vertices["ring"].astype(np.int64)
    if len(number) and (number[0] != 0 or not np.isin(np.diff(number), (0, 1)).all()):
        raise InvalidInput(
            f"{topic}: ring numbers do not run 0, 1, 2, ... in order; keep the order of the vertices"
        )
    points = np.column_stack((vertices["x"], vertices["y"]))
    return tuple(np.split(points, np.flatnonzero(np.diff(number)) + 1)) if len(number) else ()
