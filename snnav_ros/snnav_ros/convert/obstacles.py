"""Bodies in uniform motion as a PointCloud2, a point per vertex: `x y z obstacle radius vx vy ... stamp`.

Vertices come body by body, counter-clockwise, the first not repeated; `obstacle` is the number of the body, negative
for what no sensor saw into. What belongs to the whole body is written with every vertex of it. A cloud without points
says that no body is known; what lies outside of the workspace of the same stamp counts as obstacle all the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from snnav_core.errors import InvalidInput
from snnav_core.obstacles import MovingObstacle
from snnav_ros.convert.cloud import cloud_fields, cloud_from_message, cloud_to_message
from snnav_ros.convert.stamps import nanoseconds_from_stamp, seconds

__all__ = ["OBSTACLE_FIELDS", "obstacles_from_message", "obstacles_to_message"]

_OF_BODY = ("radius", "vx", "vy", "position_deviation", "velocity_deviation", "stamp")
_VERTEX = np.dtype(
    [("x", "<f8"), ("y", "<f8"), ("z", "<f8"), ("obstacle", "<i4"), *((name, "<f8") for name in _OF_BODY)]
)
_MOST = 2**31 - 1
_BODY, _UNSEEN = "body_", "unseen_"  # what ids begin with: tracked bodies, and what no sensor saw into
_AHEAD = 1e-6  # [s] that the outline of a body may be later than the cloud: rounding to nanoseconds

OBSTACLE_FIELDS = cloud_fields(_VERTEX)
"""Name, offset [byte] and datatype of every field."""


def obstacles_to_message(obstacles: Sequence[MovingObstacle], stamp_ns: int) -> Any:
    """Return the PointCloud2 of bodies.

    Parameters
    ----------
    obstacles : sequence of MovingObstacle
        Their ids are those of the tracker, ``body_<n>`` or ``unseen_<n>`` with n >= 1, each different.
    stamp_ns : int
        Time for which they hold [ns].

    Raises
    ------
    InvalidInput
        If an id is another one.
    """
    vertices = np.zeros(sum(len(body.outline) for body in obstacles), dtype=_VERTEX)
    begin = 0
    for body in obstacles:
        part = vertices[begin : begin + len(body.outline)]
        begin += len(part)
        part["x"], part["y"] = body.outline.T
        part["obstacle"] = _number(body.id)
        part["vx"], part["vy"] = body.velocity
        for name in ("radius", "position_deviation", "velocity_deviation", "stamp"):
            part[name] = getattr(body, name)
    return cloud_to_message(vertices, stamp_ns)


def _number(name: str) -> int:
    """Return the number of an id; what was not seen is negative."""
    for prefix, sign in ((_BODY, 1), (_UNSEEN, -1)):
        digits = name.removeprefix(prefix)
        if digits != name and digits.isdecimal() and digits == str(int(digits)) and 0 < int(digits) <= _MOST:
            return sign * int(digits)
    raise InvalidInput(f"body {name!r} cannot be sent; name it body_1, body_2, ... or unseen_1, ...")


def _name(number: int, topic: str) -> str:
    if number == 0:
        raise InvalidInput(
            f"{topic}: a body has the number 0; number bodies 1, 2, ..., what is unseen -1, -2, ..."
        )
    return f"{_BODY}{number}" if number > 0 else f"{_UNSEEN}{-number}"


def obstacles_from_message(message: Any, topic: str = "obstacles") -> tuple[MovingObstacle, ...]:
    """Return the bodies of a PointCloud2.

    Parameters
    ----------
    message : sensor_msgs/PointCloud2
    topic : str
        For messages of errors.

    Raises
    ------
    InvalidInput
        If fields, sizes or frame are not as they must be, a number is not finite or out of its range, the vertices of
        a body are not in one piece or disagree about it, or its outline is later than the stamp of the cloud.
    """
    vertices = cloud_from_message(message, _VERTEX, topic, "a point per vertex")
    number = vertices["obstacle"].astype(np.int64)
    begins = np.flatnonzero(np.diff(number)) + 1
    parts = np.split(vertices, begins) if len(vertices) else []
    numbers = [int(part["obstacle"][0]) for part in parts]
    if len(set(numbers)) < len(numbers):
        twice = next(one for one in numbers if numbers.count(one) > 1)
        raise InvalidInput(
            f"{topic}: the vertices of {_name(twice, topic)} are not in one piece; send them together"
        )
    time = seconds(nanoseconds_from_stamp(message.header.stamp))
    return tuple(_body(part, time, topic) for part in parts)


def _body(part: Any, time: float, topic: str) -> MovingObstacle:
    """Return the body of its vertices in a cloud of a time [s]."""
    name, first = _name(int(part["obstacle"][0]), topic), part[0]
    for key in _OF_BODY:
        if not (part[key] == first[key]).all():
            raise InvalidInput(
                f"{topic}: {key} of {name} is {first[key]:g} at one vertex and another number, or none, at "
                "another; write the same at all of them"
            )
    try:
        body = MovingObstacle(
            name,
            np.column_stack((part["x"], part["y"])),
            float(first["radius"]),
            np.array([first["vx"], first["vy"]]),
            float(first["stamp"]),
            float(first["position_deviation"]),
            float(first["velocity_deviation"]),
        )
    except InvalidInput as error:
        raise InvalidInput(f"{topic}: {error}") from None
    if body.stamp > time + _AHEAD:
        raise InvalidInput(
            f"{topic}: {name} is stamped {body.stamp - time:.3f} s ahead of the message; stamp bodies when they "
            "were measured"
        )
    return body
