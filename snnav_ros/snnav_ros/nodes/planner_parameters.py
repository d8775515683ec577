"""The parameters of the planner node."""

from __future__ import annotations

from dataclasses import dataclass

from snnav_ros.convert import MAP_FRAME

__all__ = ["PlannerParameters"]


@dataclass(frozen=True)
class PlannerParameters:
    """Parameters of the node besides those of the navigator and of the robots.

    Parameters
    ----------
    max_area_age : float or None
        All robots are stopped when the unoccupied area is older, also when it comes so late [s]; two sampling
        intervals when left out.
    clock_tolerance : float
        How far stamps of the area and of odometry may lie ahead of the planner's clock [s]; what lies farther ahead is
        not used. Not in lockstep, where time waits.
    odometry_frames : tuple of str
        Frames of odometry that coincide with the map; `{robot}` stands for the id of the robot.
    accept_robots : bool
        Whether robots may join by announcing themselves on `robots`.
    planners : tuple of str
        Names of all planner nodes of the workspace in the order in which they decide, this one among them; empty when
        there is only this one.
    serves : tuple of str
        Ids of the robots that this planner decides for, also of some that join later; all when empty.
    sharing_deadline : float or None
        Of several planners: the first has to be through so long after the stamp of an area, the second twice as long,
        and so on; one that is later issues nothing [s]. The sampling interval divided by their number and one when
        left out.
    """

    max_area_age: float | None = None
    clock_tolerance: float = 0.05
    odometry_frames: tuple[str, ...] = (MAP_FRAME,)
    accept_robots: bool = True
    planners: tuple[str, ...] = ()
    serves: tuple[str, ...] = ()
    sharing_deadline: float | None = None
