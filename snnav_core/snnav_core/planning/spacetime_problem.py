"""Question and answer of the global planner in space-time (Ch. 2)."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import Enum

from snnav_core.checks import check_not_negative, check_positive, check_whole
from snnav_core.errors import InvalidInput
from snnav_core.obstacles import MovingObstacle
from snnav_core.planning.adjustment import AdjustmentSettings
from snnav_core.types import Certificate, FloatArray, Pose2D, RobotSpec, TimedPath

__all__ = [
    "Candidate",
    "CandidateOutcome",
    "OtherRobot",
    "SpacetimePlan",
    "SpacetimeProblem",
    "SpacetimeSettings",
    "TravelBound",
]


@dataclass(frozen=True)
class OtherRobot:
    """A robot that was planned before (Ch. 2, third simulation).

    Parameters
    ----------
    id : str
    path : TimedPath
        It stays at the first point before and at the last one after (C2-12).
    distance : float
        What is kept from its centre to the centre of the planned robot [m].
    """

    id: str
    path: TimedPath
    distance: float


@dataclass(frozen=True)
class SpacetimeProblem:
    """One robot, where it is and where it shall go, among bodies in uniform motion.

    Parameters
    ----------
    robot : RobotSpec
    start : Pose2D
        [m, rad, map]
    start_time : float
        [s]
    target : ndarray, shape (2,)
        [m, map]
    obstacles : tuple of MovingObstacle
    others : tuple of OtherRobot
    workspace : tuple of ndarray, shapes (N, 2), or None
        Rings of the region outside of which everything counts as obstacle [m, map]: the exterior counter-clockwise,
        holes clockwise; None for the open plane.
    """

    robot: RobotSpec
    start: Pose2D
    start_time: float
    target: FloatArray
    obstacles: tuple[MovingObstacle, ...] = ()
    others: tuple[OtherRobot, ...] = ()
    workspace: tuple[FloatArray, ...] | None = None


@dataclass(frozen=True, slots=True)
class SpacetimeSettings:
    """Tunable constants of the planner.

    Parameters
    ----------
    sampling_interval : float
        delta [s]; the links of a path have length v delta, or a fraction of it where C0-10 or C2-10 demand it.
    safety_margin : float
        d_s, from the robot's centre [m].
    tracking_tolerance : float
        How far the robot may be from its timed path [m]; added to the margin.
    adjustment : AdjustmentSettings
        Gains of A1-A3.
    graze : float
        eps of C2-4 and C2-5 as a share of the planning distance.
    candidates : int
        Largest number of candidates (C2-9).
    longest : float
        A candidate ends when it is longer than so many straight distances (C2-3), perimeters of bodies added.
    longest_link : float
        Candidates with links longer or shorter than this share are stretched (C0-11): 1.02 means 2 %.

    Raises
    ------
    InvalidInput
        If a number is outside its range.
    """

    sampling_interval: float = 0.3
    safety_margin: float = 0.6
    tracking_tolerance: float = 0.02
    adjustment: AdjustmentSettings = field(default_factory=lambda: AdjustmentSettings(pull=0.07))
    graze: float = 0.025
    candidates: int = 64
    longest: float = 3.0
    longest_link: float = 1.02

    def __post_init__(self) -> None:
        owner = "global planner: "
        check_positive(self, ("sampling_interval", "safety_margin", "graze", "longest"), owner)
        check_not_negative(self, ("tracking_tolerance",), owner)
        check_whole(self, ("candidates",), 1, owner)
        if not self.longest_link > 1.0:
            raise InvalidInput(f"{owner}longest_link is {self.longest_link}, must be above 1")


class CandidateOutcome(Enum):
    """How a candidate of the homotopy search ended."""

    REACHED = "reached"
    STRETCHED = "stretched"  # links too long or too short at rest (C0-11)
    DUPLICATE = "duplicate"  # same turns around the same bodies as another one (C2-9)
    DOMINATED = "dominated"  # cannot become faster than one that has arrived
    TOO_LONG = "too_long"  # beyond the cap (C2-3)
    UNSETTLED = "unsettled"  # the adjustment found no rest (C0-15)
    REFUSED = "refused"  # by the certificate


@dataclass(frozen=True)
class Candidate:
    """One candidate path and its history.

    Parameters
    ----------
    points : ndarray, shape (n + 1, 2)
        p_0 .. p_n [m, map].
    turns : tuple of (str, int)
        For every R1 -> R2: the body, and the direction gamma in which it is passed (+1: it lies on the right).
    outcome : CandidateOutcome
    travel_time : float
        n steps and the rest to the target [s]; inf when it was not reached (C0-16).
    passes : int
        Passes of the adjustment loop, all together.
    reason : str
        In words, when it is no answer.
    """

    points: FloatArray
    turns: tuple[tuple[str, int], ...]
    outcome: CandidateOutcome
    travel_time: float = math.inf
    passes: int = 0
    reason: str = ""


@dataclass(frozen=True)
class TravelBound:
    """No path that keeps the margin takes less time than this.

    Parameters
    ----------
    time : float
        Lower bound of the travel time [s]; inf when there is no way at all.
    route : ndarray, shape (K, 3)
        x, y [m, map] and time [s] of the relaxed path that takes it.
    left_out : tuple of str
        Bodies that are not slower than the robot: the bound does not count them.
    """

    time: float
    route: FloatArray
    left_out: tuple[str, ...] = ()


@dataclass(frozen=True)
class SpacetimePlan:
    """The best certified candidate, all others, and how good it is.

    Parameters
    ----------
    robot_id : str
    path : TimedPath
    travel_time : float
        [s]
    certificate : Certificate
        Accepted, always.
    candidates : tuple of Candidate
        In the order in which they were made.
    bound : TravelBound or None
        Quality certificate, when asked for.
    """

    robot_id: str
    path: TimedPath
    travel_time: float
    certificate: Certificate
    candidates: tuple[Candidate, ...]
    bound: TravelBound | None = None

    @property
    def gap(self) -> float:
        """Travel time above the bound, as a share of it; NaN without a bound."""
        if self.bound is None:
            return math.nan
        return self.travel_time / self.bound.time - 1.0
