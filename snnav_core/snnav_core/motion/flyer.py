"""The flying robot with bounded turn rate (Ch. 4, robot model), integrated exactly."""

from __future__ import annotations

import math

import numpy as np

from snnav_core.errors import InvalidInput
from snnav_core.flight_types import FlightCommand, FlyerState
from snnav_core.types import FloatArray

__all__ = ["limit_turn", "step_flyer"]

_STRAIGHT = 1e-9  # [rad]; a smaller turn in a period is none


def limit_turn(turn: FloatArray, direction: FloatArray, max_turn_rate: float) -> FloatArray:
    """Project a turn onto the plane across the direction and limit it: u perpendicular to i, |u| <= U_M.

    Parameters
    ----------
    turn : ndarray, shape (3,)
        Wanted rate of change of the direction [rad/s, map].
    direction : ndarray, shape (3,)
        Unit vector of travel [map].
    max_turn_rate : float
        U_M [rad/s].

    Raises
    ------
    InvalidInput
        If the turn is not finite.
    """
    if not np.isfinite(turn).all():
        raise InvalidInput(f"turn {turn.tolist()} rad/s cannot be limited to {max_turn_rate} rad/s")
    across = turn - (turn @ direction) * direction
    rate = float(np.linalg.norm(across))
    return across if rate <= max_turn_rate else across * (max_turn_rate / rate)


def step_flyer(state: FlyerState, command: FlightCommand, max_turn_rate: float, dt: float) -> FlyerState:
    """Fly one period along an exact arc.

    Parameters
    ----------
    state : FlyerState
    command : FlightCommand
        Constant over the period in the frame of the arc: its turn is the rate at the beginning, and keeps its
        magnitude and plane. A robot that hovers takes the direction of the command, if it names one.
    max_turn_rate : float
        U_M [rad/s]; what the command demands beyond it is not done.
    dt : float
        Period [s].

    Notes
    -----
    Deviation: the direction of a robot that hovers is not defined in the thesis; it may leave in any direction.

    Examples
    --------
    A quarter of a circle of radius 2 m, upwards:

    >>> start = FlyerState("bee", np.zeros(3), np.array([1.0, 0.0, 0.0]), 0.0, 1.0)
    >>> climb = FlightCommand(1.0, np.array([0.0, 0.0, 0.5]))
    >>> np.round(step_flyer(start, climb, 1.0, math.pi).position, 9).tolist()
    [2.0, 0.0, 2.0]
    """
    hovers = state.speed == 0.0 and command.direction is not None
    direction = command.direction if hovers and command.direction is not None else state.direction
    turn = limit_turn(command.turn, direction, max_turn_rate)
    rate = float(np.linalg.norm(turn))
    angle = rate * dt
    length = command.speed * dt
    if angle < _STRAIGHT:
        position, new = state.position + length * direction, direction
    else:
        side = turn / rate
        position = state.position + (length / angle) * (
            math.sin(angle) * direction + (1.0 - math.cos(angle)) * side
        )
        new = math.cos(angle) * direction + math.sin(angle) * side
    return FlyerState(state.id, position, new / np.linalg.norm(new), state.stamp + dt, command.speed)
