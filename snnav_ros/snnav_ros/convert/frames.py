"""Frames and orientations."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator
from typing import Any

import numpy as np

from snnav_core.errors import InvalidInput
from snnav_core.types import FloatArray
from snnav_ros.available import new_message
from snnav_ros.convert.stamps import stamp_message

__all__ = [
    "MAP_FRAME",
    "attitude_of",
    "check_frame",
    "direction_from_message",
    "direction_to_message",
    "header",
    "yaw_from_message",
    "yaw_to_message",
]

MAP_FRAME = "map"

_NEIGHBOURS = 3
_HALF_TURN = math.pi + 1e-6  # a little more: a quantised turn may lie just beyond


def check_frame(message: Any, topic: str, accepted: Collection[str] = (MAP_FRAME,)) -> None:
    """Make sure that a message is given in a frame that its reader understands.

    Raises
    ------
    InvalidInput
        With topic, frame and remedy.
    """
    frame = message.header.frame_id
    if frame not in accepted:
        known = " or ".join(repr(one) for one in accepted)
        raise InvalidInput(f"{topic}: frame_id is {frame!r}, expected {known}; publish it in that frame")


def header(stamp_ns: int, frame: str) -> Any:
    """Return a std_msgs/Header."""
    return new_message("std_msgs/Header", stamp=stamp_message(stamp_ns), frame_id=frame)


def yaw_to_message(yaw: float) -> Any:
    """Return the geometry_msgs/Quaternion of a rotation about z [rad].

    Its length is one to within rounding, and rounded such that `yaw_from_message` gives back the same float.
    """
    sine, cosine = math.sin(0.5 * yaw), math.cos(0.5 * yaw)
    pairs = ((z, w) for w in _around(cosine) for z in _around(sine))
    z, w = next((pair for pair in pairs if 2.0 * math.atan2(*pair) == yaw), (sine, cosine))
    return new_message("geometry_msgs/Quaternion", x=0.0, y=0.0, z=z, w=w)


def _around(value: float) -> Iterator[float]:
    """Yield a number and the floats next to it."""
    yield value
    below = above = value
    for _ in range(_NEIGHBOURS):
        below, above = math.nextafter(below, -math.inf), math.nextafter(above, math.inf)
        yield below
        yield above


def yaw_from_message(quaternion: Any) -> float:
    """Return the rotation about z of a quaternion [rad], in [-pi, pi]; it need not have length one.

    Raises
    ------
    InvalidInput
        If it is zero or not finite.
    """
    x, y, z, w, _ = _numbers(quaternion)
    if x == 0.0 and y == 0.0:  # the exact inverse of yaw_to_message, also at half a turn
        yaw = 2.0 * math.atan2(z, w)
    else:
        yaw = math.atan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z)
    return math.remainder(yaw, 2.0 * math.pi) if abs(yaw) > _HALF_TURN else yaw


def _numbers(quaternion: Any) -> tuple[float, float, float, float, float]:
    """Return x, y, z, w and the square of the length of a quaternion."""
    x, y, z, w = (float(getattr(quaternion, name)) for name in "xyzw")
    size = x * x + y * y + z * z + w * w
    if not (math.isfinite(size) and size > 0.0):
        raise InvalidInput(
            f"orientation x {x} y {y} z {z} w {w} is no rotation; give a quaternion of length 1"
        )
    return x, y, z, w, size


def direction_to_message(direction: FloatArray) -> Any:
    """Return the geometry_msgs/Quaternion whose x axis is a direction (3,), a unit vector; its y axis is level."""
    yaw = math.atan2(direction[1], direction[0])
    pitch = -math.atan2(
        direction[2], math.hypot(direction[0], direction[1])
    )  # about y, which points to the left
    sine, cosine, down, level = (
        math.sin(0.5 * yaw),
        math.cos(0.5 * yaw),
        math.sin(0.5 * pitch),
        math.cos(0.5 * pitch),
    )
    return new_message(
        "geometry_msgs/Quaternion", x=-down * sine, y=down * cosine, z=level * sine, w=level * cosine
    )


def direction_from_message(quaternion: Any) -> FloatArray:
    """Return the x axis (3,) that a quaternion turns; it need not have length one.

    Raises
    ------
    InvalidInput
        If it is zero or not finite.
    """
    x, y, z, w, size = _numbers(quaternion)
    ahead = np.array([w * w + x * x - y * y - z * z, 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)])
    return ahead / size


def attitude_of(direction: FloatArray) -> FloatArray:
    """Return the axes of the body that heads in a direction (3,), as columns (3, 3): x ahead, y level to the left."""
    ahead = np.asarray(direction, dtype=np.float64)
    yaw = math.atan2(ahead[1], ahead[0])
    left = np.array([-math.sin(yaw), math.cos(yaw), 0.0])
    return np.stack((ahead, left, np.cross(ahead, left)), axis=1)
