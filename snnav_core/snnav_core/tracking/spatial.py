"""Sliding-mode tracking of a path in space by a flying robot (Ch. 4, Section "Path tracking controller")."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from snnav_core.errors import InvalidInput
from snnav_core.flight_types import FlightCommand, FlyerState
from snnav_core.motion.flyer import limit_turn
from snnav_core.tracking.follower import PathFollower, check_law
from snnav_core.tracking.spatial_track import SpatialPoint, SpatialTrack, chain_in_space, spline_in_space
from snnav_core.types import FloatArray, RobotSpec, TimedPath

__all__ = ["SpatialTracker", "SpatialTrackerSettings"]

_HOVER = FlightCommand(0.0, np.zeros(3))
_ON_PATH = 1e-3  # [m]; nearer than this the plane through robot and tangent means nothing (C4-14)
_APPROACH = 0.4  # share of the speed spent on closing in, lambda_d * sigma_d / v
_FASTEST_CONVERGENCE = 0.5  # largest lambda times control period


@dataclass(frozen=True, slots=True)
class SpatialTrackerSettings:
    """Tunable constants of the two-surface law.

    Parameters
    ----------
    law : {"practical", "printed"}
        "printed": the sum of two sign functions, as corrected (C4-13 to C4-18), on the polygonal chain. "practical":
        the same two surfaces with a boundary layer and curvature feed-forward on a spline through the points.
    distance_rate : float or None
        lambda_d [1/s]. By default 2 for the printed law (the thesis' table), else U_M, at most 0.5 / control period.
    distance_saturation : float or None
        sigma_d [m]. By default 1 m for the printed law (C4-17), else 0.4 v / lambda_d.
    angle_rate, angle_saturation : float
        lambda_a [1/s] and sigma_a [rad], printed law only.
    distance_weight, angle_weight : float
        w_d and w_a, printed law only.
    boundary_layer : float or None
        phi [m/s], practical law only. By default 2 v U_M control_period.

    Raises
    ------
    InvalidInput
        If the law is unknown or a constant is not a positive number.
    """

    law: Literal["practical", "printed"] = "practical"
    distance_rate: float | None = None
    distance_saturation: float | None = None
    angle_rate: float = 3.0
    angle_saturation: float = 1.0
    distance_weight: float = 1.0
    angle_weight: float = 1.0
    boundary_layer: float | None = None

    def __post_init__(self) -> None:
        numbers = ("distance_rate", "distance_saturation", "angle_rate", "angle_saturation")
        check_law(self, self.law, (*numbers, "distance_weight", "angle_weight", "boundary_layer"))


class SpatialTracker(PathFollower[SpatialTrack]):
    """Turns a timed path and the state of a flying robot into speed and turn.

    Parameters
    ----------
    robot : RobotSpec
    settings : SpatialTrackerSettings
    control_period : float
        Time for which a command holds [s]; 0.05 s or less (C4-19).

    Raises
    ------
    InvalidInput
        If the period is not positive.

    Notes
    -----
    Deviations: e_a is measured with the unit vector of the direction (C4-13); nothing is done about e_a within a
    millimetre of the path (C4-14); de_a/dt is left out of its surface (C4-15); de_d/dt = -v i . nu_d (C4-16); u is
    projected and limited (C4-18). The robot hovers without a path, at its end, and after its validity; it leaves a
    hover along the path.
    """

    def __init__(self, robot: RobotSpec, settings: SpatialTrackerSettings, control_period: float) -> None:
        super().__init__(robot, control_period, everywhere=settings.law == "printed")
        self.settings = settings
        speed, turn = robot.speed, robot.max_turn_rate
        printed = settings.law == "printed"
        rate = 2.0 if printed else min(turn, _FASTEST_CONVERGENCE / control_period)
        self.distance_rate = settings.distance_rate or rate
        width = 1.0 if printed else _APPROACH * speed / self.distance_rate
        self.distance_saturation = settings.distance_saturation or width
        self.boundary_layer = settings.boundary_layer or 2.0 * speed * turn * control_period

    def reset(self) -> None:
        """Forget the path; the command is to hover until a new one comes."""
        super().reset()
        self._distance = 0.0
        self._angle = 0.0

    @property
    def distance_error(self) -> float:
        """e_d: distance of the robot from the path at the last command [m]."""
        return self._distance

    @property
    def angle_error(self) -> float:
        """e_a: angle between direction and the plane of robot and tangent at the last command [rad]."""
        return self._angle

    def set_path(
        self,
        path: TimedPath | None,
        initial_direction: FloatArray | None = None,
        valid_until: float | None = None,
    ) -> None:
        """Follow a new path from the next command on; None means hover.

        Parameters
        ----------
        path : TimedPath or None
            With points of shape (N, 3).
        initial_direction : ndarray, shape (3,), optional
            Unit vector of travel at the first point, if the path starts at the robot and it flies; the spline then
            leaves along it.
        valid_until : float, optional
            Time after which the path must not be followed any more [s].

        Raises
        ------
        InvalidInput
            If the path lies in the plane, or a value is not finite; the tracker is then left without a path.
        """
        self.reset()
        if path is None:
            return
        name = f"tracker of {self.robot.id!r}"
        if path.points.shape[1] != 3:
            raise InvalidInput(f"{name}: path points have shape {path.points.shape}, expected (N, 3)")
        if initial_direction is not None and not np.isfinite(initial_direction).all():
            raise InvalidInput(
                f"{name}: initial_direction is {initial_direction}, must be finite or left out"
            )
        if valid_until is not None and not math.isfinite(valid_until):
            raise InvalidInput(f"{name}: valid_until is {valid_until}, must be finite or left out")
        practical = self.settings.law == "practical"
        track = spline_in_space(path.points, initial_direction) if practical else chain_in_space(path.points)
        self._follow(path, track, valid_until)

    def command(self, state: FlyerState, time: float) -> FlightCommand:
        """Return the command for the coming control period.

        Parameters
        ----------
        state : FlyerState
            Present state of the robot [map].
        time : float
            Present time [s].

        Raises
        ------
        InvalidInput
            If the time is not finite. The caller must let the robot hover.
        """
        if not math.isfinite(time):
            raise InvalidInput(f"tracker of {self.robot.id!r}: time is {time}; let the robot hover")
        if self._finished or self._track is None or self._lapsed(time):
            return _HOVER
        nearest = self._locate(self._track, state.position, time)
        share = self._share_left(self._track, nearest.distance)
        if share == 0.0:
            return _HOVER
        leaves = nearest.tangent if state.speed == 0.0 else None
        direction = state.direction if leaves is None else leaves
        self._measure(nearest, state.position, direction)
        if self.settings.law == "printed":
            turn = self._printed_law(nearest, state.position, direction)
        else:
            turn = self._practical_law(self._track, nearest, state.position, direction)
        turn = share * limit_turn(turn, direction, self.robot.max_turn_rate)
        return FlightCommand(share * self.robot.speed, turn, leaves)

    def _locate(self, track: SpatialTrack, position: FloatArray, time: float) -> SpatialPoint:
        """Find the closest point."""
        here = tuple(position.tolist())
        nearest = track.closest(position, *self._search_range(track, here, time))
        self._last_position = here
        self._progress = nearest.distance
        return nearest

    def _measure(self, nearest: SpatialPoint, position: FloatArray, direction: FloatArray) -> None:
        """Work out e_d and e_a."""
        gap = nearest.position - position
        self._distance = float(np.linalg.norm(gap))
        normal = np.cross(nearest.tangent, gap)
        width = float(np.linalg.norm(normal))
        on_path = self._distance < _ON_PATH or width < _ON_PATH * self._distance
        self._angle = 0.0 if on_path else -math.asin(min(max(float(direction @ normal) / width, -1.0), 1.0))

    def _printed_law(self, nearest: SpatialPoint, position: FloatArray, direction: FloatArray) -> FloatArray:
        """Return U_M times the direction of w_d u_d nu_d + w_a u_a nu_a across the direction of travel."""
        gap = nearest.position - position
        settings = self.settings
        if self._distance < _ON_PATH:
            return np.zeros(3)
        towards = gap / self._distance
        distance_rate = -self.robot.speed * float(direction @ towards)
        closing = np.sign(distance_rate + self._saturate(self._distance))
        wanted = settings.distance_weight * closing * towards
        if self._angle != 0.0:
            normal = np.cross(nearest.tangent, towards)
            bound = settings.angle_saturation
            surface = settings.angle_rate * min(max(self._angle, -bound), bound)
            wanted = wanted + settings.angle_weight * np.sign(surface) * normal / np.linalg.norm(normal)
        across: FloatArray = wanted - (wanted @ direction) * direction
        size = float(np.linalg.norm(across))
        return np.zeros(3) if size < _ON_PATH else across * (self.robot.max_turn_rate / size)

    def _practical_law(
        self, track: SpatialTrack, nearest: SpatialPoint, position: FloatArray, direction: FloatArray
    ) -> FloatArray:
        """Return v kappa + U_M sat(S / phi), S = lambda_d sat(e) - v (i across the tangent).

        S holds both surfaces: along nu_d it is de_d/dt + X(e_d), along nu_a it is v sin(e_a).
        """
        speed, turn = self.robot.speed, self.robot.max_turn_rate
        along = float(direction @ nearest.tangent)
        if along <= 0.0:  # flies back: turn round towards the tangent, to any side where it is opposite
            aside = nearest.tangent - along * direction
            if float(np.linalg.norm(aside)) < _ON_PATH:
                aside = np.cross(direction, np.eye(3)[int(np.argmin(np.abs(direction)))])
            return turn * aside / np.linalg.norm(aside)
        gap = nearest.position - position
        across = gap - (gap @ nearest.tangent) * nearest.tangent
        size = float(np.linalg.norm(across))
        closing = across * (self._saturate(size) / size) if size > 0.0 else across
        surface = (closing - speed * (direction - along * nearest.tangent)) / self.boundary_layer
        size = float(np.linalg.norm(surface))
        ahead = nearest.distance + 0.5 * speed * self.control_period
        correction: FloatArray = surface / max(size, 1.0)
        return speed * track.curvature_at(ahead) + turn * correction

    def _saturate(self, error: float) -> float:
        """Return X(e_d) [m/s]: lambda_d e_d, limited to lambda_d sigma_d; e_d is never negative."""
        return self.distance_rate * min(error, self.distance_saturation)
