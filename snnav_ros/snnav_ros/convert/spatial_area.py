"""The unoccupied region of space as a PointCloud2: one record with the grid and both clearance fields, sealed.

A message is one "point" of many numbers (`count` of its fields): a cloud with a position for every cell would be 2.5
times as large, and would say less exactly where the cells are.
"""

from __future__ import annotations

import array
import hashlib
import math
import struct
from typing import Any

import numpy as np

from snnav_core.area.grid import Grid
from snnav_core.area.spatial import SpatialArea
from snnav_core.errors import InvalidInput
from snnav_ros.available import new_message
from snnav_ros.convert.frames import MAP_FRAME, check_frame, header
from snnav_ros.convert.grid import BOUNDARY, FREE, UNKNOWN
from snnav_ros.convert.stamps import nanoseconds, seconds_from_stamp

__all__ = [
    "is_spatial_area",
    "spatial_area_from_message",
    "spatial_area_to_grid",
    "spatial_area_to_message",
    "spatial_fields",
]

_UINT8, _UINT32, _FLOAT32, _FLOAT64 = 2, 6, 7, 8  # sensor_msgs/PointField
_TAG = b"snnav-area-1"
_SEAL = 32  # bytes
_GEOMETRY = struct.Struct("<4d3I")  # origin, spacing, shape
_HEAD = _SEAL + _GEOMETRY.size

Fields = tuple[tuple[str, int, int, int], ...]
"""Name, offset [byte], datatype (sensor_msgs/PointField) and count of every field."""


def spatial_fields(cells: int) -> Fields:
    """Return the fields of the message of an area with a number of cells."""
    return (
        ("seal", 0, _UINT8, _SEAL),
        ("origin", _SEAL, _FLOAT64, 3),
        ("spacing", _SEAL + 24, _FLOAT64, 1),
        ("shape", _SEAL + 32, _UINT32, 3),
        ("moving", _HEAD, _FLOAT32, cells),
        ("static", _HEAD + 4 * cells, _FLOAT32, cells),
    )


def is_spatial_area(message: Any) -> bool:
    """Return whether a PointCloud2 on `unoccupied_area` is one of space; else it is one of the plane."""
    return bool(message.fields) and message.fields[0].name == "seal"


def spatial_area_to_message(area: SpatialArea) -> Any:
    """Return the PointCloud2 of an area; `spatial_area_from_message` gives the same numbers to the last bit."""
    message = new_message("sensor_msgs/PointCloud2", header=header(nanoseconds(area.stamp), MAP_FRAME))
    message.fields = [
        new_message("sensor_msgs/PointField", name=name, offset=offset, datatype=datatype, count=count)
        for name, offset, datatype, count in spatial_fields(area.moving.size)
    ]
    grid = area.grid
    body = b"".join(
        (
            _GEOMETRY.pack(*grid.origin.tolist(), grid.spacing, *grid.shape),
            *(np.ascontiguousarray(field, dtype="<f4").tobytes() for field in (area.moving, area.static)),
        )
    )
    message.height = message.width = 1
    message.point_step = message.row_step = _SEAL + len(body)
    message.is_bigendian, message.is_dense = False, True
    message.data = array.array("B", _seal(message.header.stamp, body))
    message.data.frombytes(body)
    return message


def spatial_area_from_message(message: Any, topic: str = "unoccupied_area") -> SpatialArea:
    """Return the area of a PointCloud2.

    Parameters
    ----------
    message : sensor_msgs/PointCloud2
    topic : str
        For messages of errors.

    Raises
    ------
    InvalidInput
        If frame, fields or sizes are not as they must be, the seal is not that of the content, the grid is none, or a
        clearance is not finite.
    """
    check_frame(message, topic)
    data = bytes(memoryview(message.data))
    cells = (len(data) - _HEAD) // 8
    _check_layout(message, len(data), cells, topic)
    body = memoryview(data)[_SEAL:]
    if data[:_SEAL] != _seal(message.header.stamp, body):
        raise InvalidInput(
            f"{topic}: the seal is not that of the content; the message was altered on its way"
        )
    *origin, spacing, nx, ny, nz = _GEOMETRY.unpack_from(body)
    if math.prod((nx, ny, nz)) != cells:
        raise InvalidInput(f"{topic}: a grid of {nx} x {ny} x {nz} cells comes with clearances of {cells}")
    moving, static = np.frombuffer(data, dtype="<f4", offset=_HEAD).reshape(2, nx, ny, nz)
    if not (np.isfinite(moving).all() and np.isfinite(static).all()):
        raise InvalidInput(f"{topic}: a clearance is not finite; publish lower bounds in metres")
    try:
        grid = Grid(np.array(origin), spacing, (nx, ny, nz))
        return SpatialArea(seconds_from_stamp(message.header.stamp), grid, moving, static)
    except InvalidInput as error:
        raise InvalidInput(f"{topic}: {error}") from None


def spatial_area_to_grid(area: SpatialArea) -> Any:
    """Return the nav_msgs/OccupancyGrid of an area: slices at equal heights, the lowest first, stacked along y.

    A cell is free (0) only when all of it is; occupied (100) where its centre lies in what is known never to move;
    unknown (-1) otherwise. Slice k begins at row k times the number of cells along y.
    """
    grid = area.grid
    message = new_message("nav_msgs/OccupancyGrid", header=header(nanoseconds(area.stamp), MAP_FRAME))
    message.info.map_load_time = message.header.stamp
    message.info.resolution = grid.spacing
    place = message.info.origin.position
    place.x, place.y, place.z = grid.origin.tolist()
    message.info.origin.orientation.w = 1.0
    message.info.width, message.info.height = grid.shape[0], grid.shape[1] * grid.shape[2]
    cells = np.where(area.reduced(grid.half_diagonal), np.int8(FREE), np.int8(UNKNOWN))
    cells[area.static <= 0.0] = BOUNDARY
    message.data = array.array("b", cells.transpose(2, 1, 0).tobytes())
    return message


def _check_layout(message: Any, size: int, cells: int, topic: str) -> None:
    """Make sure that everything around the data is what `spatial_area_to_message` writes: it is not sealed."""
    fields = tuple((one.name, int(one.offset), int(one.datatype), int(one.count)) for one in message.fields)
    expected = spatial_fields(cells)
    if fields != expected or message.is_bigendian or not message.is_dense:
        raise InvalidInput(
            f"{topic}: fields are {fields}, expected little-endian, dense {expected}; publish an area of space, no scan"
        )
    sizes = tuple(int(getattr(message, name)) for name in ("height", "width", "point_step", "row_step"))
    if sizes != (1, 1, size, size) or size != _HEAD + 8 * cells:
        raise InvalidInput(
            f"{topic}: height, width, point_step, row_step are {sizes} for {size} bytes, expected one record of "
            f"{_HEAD} + 8 n bytes; the message is damaged"
        )


def _seal(stamp: Any, body: bytes | memoryview) -> bytes:
    """Return the SHA-256 of tag, stamp and all that comes after the seal."""
    digest = hashlib.sha256(_TAG + struct.pack("<iI", stamp.sec, stamp.nanosec))
    digest.update(body)
    return digest.digest()
