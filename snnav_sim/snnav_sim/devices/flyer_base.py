"""The base of a flying robot: hovers, or flies with a limited turn rate."""

from __future__ import annotations

import math

import numpy as np

from snnav_core.errors import InvalidInput
from snnav_core.flight_types import FlightCommand, FlyerState
from snnav_core.motion.flyer import limit_turn, step_flyer
from snnav_core.types import RobotSpec

__all__ = ["FlyerBase"]

_HOVER = FlightCommand(0.0, np.zeros(3))


class FlyerBase:
    """A flying robot that does what it is told within its limits.

    Parameters
    ----------
    state : FlyerState
        At the start.
    spec : RobotSpec
        Its speed and turn rate are the limits.
    """

    def __init__(self, state: FlyerState, spec: RobotSpec) -> None:
        self.spec = spec
        self.state = state
        self.command = _HOVER

    def apply(self, command: FlightCommand, duration: float, hold: float = math.inf) -> FlyerState:
        """Let a while pass after a command and return the new state.

        Parameters
        ----------
        command : FlightCommand
            Clipped to speeds from 0 to the robot's speed and to its turn rate; `command` of the base holds what was
            flown.
        duration : float
            Time that passes [s].
        hold : float
            The robot hovers by itself so long after the command [s]: whoever gave it may have fallen asleep.

        Raises
        ------
        InvalidInput
            If the speed is not finite.
        """
        if not math.isfinite(command.speed):
            raise InvalidInput(f"robot {self.spec.id!r}: command {command} is not finite")
        hovers = self.state.speed == 0.0 and command.direction is not None
        ahead = command.direction if hovers and command.direction is not None else self.state.direction
        turn = limit_turn(command.turn, ahead, self.spec.max_turn_rate)
        speed = min(max(command.speed, 0.0), self.spec.speed)
        self.command = FlightCommand(speed, turn, ahead)
        flown = min(duration, hold)
        state = step_flyer(self.state, self.command, self.spec.max_turn_rate, flown)
        if flown < duration:
            self.command = FlightCommand(0.0, np.zeros(3), ahead)
            state = step_flyer(state, _HOVER, self.spec.max_turn_rate, duration - flown)
        self.state = state
        return self.state
