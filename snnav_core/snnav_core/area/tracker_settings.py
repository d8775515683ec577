"""How bodies are tracked, and what comes out."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from snnav_core.errors import InvalidInput
from snnav_core.obstacles import MovingObstacle
from snnav_core.types import FloatArray

__all__ = ["TrackedScene", "TrackerSettings"]


@dataclass(frozen=True, slots=True)
class TrackerSettings:
    """Tunable constants of the tracker.

    Parameters
    ----------
    window : float
        A velocity is fitted to the measurements of so long [s].
    least_samples : int
        Before so many measurements no body counts as moving.
    link_distance : float
        Hits nearer to each other than this belong to one body [m].
    leg_distance : float
        The same for hits that have arrived within the window: the two legs of somebody who walks [m].
    largest_body : float
        What extends farther is no body that moves [m].
    least_points : int
        A body has at least so many hits in one measurement.
    top_speed : float
        No body is faster [m/s]; also the deviation of a velocity of which nothing is known.
    least_speed : float
        What is slower counts as standing [m/s].
    confidence : float
        A body moves when its velocity is more than so many standard deviations.
    free_depth : float
        A hit farther than this in front of what the same beams measured within the window, or behind which they look
        now, is a sign of motion [m].
    least_evidence : int
        So many such signs make a body move.
    range_noise : float
        Standard deviation of a range, rounding included [m].
    patience : float
        A body that is not seen any more goes on for so long [s].

    Raises
    ------
    InvalidInput
        If a number is outside its range.
    """

    window: float = 1.5
    least_samples: int = 3
    link_distance: float = 0.3
    leg_distance: float = 0.6
    largest_body: float = 4.0
    least_points: int = 3
    top_speed: float = 2.0
    least_speed: float = 0.05
    confidence: float = 2.0
    free_depth: float = 0.04
    least_evidence: int = 3
    range_noise: float = 0.005
    patience: float = 1.0

    def __post_init__(self) -> None:
        for entry in fields(self):
            value = getattr(self, entry.name)
            if not (math.isfinite(value) and value > 0):
                raise InvalidInput(f"tracker: {entry.name} is {value}, must be a positive number")
        if self.least_samples < 2:
            raise InvalidInput(f"tracker: least_samples is {self.least_samples}, must be at least 2")


@dataclass(frozen=True)
class TrackedScene:
    """What a planner in space-time plans among: bodies, and the region in which everything lies.

    Parameters
    ----------
    stamp : float
        Time for which it holds [s].
    obstacles : tuple of MovingObstacle
        Bodies at `stamp`, those that move first. A body that stands has velocity exactly 0; `velocity_deviation` is
        the top speed while nothing is known of its motion (it was not yet measured often enough). A hole that no hit
        belongs to (``unseen_1``, ...) stands like what lies outside of the workspace.
    workspace : tuple of ndarray, shapes (N, 2)
        Exterior rings of the region, counter-clockwise [m, map]; what stands in there are bodies. What is neither
        inside of it nor covered by a body was not seen free: it counts as an obstacle that stands.

    Notes
    -----
    The bodies at `stamp` and all that lies outside of the workspace cover everything that is not seen to be free.
    """

    stamp: float
    obstacles: tuple[MovingObstacle, ...]
    workspace: tuple[FloatArray, ...]
