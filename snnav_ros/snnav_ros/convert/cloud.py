"""Records of numbers as a sensor_msgs/PointCloud2: packed, little-endian, one row."""

from __future__ import annotations

import array
from typing import Any

import numpy as np
from numpy.typing import NDArray

from snnav_core.errors import InvalidInput
from snnav_ros.available import new_message
from snnav_ros.convert.frames import MAP_FRAME, check_frame, header

__all__ = ["Fields", "cloud_fields", "cloud_from_message", "cloud_to_message"]

Fields = tuple[tuple[str, int, int], ...]
"""Name, offset [byte] and datatype (sensor_msgs/PointField) of every field."""

_DATATYPES = {"<i4": 5, "<u4": 6, "<f4": 7, "<f8": 8}  # sensor_msgs/PointField


def cloud_fields(kind: np.dtype[Any]) -> Fields:
    """Return the fields of a cloud whose points are records of a packed, little-endian numpy type."""
    assert kind.fields is not None
    return tuple(
        (name, int(kind.fields[name][1]), _DATATYPES[kind.fields[name][0].str]) for name in kind.names or ()
    )


def cloud_to_message(points: NDArray[Any], stamp_ns: int, *, is_dense: bool = True) -> Any:
    """Return the PointCloud2 of records in the map.

    Parameters
    ----------
    points : ndarray of records, shape (N,)
        `cloud_fields` of its type are the fields.
    stamp_ns : int
        [ns]
    is_dense : bool
        Whether all numbers are finite.
    """
    message = new_message("sensor_msgs/PointCloud2", header=header(stamp_ns, MAP_FRAME))
    message.fields = [
        new_message("sensor_msgs/PointField", name=name, offset=offset, datatype=datatype, count=1)
        for name, offset, datatype in cloud_fields(points.dtype)
    ]
    message.height, message.width = 1, len(points)
    message.point_step, message.row_step = points.dtype.itemsize, points.nbytes
    message.is_bigendian, message.is_dense = False, is_dense
    message.data = array.array("B", points.tobytes())
    return message


def cloud_from_message(message: Any, kind: np.dtype[Any], topic: str, content: str) -> NDArray[Any]:
    """Return the records (N,) of a PointCloud2.

    Parameters
    ----------
    message : sensor_msgs/PointCloud2
    kind : dtype
        Of the records.
    topic : str
        For messages of errors.
    content : str
        What the points are, for messages of errors.

    Raises
    ------
    InvalidInput
        If frame, fields or sizes are not as they must be.
    """
    check_frame(message, topic)
    expected = cloud_fields(kind)
    fields = tuple((field.name, int(field.offset), int(field.datatype)) for field in message.fields)
    if fields != expected or message.is_bigendian:
        raise InvalidInput(
            f"{topic}: fields are {fields}, expected little-endian {expected}; publish {content}, no scan"
        )
    count, data = int(message.width) * int(message.height), bytes(memoryview(message.data))
    if int(message.point_step) != kind.itemsize or len(data) != count * kind.itemsize:
        raise InvalidInput(
            f"{topic}: {len(data)} bytes for {count} points of {message.point_step} bytes, expected "
            f"{kind.itemsize} bytes each; the message is damaged"
        )
    return np.frombuffer(data, dtype=kind)
