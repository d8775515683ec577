"""Markers to look at (RViz, Foxglove): bodies with their velocities."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from snnav_core.obstacles import MovingObstacle
from snnav_core.types import FloatArray
from snnav_ros.available import new_message
from snnav_ros.convert.frames import MAP_FRAME, header

__all__ = ["delete_all", "line_strip", "obstacles_to_markers"]

Colour = tuple[float, float, float, float]

_ARROW, _CYLINDER, _LINE_STRIP = 0, 3, 4  # visualization_msgs/Marker
_ADD, _DELETE_ALL = 0, 3
_MOVING, _STANDING, _VELOCITY = (0.9, 0.3, 0.1, 1.0), (0.35, 0.35, 0.4, 1.0), (0.9, 0.3, 0.1, 0.8)
_LINE, _SHAFT, _HEAD = 0.05, 0.06, 0.16  # [m]


def delete_all(stamp_ns: int) -> Any:
    """Return the marker that deletes all others."""
    return new_message("visualization_msgs/Marker", header=header(stamp_ns, MAP_FRAME), action=_DELETE_ALL)


def line_strip(
    stamp_ns: int, namespace: str, index: int, points: FloatArray, colour: Colour, width: float
) -> Any:
    """Return the marker of a line through points (N, 2) or (N, 3) [m, map]."""
    marker = _marker(stamp_ns, namespace, index, _LINE_STRIP, colour)
    marker.scale.x = width
    spatial = np.zeros((len(points), 3))
    spatial[:, : points.shape[1]] = points
    marker.points = [new_message("geometry_msgs/Point", x=x, y=y, z=z) for x, y, z in spatial.tolist()]
    return marker


def obstacles_to_markers(obstacles: Sequence[MovingObstacle], stamp_ns: int, horizon: float) -> Any:
    """Return the MarkerArray of bodies: outlines, and where those that move will be after a time.

    Parameters
    ----------
    obstacles : sequence of MovingObstacle
    stamp_ns : int
        [ns]
    horizon : float
        Arrows go as far as bodies do in this time [s].
    """
    markers = [delete_all(stamp_ns)]
    for index, body in enumerate(obstacles):
        colour = _MOVING if body.speed > 0.0 else _STANDING
        markers.append(_outline(body, stamp_ns, index, colour))
        if body.speed > 0.0:
            markers.append(_arrow(body, stamp_ns, index, horizon))
    return new_message("visualization_msgs/MarkerArray", markers=markers)


def _outline(body: MovingObstacle, stamp_ns: int, index: int, colour: Colour) -> Any:
    if len(body.outline) == 1:
        marker = _marker(stamp_ns, "outline", index, _CYLINDER, colour)
        marker.pose.position.x, marker.pose.position.y = body.outline[0].tolist()
        marker.scale.x = marker.scale.y = 2.0 * body.radius
        marker.scale.z = _LINE
        return marker
    closed = np.vstack((body.outline, body.outline[:1]))
    return line_strip(stamp_ns, "outline", index, closed, colour, max(_LINE, 2.0 * body.radius))


def _arrow(body: MovingObstacle, stamp_ns: int, index: int, horizon: float) -> Any:
    marker = _marker(stamp_ns, "velocity", index, _ARROW, _VELOCITY)
    marker.scale.x, marker.scale.y = _SHAFT, _HEAD
    centre = body.outline.mean(axis=0)
    for x, y in (centre.tolist(), (centre + horizon * body.velocity).tolist()):
        marker.points.append(new_message("geometry_msgs/Point", x=x, y=y, z=0.0))
    return marker


def _marker(stamp_ns: int, namespace: str, index: int, kind: int, colour: Colour) -> Any:
    marker = new_message("visualization_msgs/Marker", header=header(stamp_ns, MAP_FRAME))
    marker.ns, marker.id, marker.type, marker.action = namespace, index, kind, _ADD
    marker.pose.orientation.w = 1.0
    marker.color.r, marker.color.g, marker.color.b, marker.color.a = colour
    return marker
