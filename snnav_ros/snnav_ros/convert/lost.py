"""What silent sensors saw last as a visualization_msgs/MarkerArray.

The first marker of `unoccupied_area/lost` deletes all others and bears the stamp of the area; then comes one LINE_LIST
per silent sensor: namespace the sensor, stamp of its last scan, the outline edge by edge.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from shapely.geometry import MultiPolygon

from snnav_core.area.planar import LostPart, UnoccupiedArea
from snnav_core.errors import InvalidInput
from snnav_core.types import FloatArray
from snnav_ros.available import new_message
from snnav_ros.convert.frames import MAP_FRAME, check_frame, header
from snnav_ros.convert.stamps import nanoseconds, nanoseconds_from_stamp, seconds_from_stamp

__all__ = ["lost_from_message", "lost_to_message"]

_LINE_LIST, _ADD, _DELETE_ALL = 5, 0, 3  # visualization_msgs/Marker
_NEVER = "never seen"
_WIDTH = 0.05  # [m]


def lost_to_message(area: UnoccupiedArea) -> Any:
    """Return the MarkerArray of what the sensors that are silent at the stamp of an area saw last."""
    first = new_message("visualization_msgs/Marker", header=header(nanoseconds(area.stamp), MAP_FRAME))
    first.action = _DELETE_ALL
    return new_message("visualization_msgs/MarkerArray", markers=[first, *map(_marker, area.lost)])


def _marker(part: LostPart) -> Any:
    stamp_ns = 0 if part.stamp is None else nanoseconds(part.stamp)
    marker = new_message("visualization_msgs/Marker", header=header(stamp_ns, MAP_FRAME))
    marker.ns, marker.type, marker.action = part.sensor_id, _LINE_LIST, _ADD
    marker.text = _NEVER if part.stamp is None else ""
    marker.pose.orientation.w = 1.0
    marker.scale.x = _WIDTH
    marker.color.r, marker.color.g, marker.color.a = 0.9, 0.4, 0.8
    for ring in UnoccupiedArea(0.0, part.region).rings:
        vertices = ring[np.any(ring != np.roll(ring, 1, axis=0), axis=1)]
        edges = np.stack((vertices, np.roll(vertices, -1, axis=0)), axis=1).reshape(-1, 2)
        marker.points.extend(new_message("geometry_msgs/Point", x=x, y=y) for x, y in edges.tolist())
    return marker


def lost_from_message(message: Any, topic: str = "unoccupied_area/lost") -> tuple[int, tuple[LostPart, ...]]:
    """Return the stamp [ns] of the area to which the parts belong, and the parts.

    Parameters
    ----------
    message : visualization_msgs/MarkerArray
    topic : str
        For messages of errors.

    Raises
    ------
    InvalidInput
        If the first marker does not delete all, if another is no outline, or not given in the map.
    """
    markers = list(message.markers)
    if not markers or int(markers[0].action) != _DELETE_ALL:
        raise InvalidInput(
            f"{topic}: the first of {len(markers)} markers must delete all and bear the stamp of the area"
        )
    parts = []
    for marker in markers[1:]:
        check_frame(marker, topic)
        if int(marker.type) != _LINE_LIST:
            raise InvalidInput(
                f"{topic}: marker of {marker.ns!r} has type {marker.type}, expected LINE_LIST (5)"
            )
        stamp = None if marker.text == _NEVER else seconds_from_stamp(marker.header.stamp)
        parts.append(LostPart(marker.ns, stamp, _region(marker, topic)))
    return nanoseconds_from_stamp(markers[0].header.stamp), tuple(parts)


def _region(marker: Any, topic: str) -> MultiPolygon:
    points = np.array([(point.x, point.y) for point in marker.points], dtype=np.float64).reshape(-1, 2)
    if len(points) % 2:
        raise InvalidInput(
            f"{topic}: outline of {marker.ns!r} has {len(points)} points; give two for every edge"
        )
    rings: list[FloatArray] = []
    begin = 0
    for edge in range(0, len(points), 2):
        if np.array_equal(points[edge + 1], points[begin]):
            rings.append(points[begin : edge + 2 : 2])
            begin = edge + 2
    if begin != len(points):
        raise InvalidInput(f"{topic}: outline of {marker.ns!r} is not closed; send whole rings")
    return UnoccupiedArea.from_rings(0.0, rings).region
