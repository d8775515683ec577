"""sensor_msgs/LaserScan and PlanarScan; the message holds single precision.

A LaserScan without beams says "nothing more": in lockstep a scanner ends a tick with it that has no scan stamped with
the tick.
"""

from __future__ import annotations

import array
from typing import Any

import numpy as np

from snnav_core.sensing.scan import PlanarScan
from snnav_ros.available import new_message
from snnav_ros.convert.frames import header
from snnav_ros.convert.stamps import seconds_from_stamp

__all__ = ["is_nothing", "nothing_to_message", "scan_from_message", "scan_to_message"]


def scan_to_message(scan: PlanarScan, frame: str, stamp_ns: int) -> Any:
    """Return the LaserScan of a scan in the frame of its sensor, stamped `stamp_ns`."""
    message = new_message("sensor_msgs/LaserScan", header=header(stamp_ns, frame))
    message.angle_min = scan.angle_min
    message.angle_increment = scan.angle_increment
    message.angle_max = scan.angle_min + (scan.ranges.size - 1) * scan.angle_increment
    message.range_min, message.range_max = scan.range_min, scan.range_max
    message.ranges = array.array("f", scan.ranges.astype(np.float32).tobytes())
    return message


def scan_from_message(message: Any) -> PlanarScan:
    """Return the scan of a LaserScan; `angle_max` is not used, the number of ranges counts.

    Raises
    ------
    ScanError
        If the scan cannot be used (see `PlanarScan`).
    """
    return PlanarScan(
        stamp=seconds_from_stamp(message.header.stamp),
        ranges=np.asarray(message.ranges, dtype=np.float32).astype(np.float64),
        angle_min=float(message.angle_min),
        angle_increment=float(message.angle_increment),
        range_min=float(message.range_min),
        range_max=float(message.range_max),
    )


def nothing_to_message(sensor_id: str, stamp_ns: int) -> Any:
    """Return the LaserScan that says "nothing more" of a sensor up to `stamp_ns`: it has no beams."""
    return new_message("sensor_msgs/LaserScan", header=header(stamp_ns, sensor_id))


def is_nothing(message: Any) -> bool:
    """Return whether a LaserScan has no beams and so says "nothing more"."""
    return len(message.ranges) == 0
