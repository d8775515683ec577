"""ROS 2 messages without ROS: the Jazzy definitions and the few messages that the importers write."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore
from scipy.spatial.transform import Rotation

from snnav_core.types import FloatArray, Pose2D
from snnav_ros.convert import yaw_from_message

__all__ = [
    "camera_info",
    "jazzy_types",
    "laser_scan",
    "organized_cloud",
    "pose_of",
    "pose_stamped",
    "static_transforms",
    "time_message",
]

_NANOSECONDS = 1_000_000_000


@lru_cache(maxsize=1)
def jazzy_types() -> Typestore:
    """Return the message definitions of ROS 2 Jazzy (loaded once, about 0.05 s)."""
    return get_typestore(Stores.ROS2_JAZZY)


def _new(kind: str, /, **fields: Any) -> Any:
    return jazzy_types().types[kind](**fields)


def time_message(stamp_ns: int) -> Any:
    """Return builtin_interfaces/Time of a stamp [ns]."""
    return _new("builtin_interfaces/msg/Time", sec=stamp_ns // _NANOSECONDS, nanosec=stamp_ns % _NANOSECONDS)


def _header(stamp_ns: int, frame: str) -> Any:
    return _new("std_msgs/msg/Header", stamp=time_message(stamp_ns), frame_id=frame)


def laser_scan(
    stamp_ns: int,
    frame: str,
    ranges: ArrayLike,
    angle_min: float,
    angle_increment: float,
    range_max: float,
    range_min: float = 0.0,
) -> Any:
    """Return a sensor_msgs/LaserScan; ranges [m], shape (B,), +inf where nothing returned; angles [rad]."""
    values = np.asarray(ranges, dtype=np.float32)
    return _new(
        "sensor_msgs/msg/LaserScan",
        header=_header(stamp_ns, frame),
        angle_min=angle_min,
        angle_max=angle_min + (len(values) - 1) * angle_increment,
        angle_increment=angle_increment,
        time_increment=0.0,
        scan_time=0.0,
        range_min=range_min,
        range_max=range_max,
        ranges=values,
        intensities=np.zeros(0, dtype=np.float32),
    )


def pose_stamped(stamp_ns: int, frame: str, pose: Pose2D) -> Any:
    """Return a geometry_msgs/PoseStamped of a planar pose [m, rad] in the given frame."""
    turn = _new(
        "geometry_msgs/msg/Quaternion",
        x=0.0,
        y=0.0,
        z=math.sin(pose.heading / 2.0),
        w=math.cos(pose.heading / 2.0),
    )
    point = _new("geometry_msgs/msg/Point", x=pose.x, y=pose.y, z=0.0)
    placed = _new("geometry_msgs/msg/Pose", position=point, orientation=turn)
    return _new("geometry_msgs/msg/PoseStamped", header=_header(stamp_ns, frame), pose=placed)


def pose_of(pose: Any) -> Pose2D:
    """Return the planar part of a geometry_msgs/Pose.

    Raises
    ------
    InvalidInput
        If the orientation is no rotation.
    """
    heading = yaw_from_message(pose.orientation)
    return Pose2D(float(pose.position.x), float(pose.position.y), heading)


def organized_cloud(stamp_ns: int, frame: str, points: ArrayLike) -> Any:
    """Return a sensor_msgs/PointCloud2 with float32 x, y, z of points (rows, columns, 3) [m]; NaN where none is."""
    values = np.ascontiguousarray(points, dtype="<f4")
    rows, columns, _ = values.shape
    fields = [
        _new("sensor_msgs/msg/PointField", name=name, offset=4 * index, datatype=7, count=1)
        for index, name in enumerate("xyz")
    ]
    return _new(
        "sensor_msgs/msg/PointCloud2",
        header=_header(stamp_ns, frame),
        height=rows,
        width=columns,
        fields=fields,
        is_bigendian=False,
        point_step=12,
        row_step=12 * columns,
        data=np.frombuffer(values.tobytes(), dtype=np.uint8),
        is_dense=bool(np.isfinite(values).all()),
    )


def camera_info(
    stamp_ns: int,
    frame: str,
    size: tuple[int, int],
    focal: tuple[float, float],
    centre: tuple[float, float],
) -> Any:
    """Return the sensor_msgs/CameraInfo of a pinhole camera without distortion; all pairs (column, row) [pixels]."""
    (fx, fy), (cx, cy) = focal, centre
    region = _new(
        "sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
    )
    return _new(
        "sensor_msgs/msg/CameraInfo",
        header=_header(stamp_ns, frame),
        height=size[1],
        width=size[0],
        distortion_model="plumb_bob",
        d=np.zeros(5),
        k=np.array([fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]),
        r=np.eye(3).ravel(),
        p=np.array([fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0]),
        binning_x=0,
        binning_y=0,
        roi=region,
    )


def static_transforms(stamp_ns: int, frames: Sequence[tuple[str, str, FloatArray, FloatArray]]) -> Any:
    """Return a tf2_msgs/TFMessage of parent, child, position (3,) [m] and rotation (3, 3) child -> parent."""
    transforms = []
    for parent, child, position, rotation in frames:
        x, y, z, w = Rotation.from_matrix(rotation).as_quat().tolist()
        turn = _new("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)
        shift = _new(
            "geometry_msgs/msg/Vector3", **dict(zip("xyz", np.asarray(position).tolist(), strict=True))
        )
        transforms.append(
            _new(
                "geometry_msgs/msg/TransformStamped",
                header=_header(stamp_ns, parent),
                child_frame_id=child,
                transform=_new("geometry_msgs/msg/Transform", translation=shift, rotation=turn),
            )
        )
    return _new("tf2_msgs/msg/TFMessage", transforms=transforms)
