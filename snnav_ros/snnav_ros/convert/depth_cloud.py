"""Images of depth cameras as organized sensor_msgs/PointCloud2, in the frame of the camera.

Ours have the fields x y z range (float32): `range` is the measured one, exact, and tells +inf (nothing returned) and
-inf (too near) from NaN (lost), where the point is NaN. Clouds of other cameras need x y z only, wherever they stand.

A cloud without points says "nothing more": in lockstep a camera ends a tick with it that has no image stamped with the
tick.
"""

from __future__ import annotations

import array
from typing import Any

import numpy as np
from numpy.typing import NDArray

from snnav_core.errors import InvalidInput, ScanError
from snnav_core.sensing.depth import CameraModel, DepthCamera, DepthImage
from snnav_ros.available import new_message
from snnav_ros.convert.frames import header
from snnav_ros.convert.stamps import seconds_from_stamp

__all__ = ["image_from_message", "image_to_message", "is_no_cloud", "no_cloud_to_message"]

_FLOAT32 = 7  # sensor_msgs/PointField
_NAMES = ("x", "y", "z", "range")
_STEP = 4 * len(_NAMES)
_ROUNDING = 1e-5  # of a range; single precision of coordinates has 1e-7


def image_to_message(image: DepthImage, model: CameraModel, frame: str, stamp_ns: int) -> Any:
    """Return the PointCloud2 of an image in the frame of its camera (x forward, y left, z up).

    Parameters
    ----------
    image : DepthImage
        Exact in single precision, else it is rounded.
    model : CameraModel
    frame : str
    stamp_ns : int
        [ns]
    """
    seen = image.measured(model)
    values = np.empty((*image.ranges.shape, len(_NAMES)), dtype="<f4")
    values[..., :3] = model.rays() * seen[..., None]
    values[..., 3] = image.ranges
    message = new_message("sensor_msgs/PointCloud2", header=header(stamp_ns, frame))
    message.fields = [
        new_message("sensor_msgs/PointField", name=name, offset=4 * index, datatype=_FLOAT32, count=1)
        for index, name in enumerate(_NAMES)
    ]
    message.height, message.width = image.ranges.shape
    message.point_step, message.row_step = _STEP, _STEP * message.width
    message.is_bigendian, message.is_dense = False, bool(np.isfinite(seen).all())
    message.data = array.array("B", values.tobytes())
    return message


def image_from_message(
    message: Any, camera: DepthCamera, topic: str = "points", *, optical: bool = False
) -> DepthImage:
    """Return the image of an organized PointCloud2; its frame is not looked at.

    Parameters
    ----------
    message : sensor_msgs/PointCloud2
        Its field `range`, where there is one of float32, is taken for the measured range.
    camera : DepthCamera
    topic : str
        For messages of errors.
    optical : bool
        Whether points are given in an optical frame: z forward, x right, y down (REP 103).

    Raises
    ------
    InvalidInput
        If fields or sizes are not as they must be, or points have infinite coordinates.
    ScanError
        If the cloud has not the size of the image, points do not lie on the rays of their pixels, or are not as far as
        `range` says.
    """
    size = (int(message.height), int(message.width))
    model = camera.model
    if size != (model.rows, model.columns):
        raise ScanError(
            f"{topic}: cloud has {size[1]} x {size[0]} points, expected {model.columns} x {model.rows}: one for every "
            "pixel, NaN where nothing was measured; check the camera's columns and rows"
        )
    offsets = _offsets(message, topic)
    points = np.stack([_column(message, offsets[name], size, topic) for name in "xyz"], axis=-1)
    if np.isinf(points).any():
        raise InvalidInput(
            f"{topic}: a point has an infinite coordinate; write NaN where nothing was measured"
        )
    if optical:
        points = np.stack((points[..., 2], -points[..., 0], -points[..., 1]), axis=-1)
    try:
        image = camera.image_from_points(seconds_from_stamp(message.header.stamp), points)
    except ScanError as error:
        raise ScanError(f"{topic}: {error}") from None
    if "range" not in offsets:
        return image
    ranges, there = _column(message, offsets["range"], size, topic), np.isfinite(image.ranges)
    _check_ranges(ranges[there], image.ranges[there], topic)
    ranges[~there & np.isfinite(ranges)] = np.nan  # no point, so nothing was measured
    return DepthImage(image.stamp, ranges)


def no_cloud_to_message(sensor_id: str, stamp_ns: int) -> Any:
    """Return the PointCloud2 that says "nothing more" of a camera up to `stamp_ns`: it has no points."""
    return new_message("sensor_msgs/PointCloud2", header=header(stamp_ns, sensor_id))


def is_no_cloud(message: Any) -> bool:
    """Return whether a PointCloud2 has no points and so says "nothing more"."""
    return int(message.width) * int(message.height) == 0


def _offsets(message: Any, topic: str) -> dict[str, int]:
    """Return where x, y, z and, if it is one of float32, range stand in a point [byte]."""
    fields = {one.name: one for one in message.fields}
    found = {
        name: int(fields[name].offset)
        for name in _NAMES
        if name in fields and int(fields[name].datatype) == _FLOAT32 and int(fields[name].count) in (0, 1)
    }
    if message.is_bigendian or not {"x", "y", "z"} <= found.keys():
        kinds = [(one.name, int(one.datatype)) for one in message.fields]
        raise InvalidInput(
            f"{topic}: fields are {kinds}{' big-endian' if message.is_bigendian else ''}, expected little-endian x, y "
            f"and z of type {_FLOAT32} (FLOAT32); publish points in metres"
        )
    return found


def _column(message: Any, offset: int, size: tuple[int, int], topic: str) -> NDArray[np.float64]:
    """Return one field of all points, (rows, columns)."""
    rows, columns = size
    step, row_step = int(message.point_step), int(message.row_step)
    data = memoryview(message.data).cast("B")
    if not (0 <= offset <= step - 4 and row_step >= columns * step and len(data) == rows * row_step):
        raise InvalidInput(
            f"{topic}: {len(data)} bytes for {rows} rows of {row_step} bytes with {columns} points of {step} bytes, "
            f"field at byte {offset}; the message is damaged"
        )
    values = np.ndarray((rows, columns), dtype="<f4", buffer=data, offset=offset, strides=(row_step, step))
    return values.astype(np.float64)


def _check_ranges(ranges: NDArray[np.float64], lengths: NDArray[np.float64], topic: str) -> None:
    """Make sure that measured ranges (N,) are the lengths of the points (N,)."""
    with np.errstate(invalid="ignore"):
        fits = np.abs(ranges - lengths) <= _ROUNDING * lengths
    if not fits.all():
        at = int(np.argmin(fits))
        raise ScanError(
            f"{topic}: a point {lengths[at]:.4f} m away has range {ranges[at]:.4f}; "
            "the field range must hold the distance of the point in metres"
        )
