"""Turn a CARMEN log into a rosbag2 bag of scans and the laser's corrected poses."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from snnav_core.types import FloatArray
from snnav_ros.bag.carmen import CarmenLog, CarmenScan
from snnav_ros.bag.messages import laser_scan, pose_stamped
from snnav_ros.bag.settings import POSE_TOPIC, SCAN_TOPIC
from snnav_ros.bag.writer import BagWriter
from snnav_ros.convert import MAP_FRAME

__all__ = ["LASER_FRAME", "ImportSummary", "write_carmen_bag"]

LASER_FRAME = "laser"
_NANOSECONDS = 1_000_000_000
_PROGRESS_EVERY = 50


@dataclass(frozen=True, slots=True)
class ImportSummary:
    """What a bag made of a log holds: counts, duration [s], travelled path [m], extent of the poses [m]."""

    scans: int
    beams: tuple[int, ...]
    duration: float
    path_length: float
    extent: tuple[float, float]


def write_carmen_bag(
    log: CarmenLog, directory: str | Path, progress: Callable[[int], None] | None = None
) -> ImportSummary:
    """Write a bag with one LaserScan and one PoseStamped per scan of the log, at the same stamp.

    Parameters
    ----------
    log : CarmenLog
        From `read_carmen`.
    directory : path-like
        The bag to make; it must not exist.
    progress : callable, optional
        Called now and then with the number of scans written.

    Returns
    -------
    ImportSummary

    Raises
    ------
    BagError
        If the bag cannot be written.

    Notes
    -----
    Readings that mean "no return" become +inf (REP-117), ``range_max`` lies just below them.
    """
    with BagWriter(directory) as bag:
        for index, scan in enumerate(log.scans):
            stamp_ns = round(scan.stamp * _NANOSECONDS)
            ranges, range_max = _meaningful(scan, log.no_return.threshold)
            message = laser_scan(
                stamp_ns, LASER_FRAME, ranges, scan.angle_min, scan.angle_increment, range_max
            )
            bag.write(SCAN_TOPIC, message, stamp_ns)
            bag.write(POSE_TOPIC, pose_stamped(stamp_ns, MAP_FRAME, scan.pose), stamp_ns)
            if progress is not None and index % _PROGRESS_EVERY == 0:
                progress(index)
    return _summary(log)


def _meaningful(scan: CarmenScan, threshold: float) -> tuple[FloatArray, float]:
    """Return the ranges with +inf for no returns, and the range up to which they are distances."""
    range_max = min(threshold, scan.range_max)
    return np.where(scan.ranges >= range_max, np.inf, scan.ranges), range_max


def _summary(log: CarmenLog) -> ImportSummary:
    positions = np.array([(scan.pose.x, scan.pose.y) for scan in log.scans])
    extent = positions.max(axis=0) - positions.min(axis=0)
    return ImportSummary(
        scans=len(log.scans),
        beams=tuple(sorted({len(scan.ranges) for scan in log.scans})),
        duration=log.scans[-1].stamp - log.scans[0].stamp,
        path_length=float(np.linalg.norm(np.diff(positions, axis=0), axis=1).sum()),
        extent=(float(extent[0]), float(extent[1])),
    )
