"""ROS 2 messages without ROS: the Jazzy definitions and the few messages that the importers write."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from snnav_core.types import Pose2D
from snnav_ros.convert import yaw_from_message

__all__ = [
    "jazzy_types",
    "laser_scan",
    "pose_of",
    "pose_stamped",
    "time_message",
]

_NANOSECONDS = 1_000_000_000


@lru_cache(maxsize=1)
def jazzy_types() -> Typestore:
    """Return the message definitions of ROS 2 Jazzy (loaded once, about 0.05 s)."""
    return get_typestore(Stores.ROS2_JAZZY)


def _new(name: str, **fields: Any) -> Any:
    return jazzy_types().types[name](**fields)


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
