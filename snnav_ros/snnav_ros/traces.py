"""How the motion of one robot comes from its messages into the record of a run, in the plane and in space."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from snnav_core.flight_types import FlightCommand, FlyerState
from snnav_core.tracking.spatial import SpatialTracker, SpatialTrackerSettings
from snnav_core.types import Pose2D, VelocityCommand
from snnav_ros.convert import flyer_state_from_message, state_from_message
from snnav_ros.convert.frames import attitude_of
from snnav_sim.report.flight_record import FlightRecord
from snnav_sim.report.record import Decision, RunRecord
from snnav_sim.space_types import FlyerScene

__all__ = ["FlightTrace", "GroundTrace", "Trace"]

_SAME_TIME = 5e-10  # [s]


class Trace(Protocol):
    """Where a robot is and what it was told."""

    in_space: bool
    """Whether its paths have heights."""
    hovers: bool
    """Whether it flies, and stands in the air by its last odometry."""

    def command(self, message: Any) -> None:
        """Take a command."""
        ...

    def odometry(self, message: Any, topic: str) -> None:
        """Take odometry."""
        ...

    def driven(self, message: Any) -> None:
        """Take what odometry says of the motion since the last one, before `odometry` takes where that led."""
        ...

    def follow(self, decision: Decision) -> None:
        """Take what the robot follows from now on."""
        ...

    def note(self, record: RunRecord, time: float) -> None:
        """Note place and motion at a time [s]; nothing before the first odometry."""
        ...


class GroundTrace:
    """A robot on the ground."""

    in_space = hovers = False

    def __init__(self, name: str) -> None:
        self._name = name
        self._pose: Pose2D | None = None
        self._motion = VelocityCommand(0.0, 0.0)

    def command(self, message: Any) -> None:
        """Take a command."""
        self._motion = VelocityCommand(message.linear.x, message.angular.z)

    def driven(self, message: Any) -> None:
        """Take what odometry says of the motion since the last one."""
        self.command(message.twist.twist)

    def odometry(self, message: Any, topic: str) -> None:
        """Take odometry."""
        self._pose = state_from_message(message, self._name, topic).pose

    def follow(self, decision: Decision) -> None:
        """What it follows is not looked at."""

    def note(self, record: RunRecord, time: float) -> None:
        """Note place and motion at a time [s]."""
        if self._pose is not None:
            record.add_sample(self._name, time, self._pose, self._motion)


class FlightTrace:
    """A flying robot; a tracker that follows the same paths from the same places measures how far it is off them.

    Parameters
    ----------
    robot : FlyerScene
    control_period : float
        [s]
    """

    in_space = True

    def __init__(self, robot: FlyerScene, control_period: float) -> None:
        self._name = robot.id
        self._tracker = SpatialTracker(robot.spec, SpatialTrackerSettings(), control_period)
        self._state: FlyerState | None = None
        self._told = self._motion = FlightCommand(0.0, np.zeros(3))
        self._next: Decision | None = None

    @property
    def hovers(self) -> bool:
        """Whether it stands in the air by its last odometry."""
        return self._state is not None and self._state.speed == 0.0

    def command(self, message: Any) -> None:
        """Take a command: the direction in which a hover is left is known from it alone."""
        velocity = np.array([message.linear.x, message.linear.y, message.linear.z])
        speed = float(np.linalg.norm(velocity))
        rate = np.array([message.angular.x, message.angular.y, message.angular.z])
        ahead = None
        if self._state is not None and self.hovers and speed > 0.0:
            ahead = attitude_of(self._state.direction) @ velocity / speed
        self._told = self._motion = FlightCommand(speed, rate, ahead)

    def driven(self, message: Any) -> None:
        """Take what odometry says of the motion since the last one."""
        twist = message.twist.twist
        rate = np.array([twist.angular.x, twist.angular.y, twist.angular.z])
        self._motion = FlightCommand(twist.linear.x, rate, self._told.direction)

    def odometry(self, message: Any, topic: str) -> None:
        """Take odometry."""
        self._state = flyer_state_from_message(message, self._name, topic)

    def follow(self, decision: Decision) -> None:
        """Follow the same path, from the time on for which it was decided: where the robot was then may come later."""
        self._next = decision

    def note(self, record: RunRecord, time: float) -> None:
        """Note place, motion and, where it flew, how far it was off its path at a time [s]."""
        if self._state is None:
            return
        assert isinstance(record, FlightRecord), "a run in space has a record of its own"
        record.add_flight(self._name, time, self._state, self._motion)
        if self._next is not None and self._next.time <= time + _SAME_TIME:
            decision, self._next = self._next, None
            ahead = None if self.hovers else self._state.direction
            self._tracker.set_path(decision.path, ahead, decision.valid_until)
        command = self._tracker.command(self._state, time)
        if command.speed > 0.0 and self._motion.speed > 0.0:
            record.add_error(self._name, time, self._tracker.distance_error, self._tracker.angle_error)
