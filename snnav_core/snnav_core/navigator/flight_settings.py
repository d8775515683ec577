"""Settings of the flight navigator, and the lengths that follow from them for one robot."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from snnav_core.checks import check_not_negative, check_positive, check_robot, check_whole
from snnav_core.errors import InvalidInput
from snnav_core.planning.adjustment import AdjustmentSettings
from snnav_core.planning.certificate import CertificateSettings
from snnav_core.planning.roadmap import RoadmapSettings
from snnav_core.types import FloatArray, RobotSpec

__all__ = ["FlightDistances", "FlightSettings"]


@dataclass(frozen=True, slots=True)
class FlightSettings:
    """How the navigator of flying robots plans; SI units.

    Parameters
    ----------
    sampling_interval : float
        delta: time between two decisions [s].
    safety_margin : float
        d_s: from a robot's centre to the boundary of the free region and to other robots' spheres [m].
    time_window : int
        T: how long a path is proved safe, in sampling intervals.
    boundary_speed : float
        V_max: nothing that may move is faster [m/s].
    tracking_tolerance : float
        How far a robot may be off its path [m].
    turn_radius_factor : float
        Radius of the initial torus as a multiple of R_min (C0-9).
    switch_gain : float
        A new path replaces the last one only when it is shorter by this share (C4-7).
    search_interval : int
        A new roadmap is made every so many steps, and at once when the last path fails (C4-7).
    searches : int
        So many robots at most look for new ways in one step; the others hover or fly on until it is their turn.
    blocked_steps : int
        A robot without a path for so many steps goes first (C4-11).
    retreat_steps : int
        Where several were without a path for so many steps, the last in order goes aside.
    arrival_distance : float or None
        Distance to the target that counts as arrived [m]; None for the length of a link.
    roadmap : RoadmapSettings
    adjustment : AdjustmentSettings
    seed : int
        Of the samples: the same seed, the same paths.

    Raises
    ------
    InvalidInput
        If a number is out of its range.
    """

    sampling_interval: float
    safety_margin: float
    time_window: int = 6
    boundary_speed: float = 0.0
    tracking_tolerance: float = 0.01
    turn_radius_factor: float = 1.1
    switch_gain: float = 0.05
    search_interval: int = 10
    searches: int = 2
    blocked_steps: int = 5
    retreat_steps: int = 10
    arrival_distance: float | None = None
    roadmap: RoadmapSettings = field(default_factory=RoadmapSettings)
    adjustment: AdjustmentSettings = field(default_factory=AdjustmentSettings)
    seed: int = 0

    def __post_init__(self) -> None:
        check_positive(self, ("sampling_interval", "safety_margin"), "flight: ")
        check_not_negative(self, ("boundary_speed", "tracking_tolerance", "switch_gain"), "flight: ")
        check_whole(
            self,
            ("time_window", "search_interval", "searches", "blocked_steps", "retreat_steps"),
            1,
            "flight: ",
        )
        if not self.turn_radius_factor >= 1.0:
            raise InvalidInput(f"flight: turn_radius_factor is {self.turn_radius_factor}, must be at least 1")


class FlightDistances:
    """Lengths that follow from the settings for one robot.

    Raises
    ------
    InvalidInput
        If the robot is not faster than what moves, or the margin is below its radius or its turning radius (Ch. 4,
        definition of the safety margin).
    """

    def __init__(self, robot: RobotSpec, settings: FlightSettings) -> None:
        check_robot(robot, settings.boundary_speed, settings.safety_margin)
        if settings.safety_margin < robot.min_turn_radius:
            raise InvalidInput(
                f"safety_margin {settings.safety_margin} m is below the turning radius {robot.min_turn_radius:.3f} m "
                f"of robot {robot.id}: give a larger margin, or a slower robot"
            )
        self.settings = settings
        self.certificate = CertificateSettings(
            safety_margin=settings.safety_margin,
            boundary_speed=settings.boundary_speed,
            sampling_interval=settings.sampling_interval,
            time_window=settings.time_window,
            tracking_tolerance=settings.tracking_tolerance,
        )
        stride = robot.speed * settings.sampling_interval
        self.parts = max(1, math.ceil(stride / min(0.5 * robot.min_turn_radius, 0.15) - 1e-9))
        self.link = stride / self.parts
        self.step = settings.sampling_interval / self.parts
        self.torus = settings.turn_radius_factor * robot.min_turn_radius
        self.arrival = settings.arrival_distance or self.link
        self.window = settings.time_window * settings.sampling_interval
        self.growth_per_metre = settings.boundary_speed / robot.speed

    def planned(self, reserve: float) -> float:
        """Distance that points are planned for [m]: d_s, tolerance, reserve, and the dip of a chord (C0-7)."""
        distance = self.settings.safety_margin + self.settings.tracking_tolerance + reserve
        return math.hypot(distance, 0.5 * self.link)

    def growth(self, since: float) -> FloatArray:
        """How far what may move can have come nearer at p_1 .. p_(T parts) [m], `since` [s] after the area."""
        times = since + self.step * np.arange(1, self.settings.time_window * self.parts + 1)
        return np.asarray(self.settings.boundary_speed * times)
