"""Whether a robot gets anywhere: one that drives or turns for long and gets nowhere stops and says so."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from snnav_core.types import FloatArray, PlannedPath, RobotSpec, Stop, StopReason

__all__ = ["Progress"]

_APART = 0.5  # [m]: farther than this from everywhere it has been, a robot has got somewhere new
_PATIENCE = 30.0  # [s] with a path, but without getting anywhere new, beyond ...
_WAYS = 2.0  # ... so many times as long as its longest path takes: it may have to go back all the way
_REST = 120.0  # [s] before it tries again


@dataclass(frozen=True)
class Progress:
    """Where a robot has been on the way to its goal, and for how long it has got nowhere new.

    Parameters
    ----------
    places : ndarray, shape (N, 2) or (N, 3)
        Where it has been, half a metre from each other [m, map].
    fruitless : int
        Decisions with a path since it got somewhere new. Waiting does not count: that has a reason of its own. Nor
        does what it does beside other robots, who may be to blame.
    longest : float
        Longest path meanwhile [m].
    refusal : str
        The last reason meanwhile why it got no path, in words.
    rest : int
        Decisions before it tries again; 0 while it tries.
    """

    places: FloatArray
    fruitless: int = 0
    longest: float = 0.0
    refusal: str = ""
    rest: int = 0

    @classmethod
    def at_start(cls, dimensions: int = 2) -> Progress:
        """Of a robot that has been nowhere yet."""
        return cls(np.zeros((0, dimensions)))

    def here(self, position: FloatArray) -> Progress:
        """The same with where the robot is now [m, map]."""
        if len(self.places) and np.linalg.norm(self.places - position, axis=1).min() <= _APART:
            return self
        return Progress(np.vstack((self.places, position)), rest=self.rest)

    def stop(self, robot: RobotSpec, position: FloatArray, room: float, safety_margin: float) -> Stop | None:
        """The stop of a robot that gets nowhere; None for one that may go on.

        Parameters
        ----------
        robot : RobotSpec
        position : ndarray
            Where it is [m, map].
        room, safety_margin : float
            Its distance from the boundary and what it has to keep [m].
        """
        if self.rest == 0:
            return None
        why = f"; what stopped it last: {self.refusal}" if self.refusal else ""
        place = ", ".join(f"{value:.2f}" for value in position.tolist())
        message = (
            f"robot {robot.id} gets nowhere: it moved or turned for over {_PATIENCE:.0f} s and got at most "
            f"{_APART:g} m from where it had been; it stands at ({place}), {room:.2f} m from the boundary{why}; widen "
            f"that place or reduce the safety margin ({safety_margin:.2f} m), or send it elsewhere; it tries again "
            f"within {_REST:.0f} s"
        )
        return Stop(robot.id, StopReason.NO_PROGRESS, message)

    def after(
        self, decision: PlannedPath | Stop, interval: float, speed: float, in_company: bool
    ) -> Progress:
        """The same with what was decided now.

        Parameters
        ----------
        decision : PlannedPath or Stop
        interval : float
            From decision to decision [s].
        speed : float
            Of the robot [m/s].
        in_company : bool
            Whether another robot is near, who may be to blame.
        """
        if self.rest > 0:
            return replace(self, rest=self.rest - 1)
        if isinstance(decision, Stop):
            return replace(self, refusal=decision.message)
        if in_company:
            return self
        longest = max(self.longest, decision.path.length)
        allowed = _PATIENCE + _WAYS * longest / speed
        if (self.fruitless + 1) * interval <= allowed:
            return replace(self, fruitless=self.fruitless + 1, longest=longest)
        return Progress(self.places, refusal=self.refusal, rest=max(1, round(_REST / interval)))
