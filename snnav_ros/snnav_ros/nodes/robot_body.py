"""What a robot node moves: a base on the ground or in the air with its tracker, and what they tell and are told."""

from __future__ import annotations

from collections import deque
from typing import Any, Generic, Protocol, TypeVar

import numpy as np
import shapely
from geometry_msgs.msg import Twist

from snnav_core.flight_types import FlightCommand, FlyerState
from snnav_core.tracking.planar import PlanarTracker
from snnav_core.tracking.spatial import SpatialTracker
from snnav_core.types import FloatArray, Pose2D, RobotSpec, TimedPath, VelocityCommand
from snnav_ros.convert import (
    flight_command_to_message,
    flight_to_message,
    nanoseconds_from_stamp,
    odometry_to_message,
    state_from_message,
)
from snnav_sim.devices.base import PioneerBase
from snnav_sim.devices.flyer_base import FlyerBase

__all__ = ["Body", "FlyerBody", "GroundBody"]

_KEPT = 200  # measured poses
_STOP = VelocityCommand(0.0, 0.0)
_HOVER = FlightCommand(0.0, np.zeros(3))

_TrackerT = TypeVar("_TrackerT", PlanarTracker, SpatialTracker)


class Body(Protocol):
    """A base with its tracker; times are nanoseconds of the robot's clock unless they are in seconds."""

    spec: RobotSpec
    in_space: bool
    """Whether its paths have heights."""
    measured_at: int | None
    """When it was measured last where the robot is [ns]; None before."""

    @property
    def finished(self) -> bool:
        """Whether there is nothing (more) to follow."""
        ...

    @property
    def speed(self) -> float:
        """Speed of the present command [m/s]."""
        ...

    @property
    def error(self) -> float:
        """Distance from the path at the last command [m]."""
        ...

    def begin(self) -> None:
        """Stand at the start."""
        ...

    def forget(self) -> None:
        """Be without a path, without a command, and without what was measured; the base stays where it is."""
        ...

    def hear(self, message: Any, topic: str) -> None:
        """Take the odometry of a real base; InvalidInput says why it cannot be used."""
        ...

    def move(self, duration: float, hold: float) -> None:
        """Let the simulated base do for a while what it was told [s]; it stops by itself `hold` after that [s]."""
        ...

    def measure(self, now: int) -> Any:
        """Note where the simulated base is, and return its odometry."""
        ...

    def away(self, path: TimedPath) -> float:
        """Return how far from the robot a path passes [m]; 0 while it is not known where the robot is."""
        ...

    def follow(self, path: TimedPath | None, start: int, valid_until: float | None) -> None:
        """Hand the tracker a path that begins at a time [ns]; None means stop."""
        ...

    def steer(self, time: float) -> None:
        """Take the command of the tracker for the coming control period, from a time on [s]."""
        ...

    def halt(self) -> None:
        """Take the command to stop."""
        ...

    def twist(self) -> Twist:
        """Return the present command as a message."""
        ...


class _Guided(Generic[_TrackerT]):
    """What a body on the ground and one in space share: the tracker, and the command that it gave.

    Parameters
    ----------
    tracker : PlanarTracker or SpatialTracker
    """

    _command: VelocityCommand | FlightCommand

    def __init__(self, tracker: _TrackerT) -> None:
        self._tracker = tracker

    @property
    def finished(self) -> bool:
        """Whether there is nothing (more) to follow."""
        return self._tracker.finished

    @property
    def speed(self) -> float:
        """Speed of the present command [m/s]."""
        return self._command.speed


class GroundBody(_Guided[PlanarTracker]):
    """A unicycle; simulated, that of a Pioneer 3-DX.

    Parameters
    ----------
    spec : RobotSpec
    start : Pose2D
        Where the simulated base stands at first [map].
    tracker : PlanarTracker
    """

    in_space = False

    def __init__(self, spec: RobotSpec, start: Pose2D, tracker: PlanarTracker) -> None:
        super().__init__(tracker)
        self.spec, self._start = spec, start
        self.begin()
        self.forget()

    @property
    def error(self) -> float:
        """Distance from the path at the last command, to the left positive [m]."""
        return self._tracker.cross_track_error

    def begin(self) -> None:
        """Stand at the start."""
        self._base = PioneerBase(self._start, self.spec)

    def forget(self) -> None:
        """Be without a path, without a command, and without what was measured; the base stays where it is."""
        self._tracker.reset()
        self._command = _STOP
        self._pose: Pose2D | None = None
        self.measured_at: int | None = None
        self._headings: deque[tuple[int, float]] = deque(maxlen=_KEPT)

    def hear(self, message: Any, topic: str) -> None:
        """Take the odometry of a real base."""
        pose = state_from_message(message, self.spec.id, topic).pose
        self._note(nanoseconds_from_stamp(message.header.stamp), pose)

    def move(self, duration: float, hold: float) -> None:
        """Drive on."""
        self._base.apply(self._command, duration, hold)

    def measure(self, now: int) -> Any:
        """Note where the simulated base is, and return its odometry."""
        self._note(now, self._base.pose)
        driven = self._base.command
        return odometry_to_message(self.spec.id, self._base.pose, driven.speed, driven.turn_rate, now)

    def _note(self, stamp: int, pose: Pose2D) -> None:
        self.measured_at, self._pose = stamp, pose
        self._headings.append((stamp, pose.heading))

    def away(self, path: TimedPath) -> float:
        """Return how far from the robot a path passes [m]."""
        if self._pose is None:
            return 0.0
        line = shapely.linestrings(path.points[:, :2])
        return float(shapely.distance(line, shapely.points(self._pose.position)))

    def follow(self, path: TimedPath | None, start: int, valid_until: float | None) -> None:
        """Hand the tracker a path; its curve begins with the heading that the robot had then."""
        heading = None
        if path is not None:
            heading = next((value for when, value in reversed(self._headings) if when <= start), None)
        self._tracker.set_path(path, heading, valid_until)

    def steer(self, time: float) -> None:
        """Take the command of the tracker."""
        assert self._pose is not None, "nothing is steered before it is known where it is"
        self._command = self._tracker.command(self._pose, time)

    def halt(self) -> None:
        """Take the command to stop."""
        self._command = _STOP

    def twist(self) -> Twist:
        """Return the present command as a message."""
        twist = Twist()
        twist.linear.x, twist.angular.z = self._command.speed, self._command.turn_rate
        return twist


class FlyerBody(_Guided[SpatialTracker]):
    """A simulated flying robot: it hovers where it has nothing to follow.

    Parameters
    ----------
    start : FlyerState
        It hovers there at first.
    spec : RobotSpec
    tracker : SpatialTracker
    """

    in_space = True

    def __init__(self, start: FlyerState, spec: RobotSpec, tracker: SpatialTracker) -> None:
        super().__init__(tracker)
        self.spec, self._start = spec, start
        self.begin()
        self.forget()

    @property
    def error(self) -> float:
        """e_d: distance from the path at the last command [m]."""
        return self._tracker.distance_error

    def begin(self) -> None:
        """Hover at the start."""
        self._base = FlyerBase(self._start, self.spec)

    def forget(self) -> None:
        """Be without a path, without a command, and without what was measured; the base stays where it is."""
        self._tracker.reset()
        self._command = _HOVER
        self.measured_at: int | None = None
        self._states: deque[tuple[int, FlyerState]] = deque(maxlen=_KEPT)

    def hear(self, message: Any, topic: str) -> None:
        """There is no real base yet."""
        raise NotImplementedError("a flying robot is simulated")

    def move(self, duration: float, hold: float) -> None:
        """Fly on, or hover."""
        self._base.apply(self._command, duration, hold)

    def measure(self, now: int) -> Any:
        """Note where the simulated base is, and return its odometry."""
        self.measured_at = now
        self._states.append((now, self._base.state))
        flown = self._base.command
        begin = self._base.state.direction if flown.direction is None else flown.direction
        return flight_to_message(self._base.state, np.cross(begin, flown.turn), now)

    def away(self, path: TimedPath) -> float:
        """Return how far from the robot a path passes [m]."""
        return _distance(path.points, self._states[-1][1].position) if self._states else 0.0

    def follow(self, path: TimedPath | None, start: int, valid_until: float | None) -> None:
        """Hand the tracker a path; its curve begins in the direction in which the robot flew then."""
        state = next((value for when, value in reversed(self._states) if when <= start), None)
        flew = path is not None and state is not None and state.speed > 0.0
        self._tracker.set_path(path, state.direction if flew and state is not None else None, valid_until)

    def steer(self, time: float) -> None:
        """Take the command of the tracker."""
        self._command = self._tracker.command(self._base.state, time)

    def halt(self) -> None:
        """Take the command to hover."""
        self._command = _HOVER

    def twist(self) -> Twist:
        """Return the present command as a message."""
        return flight_command_to_message(self._command, self._base.state)


def _distance(points: FloatArray, place: FloatArray) -> float:
    """Return the distance of a place (3,) from a chain of points (N, 3), N > 1 [m]."""
    starts, links = points[:-1], np.diff(points, axis=0)
    squares = np.maximum(np.einsum("ij,ij->i", links, links), 1e-300)
    share = np.clip(np.einsum("ij,ij->i", place - starts, links) / squares, 0.0, 1.0)
    return float(np.linalg.norm(starts + share[:, None] * links - place, axis=1).min())
