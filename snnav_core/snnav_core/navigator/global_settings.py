"""Settings of the global navigator."""

from __future__ import annotations

from dataclasses import dataclass, field

from snnav_core.checks import check_not_negative, check_positive, check_whole
from snnav_core.planning.spacetime_problem import SpacetimeSettings
from snnav_core.types import RobotSpec

__all__ = ["GlobalSettings"]


@dataclass(frozen=True, slots=True)
class GlobalSettings:
    """How the global navigator plans once and watches its paths; SI units.

    Parameters
    ----------
    spacetime : SpacetimeSettings
        Sampling interval, safety margin d_s from a robot's centre, tracking tolerance, gains.
    time_window : int
        A published path may be followed for so many sampling intervals; a planner that falls silent stops its robots.
    robot_distance : float or None
        What is kept from centre to centre of two robots [m]; None for the safety margin, as in the thesis. Never less
        than both radii together.
    planning_reserve, moving_reserve : float
        Paths are planned around bodies that stand, and around robots, that are larger by the first [m] than the
        certificate demands later, around bodies that move by the second: so far a body may be, or seem to reach, from
        where it was expected, or a robot from its pace, before there has to be another path. Scanners of 0.5 deg see
        the outline of a body change by up to 0.08 m while it passes at 10 m.
    velocity_tolerance : float
        A body that was measured to move otherwise than expected by more than this, beyond its deviation, is a reason to
        look for another path [m/s].
    known_velocity : float
        Robots do not set out before the velocity deviation of every body is at most this [m/s].
    body_speed : float
        No body is faster [m/s]: however little is known of it, it gets no farther within the window.
    heading_tolerance : float
        A robot that heads otherwise by more than this turns in place before it starts (C2-11) [rad].
    arrival_distance : float
        From the target [m].
    lead : int
        A robot that stands starts at least so many sampling intervals after the decision. 0 where computing takes no
        time. One that drives goes on to another path without a stop.
    retry : int
        Where there is no path, or no better one, it is sought again after so many sampling intervals.
    doubted_steps : int
        A path is followed for so many decisions while its window holds though the rest of it does not: beside a body
        that moves a sliver may be out of sight for an instant, and count as a body that stands.
    switch_gain : float
        A path that holds is left only for one that arrives earlier by this share of what is left (C3-26).
    bound : bool
        Whether plans carry a lower bound of their travel time.

    Raises
    ------
    InvalidInput
        If a number is outside its range.
    """

    spacetime: SpacetimeSettings = field(default_factory=SpacetimeSettings)
    time_window: int = 4
    robot_distance: float | None = None
    planning_reserve: float = 0.03
    moving_reserve: float = 0.1
    velocity_tolerance: float = 0.03
    known_velocity: float = 0.05
    body_speed: float = 2.0
    heading_tolerance: float = 0.1
    arrival_distance: float = 0.05
    lead: int = 0
    retry: int = 5
    doubted_steps: int = 2
    switch_gain: float = 0.05
    bound: bool = True

    def __post_init__(self) -> None:
        owner = "global navigator: "
        check_whole(self, ("time_window", "retry"), 1, owner)
        check_whole(self, ("lead", "doubted_steps"), 0, owner)
        at_least_zero = (
            "planning_reserve",
            "moving_reserve",
            "velocity_tolerance",
            "body_speed",
            "switch_gain",
        )
        check_not_negative(self, at_least_zero, owner)
        check_positive(self, ("known_velocity", "heading_tolerance", "arrival_distance"), owner)
        check_positive(self, ("robot_distance",), owner, optional=True)

    @property
    def interval(self) -> float:
        """Time from decision to decision [s]."""
        return self.spacetime.sampling_interval

    def distance_between(self, first: RobotSpec, second: RobotSpec) -> float:
        """What two robots keep from centre to centre [m]."""
        distance = self.spacetime.safety_margin if self.robot_distance is None else self.robot_distance
        return max(distance, first.radius + second.radius)
