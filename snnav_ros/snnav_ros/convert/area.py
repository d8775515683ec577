"""The unoccupied area as a PointCloud2 of boundary vertices: fields x y z (float64) and ring (uint32).

Vertices come ring by ring, the first not repeated: an exterior counter-clockwise, then its holes clockwise, then the
next exterior. An area without vertices says that nothing is known to be free.
"""

from __future__ import annotations

import array
from typing import Any

import numpy as np

from snnav_core.area.planar import UnoccupiedArea
from snnav_core.errors import InvalidInput
from snnav_ros.available import new_message
from snnav_ros.convert.frames import MAP_FRAME, check_frame, header
from snnav_ros.convert.stamps import nanoseconds, seconds_from_stamp

__all__ = ["AREA_FIELDS", "area_from_message", "area_to_message"]

_FLOAT64, _UINT32 = 8, 6  # sensor_msgs/PointField
AREA_FIELDS = (("x", 0, _FLOAT64), ("y", 8, _FLOAT64), ("z", 16, _FLOAT64), ("ring", 24, _UINT32))
"""Name, offset [byte] and datatype of every field."""

_VERTEX = np.dtype([("x", "<f8"), ("y", "<f8"), ("z", "<f8"), ("ring", "<u4")])


def area_to_message(area: UnoccupiedArea) -> Any:
    """Return the PointCloud2 of an area; the counts of contradictions are not part of it."""
    rings = area.rings
    vertices = np.zeros(sum(len(ring) for ring in rings), dtype=_VERTEX)
    if rings:
        vertices["x"], vertices["y"] = np.concatenate(rings).T
        vertices["ring"] = np.repeat(np.arange(len(rings)), [len(ring) for ring in rings])
    message = new_message("sensor_msgs/PointCloud2", header=header(nanoseconds(area.stamp), MAP_FRAME))
    message.fields = [
        new_message("sensor_msgs/PointField", name=name, offset=offset, datatype=datatype, count=1)
        for name, offset, datatype in AREA_FIELDS
    ]
    message.height, message.width = 1, len(vertices)
    message.point_step = _VERTEX.itemsize
    message.row_step = vertices.nbytes
    message.is_bigendian, message.is_dense = False, True
    message.data = array.array("B", vertices.tobytes())
    return message


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
    check_frame(message, topic)
    fields = tuple((field.name, int(field.offset), int(field.datatype)) for field in message.fields)
    if fields != AREA_FIELDS or message.is_bigendian:
        raise InvalidInput(
            f"{topic}: fields are {fields}, expected little-endian {AREA_FIELDS}; publish boundary vertices, no scan"
        )
    count, data = int(message.width) * int(message.height), bytes(memoryview(message.data))
    if int(message.point_step) != _VERTEX.itemsize or len(data) != count * _VERTEX.itemsize:
        raise InvalidInput(
            f"{topic}: {len(data)} bytes for {count} vertices of {message.point_step} bytes, expected "
            f"{_VERTEX.itemsize} bytes each; the message is damaged"
        )
    vertices = np.frombuffer(data, dtype=_VERTEX)
    number = vertices["ring"].astype(np.int64)
    if count and (number[0] != 0 or not np.isin(np.diff(number), (0, 1)).all()):
        raise InvalidInput(
            f"{topic}: ring numbers do not run 0, 1, 2, ... in order; keep the order of the vertices"
        )
    points = np.column_stack((vertices["x"], vertices["y"]))
    rings = np.split(points, np.flatnonzero(np.diff(number)) + 1) if count else []
    return UnoccupiedArea.from_rings(seconds_from_stamp(message.header.stamp), rings)
