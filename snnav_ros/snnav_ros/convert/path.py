"""TimedPath and nav_msgs/Path.

The header holds the sample time t, pose k is stamped t + k * step, positions are exact. Orientations say where the
robot heads, in space by their x axes; a turn in place repeats one position and has the heading to turn to as
orientation, a path that only waits repeats one position with the orientation 0 0 0 0. A message without poses means
stop.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from snnav_core.errors import InvalidInput
from snnav_core.types import FloatArray, TimedPath
from snnav_ros.available import new_message
from snnav_ros.convert.frames import (
    MAP_FRAME,
    check_frame,
    direction_to_message,
    header,
    yaw_from_message,
    yaw_to_message,
)
from snnav_ros.convert.stamps import nanoseconds, nanoseconds_from_stamp, seconds

__all__ = ["path_from_message", "path_to_message", "stop_to_path"]


def stop_to_path(stamp_ns: int) -> Any:
    """Return the path without poses that means stop, stamped `stamp_ns`."""
    return new_message("nav_msgs/Path", header=header(stamp_ns, MAP_FRAME))


def path_to_message(path: TimedPath) -> Any:
    """Return the nav_msgs/Path of a path.

    Raises
    ------
    InvalidInput
        If the path has one point only (its step could not be told), or a turn whose points differ.
    """
    standing = _stands_still(path.points)
    if len(path) < 2 or (path.turn_to is not None and not standing):
        raise InvalidInput(
            f"path with {len(path)} points and turn_to {path.turn_to} cannot be sent; give two points or more, "
            "all equal for a turn in place"
        )
    start, step = nanoseconds(path.start_time), nanoseconds(path.step)
    message = stop_to_path(start)
    spatial = np.zeros((len(path), 3))
    spatial[:, : path.points.shape[1]] = path.points
    if standing and path.turn_to is None:
        turns = [new_message("geometry_msgs/Quaternion", x=0.0, y=0.0, z=0.0, w=0.0)] * len(path)
    elif path.points.shape[1] == 3:
        turns = [direction_to_message(ahead) for ahead in _directions(path.points)]
    else:
        turns = [yaw_to_message(heading) for heading in path.headings.tolist()]
    for index, (x, y, z) in enumerate(spatial.tolist()):
        place = new_message("geometry_msgs/Point", x=x, y=y, z=z)
        pose = new_message("geometry_msgs/Pose", position=place, orientation=turns[index])
        stamped = header(start + index * step, MAP_FRAME)
        message.poses.append(new_message("geometry_msgs/PoseStamped", header=stamped, pose=pose))
    return message


def path_from_message(message: Any, topic: str = "path", *, in_space: bool = False) -> TimedPath | None:
    """Return the path of a nav_msgs/Path, or None when it means stop.

    Parameters
    ----------
    message : nav_msgs/Path
    topic : str
        For messages of errors.
    in_space : bool
        Whether points have heights even when all are zero, and there are no turns in place.

    Raises
    ------
    InvalidInput
        If the frame is unknown, a number is not finite, or the stamps do not run evenly from the header's.
    """
    check_frame(message, topic)
    if not message.poses:
        return None
    frames = {pose.header.frame_id for pose in message.poses} - {MAP_FRAME, ""}
    if frames:
        raise InvalidInput(
            f"{topic}: poses have frame_id {', '.join(map(repr, sorted(frames)))}, expected {MAP_FRAME!r}"
        )
    if len(message.poses) < 2:
        raise InvalidInput(f"{topic}: one pose only; send two or more, or none to stop")
    start = nanoseconds_from_stamp(message.header.stamp)
    stamps = np.array([nanoseconds_from_stamp(pose.header.stamp) for pose in message.poses], dtype=np.int64)
    steps = np.diff(stamps)
    if stamps[0] != start or steps[0] <= 0 or (steps != steps[0]).any():
        raise InvalidInput(
            f"{topic}: stamps go from {stamps[0]} ns (header {start} ns) in steps {steps.min()} to {steps.max()} ns; "
            "stamp pose k t + k * step"
        )
    positions = [(p.pose.position.x, p.pose.position.y, p.pose.position.z) for p in message.poses]
    points = np.array(positions, dtype=np.float64)
    if in_space:
        return TimedPath(seconds(start), seconds(int(steps[0])), points)
    if not points[:, 2].any():
        points = points[:, :2]
    turn = _turn_to(message.poses[0].pose.orientation) if _stands_still(points) else None
    return TimedPath(seconds(start), seconds(int(steps[0])), points, turn)


def _directions(points: FloatArray) -> FloatArray:
    """Return the direction to the next point at every point (N, 3); the one before where two are equal."""
    links = np.diff(points, axis=0)
    lengths = np.linalg.norm(links, axis=1)
    moves = np.flatnonzero(lengths > 0.0)  # not empty, for the path does not stand still
    last = np.searchsorted(moves, np.arange(len(points)), side="right") - 1
    chosen = moves[np.clip(last, 0, None)]
    return np.asarray(links[chosen] / lengths[chosen, None])


def _stands_still(points: FloatArray) -> bool:
    return bool((points == points[0]).all())


def _turn_to(quaternion: Any) -> float | None:
    """Return the heading to turn to [rad], kept inside (-pi, pi] so that no rounding wraps it to the other end."""
    if not any((quaternion.x, quaternion.y, quaternion.z, quaternion.w)):
        return None
    return min(max(yaw_from_message(quaternion), math.nextafter(-math.pi, 0.0)), math.pi)
