"""Read from a recording where a robot drove or flew, and until when it was allowed to.

There are two times. *Log time* is that of recording. It only ever goes on, so it tells what came first: which
certificates had been heard when the robot moved, when something was killed, how long a robot stood. *ROS time* is that
of headers and certificates. Promises are made in it, so a motion is compared with the end of its window in ROS time;
it stands still while nobody publishes `/clock`, and begins anew when that is set back. A certificate holds up to then.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from snnav_core.types import FloatArray
from snnav_ros.bag.errors import BagError
from snnav_ros.bag.reader import BagReader
from snnav_ros.convert import (
    nanoseconds_from_stamp,
    seconds,
    seconds_from_stamp,
    state_from_message,
    verdict_from_message,
)

__all__ = ["EVENTS_TOPIC", "Drive", "Event", "Motions", "read_drive"]

EVENTS_TOPIC = "events"
"""What people did, in words (std_msgs/String); need not be there."""

_CLOCK = "/clock"
_TYPES = {"odom": "nav_msgs/msg/Odometry", "certificate": "diagnostic_msgs/msg/DiagnosticStatus"}
_ALONE = {
    _CLOCK: "rosgraph_msgs/msg/Clock",
    "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
    EVENTS_TOPIC: "std_msgs/msg/String",
}
_CLOCK_TOLERANCE = 0.1  # [s] that a certificate may be stamped ahead of whoever moves


@dataclass(frozen=True)
class Event:
    """Something that was said or done: log time and ROS time [s], and words."""

    log: float
    now: float
    text: str


@dataclass(frozen=True)
class Motions:
    """Changes of the pose of a robot's base, turns on the spot too, in the order of recording.

    Parameters
    ----------
    log : ndarray, shape (M,)
        Log time of the later pose [s].
    begin, end : ndarray, shape (M,)
        ROS times of both poses [s].
    before, after : ndarray, shape (M, 3)
        Their positions [m, map].
    allowed_until : ndarray, shape (M,)
        Latest end of all windows that were certified and heard by then [s]; -inf without any.
    """

    log: FloatArray
    begin: FloatArray
    end: FloatArray
    before: FloatArray
    after: FloatArray
    allowed_until: FloatArray

    def outside(self, tolerance: float = 1e-6) -> FloatArray:
        """Return by how much each motion outlasted its window [s], of those that did by more than `tolerance`."""
        late = self.end - self.allowed_until
        return late[late > tolerance]


@dataclass(frozen=True)
class Drive:
    """What a recording tells of one robot; log times are from the first message on.

    Parameters
    ----------
    robot_id : str
    poses : ndarray, shape (N, 6)
        Log time, stamp [s], x, y and z [m, map] and heading [rad] of its odometry.
    windows : ndarray, shape (W, 3)
        Log time, stamp and end [s] of every accepted certificate.
    clock : ndarray, shape (C, 2)
        Log time and ROS time [s].
    jumps : ndarray, shape (J,)
        Log times at which ROS time went back.
    events : tuple of Event
        What people did.
    remarks : tuple of Event
        What the nodes said on `/diagnostics`.
    """

    robot_id: str
    poses: FloatArray
    windows: FloatArray
    clock: FloatArray
    jumps: FloatArray
    events: tuple[Event, ...]
    remarks: tuple[Event, ...]

    def allowed_until(self, log: float, now: float) -> float:
        """Return until when the robot may drive, as known at a log time and a ROS time [s]; -inf: not at all."""
        return self.window_end(log, now + _CLOCK_TOLERANCE)

    def window_end(self, heard_by: float, stamped_by: float) -> float:
        """Return the latest end [s] of all windows that were heard by a log time and stamped by a ROS time, or -inf.

        Windows from before ROS time last began anew do not count.
        """
        heard, stamps, ends = self.windows.T
        holds = (heard <= heard_by) & (stamps <= stamped_by) & (self._epoch(heard) == self._epoch(heard_by))
        return float(ends[holds].max(initial=-np.inf))

    def motions(self) -> Motions:
        """Return all changes of the pose.

        Where time begins anew, the change from one pose to the next is none: see `restarts`.
        """
        earlier, later = self.poses[:-1], self.poses[1:]
        moved = (later[:, 2:] != earlier[:, 2:]).any(axis=1) & (later[:, 1] >= earlier[:, 1])
        earlier, later = earlier[moved], later[moved]
        allowed = [self.allowed_until(log, now) for log, now in later[:, :2]]
        return Motions(
            later[:, 0], earlier[:, 1], later[:, 1], earlier[:, 2:5], later[:, 2:5], np.array(allowed)
        )

    def restarts(self) -> FloatArray:
        """Return how far the base was away from its last pose whenever time began anew [m]."""
        back = np.diff(self.poses[:, 1]) < 0.0
        return self._steps()[back]

    def distance(self, begin: float, end: float) -> float:
        """Return how far the base drove between two log times [m]."""
        return float(np.diff(self._sums(self._steps(), np.array([begin, end])))[0])

    def over_time(self, log: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return mean speeds and turn rates from each log time to the next, and what was left of the window then.

        Parameters
        ----------
        log : ndarray, shape (K,)

        Returns
        -------
        speeds, turn_rates : ndarray, shape (K - 1,)
            Metres driven and radians turned, to either side, in a second of log time.
        ndarray, shape (K,)
            [s], at least 0: for how long a window is over is of no interest.
        """
        turns = np.abs(np.diff(np.unwrap(self.poses[:, 5])))
        parts = self._steps(), turns
        speeds, turn_rates = (np.diff(self._sums(part, log)) / np.diff(log) for part in parts)
        now = self.now(log)
        ends = np.array([self.allowed_until(*pair) for pair in zip(log, now, strict=True)])
        return speeds, turn_rates, np.maximum(0.0, ends - now)

    def now(self, log: FloatArray) -> FloatArray:
        """Return the ROS times [s] that were known at log times; the first one before any was."""
        index = np.searchsorted(self.clock[:, 0], log, side="right") - 1
        return np.asarray(self.clock[np.maximum(index, 0), 1])

    def silences(self, longest: float = 0.3) -> list[tuple[float, float]]:
        """Return from when to when ROS time stood still for more than `longest` [s, log time]."""
        times = self.clock[:, 0]
        gaps = np.flatnonzero(np.diff(times) > longest)
        return [(float(times[gap]), float(times[gap + 1])) for gap in gaps]

    def _steps(self) -> FloatArray:
        """Return the ways from pose to pose [m], shape (N - 1,)."""
        return np.asarray(np.linalg.norm(np.diff(self.poses[:, 2:5], axis=0), axis=1))

    def _epoch(self, log: Any) -> Any:
        return np.searchsorted(self.jumps, log, side="right")

    def _sums(self, parts: FloatArray, log: FloatArray) -> FloatArray:
        """Return the sum of what happened from pose to pose, shape (N - 1,), up to log times.

        A part happens in the time by which the stamps of its poses differ, right before the later one is recorded;
        where time begins anew nothing happens.
        """
        times, lasted = self.poses[:, 0], np.diff(self.poses[:, 1])
        sums = np.concatenate(([0.0], np.cumsum(np.where(lasted >= 0.0, parts, 0.0))))
        begins = np.clip(times[1:] - lasted, times[:-1], times[1:])
        knots = np.concatenate((times[:1], np.stack((begins, times[1:]), axis=1).ravel()))
        values = np.concatenate((sums[:1], np.stack((sums[:-1], sums[1:]), axis=1).ravel()))
        return np.interp(log, knots, values)


class _Collector:
    """Takes the messages of a recording one by one."""

    def __init__(self, robot_id: str, start_ns: int, has_clock: bool) -> None:
        self._robot_id, self._start_ns, self._has_clock = robot_id, start_ns, has_clock
        self._now = -math.inf
        self._poses: list[tuple[float, ...]] = []
        self._windows: list[tuple[float, ...]] = []
        self._clock: list[tuple[float, float]] = []
        self._jumps: list[float] = []
        self._events: list[Event] = []
        self._remarks: list[Event] = []

    def take(self, topic: str, stamp_ns: int, message: Any) -> None:
        log = seconds(stamp_ns - self._start_ns)
        if not self._has_clock:
            self._tell_time(log, seconds(stamp_ns))
        if topic == _CLOCK:
            self._tell_time(log, seconds_from_stamp(message.clock))
        elif topic == "/diagnostics":
            texts = [f"{status.name}: {status.message}" for status in message.status]
            self._remarks += [Event(log, self._now, text) for text in texts]
        elif topic == f"/{EVENTS_TOPIC}":
            self._events.append(Event(log, self._now, str(message.data)))
        elif topic.endswith("/odom"):
            pose = state_from_message(message, self._robot_id, topic).pose
            stamp = seconds(nanoseconds_from_stamp(message.header.stamp))
            self._poses.append((log, stamp, pose.x, pose.y, message.pose.pose.position.z, pose.heading))
        else:
            verdict = verdict_from_message(message, topic)
            if verdict.certificate is not None and verdict.certificate.accepted:
                self._windows.append((log, verdict.stamp, verdict.certificate.valid_until))

    def _tell_time(self, log: float, now: float) -> None:
        if now < self._now:
            self._jumps.append(log)
        self._now = now
        self._clock.append((log, now))

    def drive(self) -> Drive:
        return Drive(
            self._robot_id,
            np.reshape(np.array(self._poses), (-1, 6)),
            np.reshape(np.array(self._windows), (-1, 3)),
            np.reshape(np.array(self._clock), (-1, 2)),
            np.array(self._jumps),
            tuple(self._events),
            tuple(self._remarks),
        )


def read_drive(path: str | Path, robot_id: str) -> Drive:
    """Read what a recording tells of one robot.

    ROS time is that of `/clock`; without that topic it is log time, as on robots that go by the clock on the wall.

    Parameters
    ----------
    path : path-like
        Any recording that `BagReader` reads.
    robot_id : str

    Returns
    -------
    Drive

    Raises
    ------
    BagError
        If the recording cannot be read, has no `<robot>/odom` or `<robot>/certificate`, or no pose.
    InvalidInput
        If a message is not as docs/interfaces.md has it.
    """
    with BagReader(path) as bag:
        topics = {f"/{robot_id}/{name}": kind for name, kind in _TYPES.items()}
        for topic, kind in topics.items():
            bag.require(topic, kind)
        for topic, kind in _ALONE.items():
            name = f"/{topic.strip('/')}"
            if name in bag.topics:
                bag.require(name, kind)
                topics[name] = kind
        collector: _Collector | None = None
        for entry in bag.messages(topics):
            collector = collector or _Collector(robot_id, entry.stamp_ns, _CLOCK in topics)
            collector.take(entry.topic, entry.stamp_ns, entry.message)
    drive = None if collector is None else collector.drive()
    if drive is None or not len(drive.poses):
        raise BagError(f"{path}: topic '{robot_id}/odom' has no message; record it again")
    if not len(drive.clock):
        raise BagError(f"{path}: topic '{_CLOCK}' has no message; record it again")
    return drive
