"""What happened in a run in space: the record of a run with three coordinates and the errors of tracking."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from snnav_core.flight_types import FlightCommand, FlyerState
from snnav_core.types import FloatArray
from snnav_sim.report.record import RunRecord

__all__ = ["FlightRecord"]


@dataclass
class FlightRecord(RunRecord):
    """Filled while flying robots run.

    Parameters
    ----------
    samples : dict
        Robot id -> rows (time, x, y, z, heading, pitch, speed, turn_rate): ground truth, one per control period, with
        the motion that begins at that time [s, m, rad, m/s, rad/s].
    errors : dict
        Robot id -> rows (time, e_d, e_a) of the tracker, one per control period with a path [s, m, rad].
    """

    errors: dict[str, list[tuple[float, float, float]]] = field(default_factory=dict)

    def add_flight(self, robot: str, time: float, state: FlyerState, motion: FlightCommand) -> None:
        """Note where a robot is at a time [s] and how it moves from there."""
        ahead = state.direction if motion.direction is None else motion.direction
        heading = math.atan2(ahead[1], ahead[0])
        pitch = math.asin(min(max(float(ahead[2]), -1.0), 1.0))
        x, y, z = state.position.tolist()
        turn_rate = float(np.linalg.norm(motion.turn))
        row = (time, x, y, z, heading, pitch, motion.speed, turn_rate)
        self.samples.setdefault(robot, []).append(row)

    def add_error(self, robot: str, time: float, distance: float, angle: float) -> None:
        """Note how far a robot is off its path."""
        self.errors.setdefault(robot, []).append((time, distance, angle))

    def trajectory(self, robot: str) -> FloatArray:
        """Return the rows of a robot, shape (N, 8)."""
        return np.array(self.samples.get(robot, []), dtype=np.float64).reshape(-1, 8)
