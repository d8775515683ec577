"""Settings of the ground navigator, and the distances that follow from them for one robot."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from snnav_core.checks import check_not_negative, check_positive, check_robot, check_whole
from snnav_core.errors import InvalidInput
from snnav_core.planning.adjustment import AdjustmentSettings
from snnav_core.planning.certificate import PIECES_PER_LINK, CertificateSettings
from snnav_core.types import FloatArray, RobotSpec

__all__ = ["NavigatorSettings", "RobotDistances"]


@dataclass(frozen=True, slots=True)
class NavigatorSettings:
    """How the navigator plans; SI units.

    Parameters
    ----------
    sampling_interval : float
        delta: time between two decisions [s].
    safety_margin : float
        d_s: from a robot's centre to the boundary of the unoccupied area and to other robots' disks [m].
    time_window : int
        T: how long a path is proved safe, in sampling intervals.
    boundary_speed : float
        V_max: no boundary of the unoccupied area moves faster [m/s].
    tracking_tolerance : float or None
        How far a robot may be off its path [m]; the certificate demands it beyond the margin. None for 1 % of R_min, at
        least 3 mm: the practical tracking law stays within that.
    planning_reserve : float
        What the planner keeps beyond what the certificate demands [m].
    turn_radius_factor : float
        Planned radius as a multiple of R_min: a path at R_min leaves the tracker no authority (C0-9).
    circle_radius_factor : float
        Radius of the initial circles as a multiple of R_min (C3-16).
    simplification : float
        The reduced area for candidates may be simplified by this much, always to less free space [m].
    switch_gain : float
        A new path replaces the last one only when it is shorter by this share (C3-26).
    search_interval : int
        New candidates are sought every so many steps when the area changes, and at once when the last path fails.
    searches_per_step : int
        At most about so many robots seek new candidates in one step; the others go on with the path that they have, or
        wait, for at most six steps. All would at once in the first step.
    followed_steps : int
        In a crowd a last path that is certified for the whole window is followed for so many steps before it is
        adjusted again.
    crowd : int
        From so many other robots on it is a crowd.
    max_adjusted : int
        At most so many candidates are adjusted in one step, shortest first.
    arrival_distance : float or None
        Distance to the target that counts as arrived [m]; None for a quarter of L, at least 0.1 m, at most L.
    path_spacing : float or None
        Largest distance between path points [m]; None for min(L, R_min / 2, d_s / 2) (C0-10), and so small that the
        chord between two points on a circle of radius d_s dips by at most half the tracking tolerance.
    """

    sampling_interval: float
    safety_margin: float
    time_window: int = 4
    boundary_speed: float = 0.0
    tracking_tolerance: float | None = None
    planning_reserve: float = 0.002
    turn_radius_factor: float = 1.1
    circle_radius_factor: float = 1.05
    simplification: float = 0.02
    switch_gain: float = 0.05
    search_interval: int = 5
    searches_per_step: int = 15
    followed_steps: int = 2
    crowd: int = 20
    max_adjusted: int = 6
    arrival_distance: float | None = None
    path_spacing: float | None = None
    adjustment: AdjustmentSettings = field(default_factory=AdjustmentSettings)

    def __post_init__(self) -> None:
        check_positive(self, ("sampling_interval", "safety_margin"))
        check_positive(self, ("arrival_distance", "path_spacing"), optional=True)
        check_not_negative(self, ("boundary_speed", "planning_reserve", "simplification", "switch_gain"))
        check_not_negative(self, ("tracking_tolerance",), optional=True)
        whole = ("time_window", "search_interval", "searches_per_step", "crowd", "max_adjusted")
        check_whole(self, whole, 1)
        check_whole(self, ("followed_steps",), 0)
        for name in ("turn_radius_factor", "circle_radius_factor"):
            if not getattr(self, name) >= 1.0:
                raise InvalidInput(f"{name} is {getattr(self, name)}, must be >= 1")


class RobotDistances:
    """Lengths that follow from the settings for one robot.

    Raises
    ------
    InvalidInput
        If the robot is not faster than the boundary, or its disk is larger than the safety margin.
    """

    def __init__(self, robot: RobotSpec, settings: NavigatorSettings) -> None:
        check_robot(robot, settings.boundary_speed, settings.safety_margin)
        self._settings = settings
        derived = max(0.003, 0.01 * robot.min_turn_radius)
        self.tolerance = derived if settings.tracking_tolerance is None else settings.tracking_tolerance
        self.certificate = CertificateSettings(
            safety_margin=settings.safety_margin,
            boundary_speed=settings.boundary_speed,
            sampling_interval=settings.sampling_interval,
            time_window=settings.time_window,
            tracking_tolerance=self.tolerance,
        )
        self.stride = robot.speed * settings.sampling_interval
        shallow = math.sqrt(4.0 * settings.safety_margin * self.tolerance)
        widest = settings.path_spacing or min(
            0.5 * robot.min_turn_radius, 0.5 * settings.safety_margin, max(shallow, 0.02)
        )
        self.parts = max(1, math.ceil(self.stride / widest - 1e-9))
        self.link = self.stride / self.parts
        self.step = settings.sampling_interval / self.parts
        self.reserve = settings.planning_reserve + settings.boundary_speed * self.step / PIECES_PER_LINK
        self.turn_radius = settings.turn_radius_factor * robot.min_turn_radius
        self.circle_radius = settings.circle_radius_factor * robot.min_turn_radius
        self.arrival = settings.arrival_distance or min(self.stride, max(0.1, 0.25 * self.stride))
        self.window_points = settings.time_window * self.parts

    def demanded(self) -> FloatArray:
        """Planned distance of p_1 .. p_(T parts) to the boundary [m]: d_s + k step V_max, reserves and chord dips.

        The chord between two points at distance d from a corner dips to sqrt(d^2 - L^2 / 4) (C0-7).
        """
        settings = self._settings
        times = np.arange(1, self.window_points + 1) * self.step
        tolerance = self.tolerance + self.reserve
        distance = settings.safety_margin + times * settings.boundary_speed + tolerance
        return np.asarray(np.sqrt(distance**2 + 0.25 * self.link**2))

    @property
    def tightest(self) -> float:
        """Distance below which no path is accepted: ways to the target are sought from here on [m]."""
        return self._settings.safety_margin + self.tolerance

    @property
    def least(self) -> float:
        """Least distance that a path can be planned for [m]."""
        tolerance = self.tolerance + self.reserve
        return math.hypot(self._settings.safety_margin + tolerance, 0.5 * self.link)
