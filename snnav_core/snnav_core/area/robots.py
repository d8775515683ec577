"""Where robots were when sensors saw them, in the plane or in space (deviation C3-6, C4-23)."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections import deque

import numpy as np

from snnav_core.errors import InvalidInput
from snnav_core.flight_types import FlyerState
from snnav_core.types import TIME_TOLERANCE, FloatArray, Pose2D, RobotSpec

__all__ = ["LONGEST_EXTRAPOLATION", "LONGEST_GAP", "RobotTrack"]

LONGEST_GAP = 2.0
"""Between two states farther apart than this the position is unknown [s]."""

LONGEST_EXTRAPOLATION = 0.2
"""Later than this after the last state the position is unknown [s]."""

_STATES = 1000


class RobotTrack:
    """The states of one robot in the order of their stamps, and its position in between.

    Parameters
    ----------
    robot : RobotSpec

    Notes
    -----
    Holds the last 1000 states; what was before the first of them is unknown.
    """

    def __init__(self, robot: RobotSpec) -> None:
        self.robot = robot
        self._stamps: deque[float] = deque(maxlen=_STATES)
        self._places: deque[FloatArray] = deque(maxlen=_STATES)
        self._speed, self._ahead = 0.0, np.zeros(0)

    @property
    def last_stamp(self) -> float | None:
        """Stamp of the last state [s], or None."""
        return self._stamps[-1] if self._stamps else None

    def clear(self) -> None:
        """Forget all states, as after a jump of time."""
        self._stamps.clear()
        self._places.clear()

    def add(self, stamp: float, pose: Pose2D, speed: float = 0.0) -> None:
        """Take the state of the robot at `stamp` [s]; one with the stamp of the last state replaces it.

        Parameters
        ----------
        stamp : float
            Time of the state [s].
        pose : Pose2D
            Pose of the robot [map].
        speed : float
            Forward speed [m/s].

        Raises
        ------
        InvalidInput
            If a number is not finite, or the state is older than the last one.
        """
        if not all(map(math.isfinite, (stamp, pose.x, pose.y, pose.heading, speed))):
            raise InvalidInput(
                f"robot {self.robot.id!r}: state at {stamp} s with {pose} and speed {speed} m/s is not finite; "
                "check its odometry"
            )
        ahead = np.array([math.cos(pose.heading), math.sin(pose.heading)])
        self._append(stamp, pose.position, ahead, speed)

    def add_flyer(self, state: FlyerState) -> None:
        """Take the state of a flying robot; the same as `add`."""
        if not (math.isfinite(state.stamp) and math.isfinite(state.speed)):
            raise InvalidInput(
                f"robot {self.robot.id!r}: state at {state.stamp} s with speed {state.speed} m/s is not finite; "
                "check its odometry"
            )
        self._append(state.stamp, state.position, state.direction, state.speed)

    def _append(self, stamp: float, place: FloatArray, ahead: FloatArray, speed: float) -> None:
        last = self.last_stamp
        if last is not None and stamp < last - TIME_TOLERANCE:
            raise InvalidInput(
                f"robot {self.robot.id!r}: state stamped {stamp:.3f} s is older than its last ({last:.3f} s): ignored"
            )
        if last is not None and stamp <= last + TIME_TOLERANCE:
            self._stamps.pop()
            self._places.pop()
        self._stamps.append(stamp)
        self._places.append(place)
        self._speed, self._ahead = speed, ahead

    def position(self, stamp: float) -> FloatArray | None:
        """Position (2,) or (3,) [m, map] of the robot at a time [s], or None where it is unknown, see `place`."""
        found = self.place(stamp)
        return None if found is None else found[0]

    def place(self, stamp: float) -> tuple[FloatArray, float] | None:
        """Position of the robot at a time, and how far from there it may be.

        Parameters
        ----------
        stamp : float
            Time [s].

        Returns
        -------
        (ndarray (2,) or (3,), float) or None
            Between two states no more than `LONGEST_GAP` apart: interpolated linearly, 0 m. Up to
            `LONGEST_EXTRAPOLATION` after the last state: straight on at its speed, and the way that the robot may have
            driven since, in case it stopped or turned [m]. None for any other time.
        """
        if not self._stamps or not math.isfinite(stamp):
            return None
        after = bisect_left(self._stamps, stamp - TIME_TOLERANCE)
        if after == len(self._stamps):
            return self._extrapolated(stamp)
        later = self._places[after]
        if self._stamps[after] <= stamp + TIME_TOLERANCE:
            return later, 0.0
        gap = self._stamps[after] - self._stamps[after - 1] if after else math.inf
        if gap > LONGEST_GAP + TIME_TOLERANCE:
            return None
        share = (stamp - self._stamps[after - 1]) / gap
        earlier = self._places[after - 1]
        return earlier + share * (later - earlier), 0.0

    def astray(self, stamp: float) -> float:
        """How far off the straight line between two states the robot may be at a time in between [m].

        At its greatest speed it may have flown a detour that brought it back: with v T the way that it could have flown
        between them, D their distance and s the share of the time, sqrt(s (1 - s) ((v T)^2 - D^2)). 0 at a state, and
        outside of the states, where `place` says it.
        """
        after = bisect_left(self._stamps, stamp - TIME_TOLERANCE)
        if not 0 < after < len(self._stamps) or self._stamps[after] <= stamp + TIME_TOLERANCE:
            return 0.0
        earlier, later = self._stamps[after - 1], self._stamps[after]
        share, way = (stamp - earlier) / (later - earlier), self.robot.speed * (later - earlier)
        gap = float(np.linalg.norm(self._places[after] - self._places[after - 1]))
        return math.sqrt(share * (1.0 - share) * max(way * way - gap * gap, 0.0))

    def _extrapolated(self, stamp: float) -> tuple[FloatArray, float] | None:
        elapsed = stamp - self._stamps[-1]
        if elapsed > LONGEST_EXTRAPOLATION + TIME_TOLERANCE:
            return None
        fastest = max(abs(self._speed), self.robot.speed)
        return self._places[-1] + elapsed * self._speed * self._ahead, elapsed * fastest
