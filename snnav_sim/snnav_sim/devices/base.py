"""The base of a Pioneer 3-DX: a unicycle whose turn rate is limited."""

from __future__ import annotations

import math

from snnav_core.errors import InvalidInput
from snnav_core.motion.unicycle import step_unicycle
from snnav_core.types import Pose2D, RobotSpec, VelocityCommand

__all__ = ["PioneerBase"]


class PioneerBase:
    """A robot base that does what it is told within its limits.

    Parameters
    ----------
    pose : Pose2D
        Pose at the start [map].
    spec : RobotSpec
        Its speed and turn rate are the limits.
    """

    def __init__(self, pose: Pose2D, spec: RobotSpec) -> None:
        self.spec = spec
        self.pose = pose
        self.command = VelocityCommand(0.0, 0.0)

    def apply(self, command: VelocityCommand, duration: float, hold: float = math.inf) -> Pose2D:
        """Let a while pass after a command and return the new pose.

        Parameters
        ----------
        command : VelocityCommand
            Clipped to speeds from 0 to the robot's speed and to its turn rate; `command` of the base holds what
            was driven.
        duration : float
            Time that passes [s].
        hold : float
            The base stops by itself so long after the command [s]: whoever gave it may have fallen asleep.

        Raises
        ------
        InvalidInput
            If the command is not finite.
        """
        if not (math.isfinite(command.speed) and math.isfinite(command.turn_rate)):
            raise InvalidInput(f"robot {self.spec.id!r}: command {command} is not finite")
        limit = self.spec.max_turn_rate
        self.command = VelocityCommand(
            min(max(command.speed, 0.0), self.spec.speed), min(max(command.turn_rate, -limit), limit)
        )
        driven = min(duration, hold)
        self.pose = step_unicycle(self.pose, self.command.speed, self.command.turn_rate, driven)
        if driven < duration:
            self.command = VelocityCommand(0.0, 0.0)
        return self.pose
