"""The scans of a recording in the order in which they would have come in live."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from snnav_core.errors import InvalidInput
from snnav_core.sensing.scan import PlanarScan
from snnav_core.types import FloatArray
from snnav_ros.bag.errors import BagError
from snnav_ros.bag.reader import BagReader
from snnav_ros.bag.sensors_file import TopicSensor
from snnav_ros.convert import is_nothing, nanoseconds_from_stamp, scan_from_message

__all__ = ["RecordedScan", "Recording", "read_recording"]

_LASER_SCAN = "sensor_msgs/msg/LaserScan"
_NANOSECONDS = 1_000_000_000
_SAME_CLOCK = 1.0  # [s] that the time of recording may lie behind the stamp and still tell when a scan came
_STRAY_STAMP = 5.0  # [s] off what the sensor's stamps are usually off the time of recording
_LONGEST_SWEEP = 1.0  # [s]; a time_increment that makes it longer, or negative, counts as not given
_CODE_TOLERANCE = 0.0005 + 1e-6  # [m]; ranges of single precision included

_Row = tuple[int, int, Any]  # stamp [ns], time of recording [ns], message


@dataclass(frozen=True)
class RecordedScan:
    """One scan of a recording; times count from the first stamp of the recording.

    Parameters
    ----------
    sensor_id : str
    arrival : float
        When it came in [s]: at the time of recording where that lies up to 1 s after the end of the sweep, else at the
        end of the sweep (a recorder with another clock).
    scan : PlanarScan
        Beams of a scanner upside down are turned already.
    time_increment : float
        Time from beam to beam [s]; the stamp is that of the first one.
    """

    sensor_id: str
    arrival: float
    scan: PlanarScan
    time_increment: float = 0.0

    @property
    def beam_times(self) -> FloatArray:
        """When every beam measured [s], shape (B,)."""
        return self.scan.stamp + self.time_increment * np.arange(self.scan.ranges.size)


@dataclass(frozen=True)
class Recording:
    """What is used of a bag.

    Parameters
    ----------
    path : Path
    start_ns : int
        Time zero: the first stamp of any of the sensors [ns].
    scans : tuple of RecordedScan
        By arrival.
    warnings : tuple of str
        One line for every sensor with scans that cannot be used.
    """

    path: Path
    start_ns: int
    scans: tuple[RecordedScan, ...]
    warnings: tuple[str, ...] = ()

    @property
    def end(self) -> float:
        """When the last scan came [s]."""
        return self.scans[-1].arrival


def read_recording(
    path: str | Path, sensors: Sequence[TopicSensor], start: float = 0.0, duration: float | None = None
) -> Recording:
    """Read the scans of some sensors.

    Parameters
    ----------
    path : path-like
        ROS 1 ``.bag``, rosbag2 directory, ``.mcap`` or ``.db3``.
    sensors : sequence of TopicSensor
    start : float
        Scans that came before are left out [s from the first stamp].
    duration : float, optional
        So much of the recording is used [s]; all by default.

    Returns
    -------
    Recording

    Raises
    ------
    BagError
        One line: the bag cannot be read, lacks a topic or holds something else there, or a sensor has no usable scan.
    """
    path = Path(path)
    rows = _read(path, sensors)
    start_ns = min(stamp_ns for some in rows.values() for stamp_ns, _, _ in _without_strays(some))
    last = math.inf if duration is None else start + duration
    found: list[RecordedScan] = []
    warnings: list[str] = []
    for entry in sensors:
        name = entry.sensor.id
        scans, faults = _scans(entry, rows[name], start_ns)
        scans = [scan for scan in scans if start <= scan.arrival <= last]
        if faults:
            warnings.append(f"{path}: {len(faults)} scans of {name} left out: {faults[0]}")
        if not scans:
            period = f"from {start:g} s on" if last == math.inf else f"from {start:g} to {last:g} s"
            raise BagError(
                f"{path}: no usable scan on {entry.topic!r} {period}{f' ({faults[0]})' if faults else ''}; "
                f"correct --start and --duration, or leave {name} out"
            )
        found += scans
    found.sort(key=lambda scan: (scan.arrival, scan.sensor_id))
    return Recording(path, start_ns, tuple(found), tuple(warnings))


def _read(path: Path, sensors: Sequence[TopicSensor]) -> dict[str, list[_Row]]:
    """Return the messages of every sensor."""
    names = {entry.topic.strip("/"): entry.sensor.id for entry in sensors}
    rows: dict[str, list[_Row]] = {}
    with BagReader(path) as bag:
        for entry in sensors:
            bag.require(entry.topic, _LASER_SCAN)
        for found in bag.messages([entry.topic for entry in sensors]):
            if not is_nothing(found.message):
                row = (nanoseconds_from_stamp(found.message.header.stamp), found.stamp_ns, found.message)
                rows.setdefault(names[found.topic.strip("/")], []).append(row)
    for entry in sensors:
        if entry.sensor.id not in rows:
            raise BagError(f"{path}: topic {entry.topic!r} holds no scan; leave {entry.sensor.id} out")
    return rows


def _without_strays(rows: list[_Row]) -> list[_Row]:
    """Leave out scans with a stamp out of line: one wrong stamp would otherwise stretch the recording by years."""
    lags = np.array([recorded_ns - stamp_ns for stamp_ns, recorded_ns, _ in rows]) / _NANOSECONDS
    close = np.abs(lags - np.median(lags)) <= _STRAY_STAMP
    return [row for row, keep in zip(rows, close, strict=True) if keep]


def _scans(entry: TopicSensor, rows: list[_Row], start_ns: int) -> tuple[list[RecordedScan], list[str]]:
    """Return the usable scans of one sensor, and what is wrong with the others."""
    in_line = _without_strays(rows)
    faults = [f"stamp more than {_STRAY_STAMP:g} s off the others"] * (len(rows) - len(in_line))
    scans: list[RecordedScan] = []
    for stamp_ns, recorded_ns, message in in_line:
        try:
            scan = scan_from_message(message)
        except InvalidInput as error:
            faults.append(str(error))
            continue
        scan = _as_measured(entry, scan, (stamp_ns - start_ns) / _NANOSECONDS)
        pause = float(message.time_increment)
        if not 0.0 <= pause * (scan.ranges.size - 1) <= _LONGEST_SWEEP:
            pause = 0.0
        done = scan.stamp + pause * (scan.ranges.size - 1)
        recorded = (recorded_ns - start_ns) / _NANOSECONDS
        arrival = recorded if done <= recorded <= done + _SAME_CLOCK else done
        scans.append(RecordedScan(entry.sensor.id, arrival, scan, pause))
    return scans, faults


def _as_measured(entry: TopicSensor, scan: PlanarScan, stamp: float) -> PlanarScan:
    """Return the scan with its time in the recording, the sense of its beams and +inf where nothing came back."""
    sense = -1.0 if entry.mirrored else 1.0
    ranges = scan.ranges
    for code in entry.no_return:
        ranges = np.where(np.abs(ranges - code) <= _CODE_TOLERANCE, np.inf, ranges)
    return replace(
        scan,
        stamp=stamp,
        ranges=ranges,
        angle_min=sense * scan.angle_min,
        angle_increment=sense * scan.angle_increment,
    )
