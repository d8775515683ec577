"""Values of flying robots: their state and their command (Ch. 4, robot model)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from snnav_core.errors import InvalidInput
from snnav_core.types import FloatArray

__all__ = ["FlightCommand", "FlyerState", "direction_of"]

_UNIT_TOLERANCE = 1e-6
_RESOLUTION = 2.0**-45  # of the components of a direction
_NO_SMALLER = 1e-9  # a component that is smaller than the largest by no more counts as the largest


def direction_of(heading: float, pitch: float) -> FloatArray:
    """Return the unit vector of a heading [rad, map, from the x axis] and a pitch [rad, upwards positive], (3,)."""
    level = math.cos(pitch)
    return np.array([level * math.cos(heading), level * math.sin(heading), math.sin(pitch)])


def _vector(name: str, value: FloatArray) -> FloatArray:
    array = np.array(value, dtype=np.float64)
    if array.shape != (3,) or not np.isfinite(array).all():
        raise InvalidInput(f"{name} is {array.tolist()}, expected three finite numbers")
    array.setflags(write=False)
    return array


def _unit(name: str, value: FloatArray) -> FloatArray:
    vector = _vector(name, value)
    length = float(np.linalg.norm(vector))
    if abs(length - 1.0) > _UNIT_TOLERANCE:
        raise InvalidInput(f"{name} has length {length:.6g}, must be a unit vector")
    return _quantised(vector / length)


def _quantised(direction: FloatArray) -> FloatArray:
    """Return a unit vector on a grid of 3e-14: it is the same after a conversion to a quaternion and back.

    All components but the largest are rounded, and that one follows from them.
    """
    sizes = np.abs(direction)
    largest = int(np.argmax(sizes > sizes.max() - _NO_SMALLER))
    rounded = np.round(direction / _RESOLUTION) * _RESOLUTION
    rounded[largest] = 0.0
    rounded[largest] = math.copysign(math.sqrt(1.0 - float(rounded @ rounded)), direction[largest])
    quantised: FloatArray = rounded + 0.0  # no negative zeros
    quantised.setflags(write=False)
    return quantised


@dataclass(frozen=True)
class FlyerState:
    """Where a flying robot is and where it heads (Ch. 4, s(t) and i(t)).

    Parameters
    ----------
    id : str
    position : array_like, shape (3,)
        [m, map]
    direction : array_like, shape (3,)
        Unit vector of travel [map]; kept to 3e-14, so that it survives a conversion to a quaternion and back.
    stamp : float
        [s]
    speed : float
        [m/s]; 0 while it hovers.

    Raises
    ------
    InvalidInput
        If a vector is not finite or the direction has not length 1.
    """

    id: str
    position: FloatArray
    direction: FloatArray
    stamp: float
    speed: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "position", _vector(f"robot {self.id!r}: position", self.position))
        object.__setattr__(self, "direction", _unit(f"robot {self.id!r}: direction", self.direction))


@dataclass(frozen=True)
class FlightCommand:
    """Speed and turn of a flying robot (Ch. 4, u).

    Parameters
    ----------
    speed : float
        [m/s]
    turn : array_like, shape (3,)
        Rate of change of the direction [rad/s, map], perpendicular to it.
    direction : array_like, shape (3,), optional
        Unit vector in which a robot that hovers leaves [map]; one that flies ignores it.

    Raises
    ------
    InvalidInput
        If a vector is not finite or the direction has not length 1.
    """

    speed: float
    turn: FloatArray
    direction: FloatArray | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "turn", _vector("flight command: turn", self.turn))
        if self.direction is not None:
            object.__setattr__(self, "direction", _unit("flight command: direction", self.direction))
