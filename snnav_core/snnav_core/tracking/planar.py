"""Sliding-mode tracking of a path by a unicycle (Ch. 3, Section "Computer simulations")."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from snnav_core.errors import InvalidInput
from snnav_core.motion.unicycle import clip_turn_rate
from snnav_core.tracking.follower import PathFollower, check_law
from snnav_core.tracking.spline import Track, TrackPoint, chain_track, spline_track
from snnav_core.types import Pose2D, RobotSpec, TimedPath, VelocityCommand, wrap_angle

__all__ = ["PlanarTracker", "TrackerSettings"]

_STOP = VelocityCommand(0.0, 0.0)
_TURN_TOLERANCE = 1e-9  # [rad]
_APPROACH = 0.4  # share of the speed spent on closing in, lambda * sigma / v
_FASTEST_CONVERGENCE = 0.5  # largest lambda times control period


@dataclass(frozen=True, slots=True)
class TrackerSettings:
    """Tunable constants of the tracking law.

    Parameters
    ----------
    law : {"practical", "printed"}
        "printed": u = u_M sgn(de/dt + X(e)) on the polygonal chain. "practical": the same sliding surface with a
        boundary layer, curvature feed-forward and a spline through the points.
    convergence_rate : float or None
        lambda [1/s]. By default u_M, but at most 0.5 / control period.
    saturation : float or None
        sigma [m]: farther off, the robot approaches at the constant rate lambda * sigma. By default 0.4 v / lambda.
    boundary_layer : float or None
        phi [m/s], practical law only. By default 2 v u_M control_period.

    Raises
    ------
    InvalidInput
        If the law is unknown or a constant is not a positive number.
    """

    law: Literal["practical", "printed"] = "practical"
    convergence_rate: float | None = None
    saturation: float | None = None
    boundary_layer: float | None = None

    def __post_init__(self) -> None:
        check_law(self, self.law, ("convergence_rate", "saturation", "boundary_layer"))


class PlanarTracker(PathFollower[Track]):
    """Turns a timed path and the robot's pose into speed and turn rate.

    Parameters
    ----------
    robot : RobotSpec
    settings : TrackerSettings
    control_period : float
        Time for which a command holds [s]; 0.05 s or less is recommended (C3-31).

    Raises
    ------
    InvalidInput
        If the period is not positive, or the constants would make the robot circle for ever: lambda * sigma must
        not exceed v / 2 and lambda * tan(asin(lambda * sigma / v)) must stay below u_M (C3-29).

    Notes
    -----
    Deviations from the printed law: C3-28 (e by the direction of the path, turn back when it lies behind), C3-30
    (boundary layer, curvature feed-forward, no finite difference), C3-32 (spline, local search). The robot stops
    without a path, at its end, and after its validity.
    """

    def __init__(self, robot: RobotSpec, settings: TrackerSettings, control_period: float) -> None:
        super().__init__(robot, control_period, everywhere=settings.law == "printed")
        self.settings = settings
        speed, u_max = robot.speed, robot.max_turn_rate
        self.convergence_rate = settings.convergence_rate or min(u_max, _FASTEST_CONVERGENCE / control_period)
        self.saturation = settings.saturation or _APPROACH * speed / self.convergence_rate
        self.boundary_layer = settings.boundary_layer or 2.0 * speed * u_max * control_period
        _check_capture(robot, self.convergence_rate, self.saturation)

    def reset(self) -> None:
        """Forget the path; the command is to stop until a new one comes."""
        super().reset()
        self._cross_track_error = 0.0

    @property
    def cross_track_error(self) -> float:
        """Distance of the path from the robot at the last command [m], positive when the path is on the left."""
        return self._cross_track_error

    def set_path(
        self, path: TimedPath | None, initial_heading: float | None = None, valid_until: float | None = None
    ) -> None:
        """Follow a new path from the next command on; None means stop.

        Parameters
        ----------
        path : TimedPath or None
        initial_heading : float, optional
            Heading of the robot at the first point [rad, map], if the path starts at the robot. The spline then
            leaves along it, so that successive paths join without a jump of the command.
        valid_until : float, optional
            Time after which the path must not be followed any more [s].

        Raises
        ------
        InvalidInput
            If the heading or the time is not finite; the tracker is then left without a path.
        """
        self.reset()
        for name, value in (("initial_heading", initial_heading), ("valid_until", valid_until)):
            if value is not None and not math.isfinite(value):
                raise InvalidInput(
                    f"tracker of {self.robot.id!r}: {name} is {value}, must be finite or left out"
                )
        if path is None:
            return
        track = None
        if path.turn_to is None:
            points = path.points[:, :2]
            practical = self.settings.law == "practical"
            track = spline_track(points, initial_heading) if practical else chain_track(points)
        self._follow(path, track, valid_until)
        self._finished = path.turn_to is None and track is None

    def command(self, pose: Pose2D, time: float) -> VelocityCommand:
        """Return the command for the coming control period.

        Parameters
        ----------
        pose : Pose2D
            Present pose of the robot [map].
        time : float
            Present time [s].

        Raises
        ------
        InvalidInput
            If the pose or the time is not finite. The caller must stop the robot.
        """
        if not all(math.isfinite(value) for value in (pose.x, pose.y, pose.heading, time)):
            raise InvalidInput(
                f"tracker of {self.robot.id!r}: pose {pose} at time {time} must be finite; stop the robot"
            )
        if self._path is None or self._lapsed(time):
            return _STOP
        if self._path.turn_to is not None:
            return self._turn(wrap_angle(self._path.turn_to - pose.heading))
        if self._finished or self._track is None:
            return _STOP
        nearest = self._locate(self._track, pose, time)
        share = self._share_left(self._track, nearest.distance)
        if share == 0.0:
            return _STOP
        if self.settings.law == "printed":
            turn_rate = self._printed_law(nearest, pose)
        else:
            turn_rate = self._practical_law(self._track, nearest, pose)
        turn_rate = clip_turn_rate(turn_rate, self.robot.max_turn_rate)
        return VelocityCommand(share * self.robot.speed, share * turn_rate)

    def _turn(self, error: float) -> VelocityCommand:
        """Turn on the spot by the error [rad], never past it."""
        self._finished = abs(error) <= _TURN_TOLERANCE
        if self._finished:
            return _STOP
        return VelocityCommand(0.0, clip_turn_rate(error / self.control_period, self.robot.max_turn_rate))

    def _locate(self, track: Track, pose: Pose2D, time: float) -> TrackPoint:
        """Find the closest point."""
        nearest = track.closest(pose.x, pose.y, *self._search_range(track, (pose.x, pose.y), time))
        left_x, left_y = -math.sin(nearest.heading), math.cos(nearest.heading)
        self._last_position = (pose.x, pose.y)
        self._progress = nearest.distance
        self._cross_track_error = (nearest.x - pose.x) * left_x + (nearest.y - pose.y) * left_y
        return nearest

    def _practical_law(self, track: Track, nearest: TrackPoint, pose: Pose2D) -> float:
        """Return u = kappa v + u_M sat((de/dt + X(e)) / phi), with de/dt = -v sin(heading error)."""
        speed, u_max = self.robot.speed, self.robot.max_turn_rate
        heading_error = wrap_angle(pose.heading - nearest.heading)
        if abs(heading_error) > 0.5 * math.pi:
            return math.copysign(u_max, -heading_error)
        ahead = nearest.distance + 0.5 * speed * self.control_period
        feed_forward = track.curvature_at(ahead) * speed
        surface = -speed * math.sin(heading_error) + self._saturate(self._cross_track_error)
        return feed_forward + u_max * min(max(surface / self.boundary_layer, -1.0), 1.0)

    def _printed_law(self, nearest: TrackPoint, pose: Pose2D) -> float:
        """Return u = u_M sgn(de/dt + X(e)) with e > 0 when the closest point lies left of the robot."""
        speed = self.robot.speed
        ahead_x, ahead_y = math.cos(pose.heading), math.sin(pose.heading)
        to_x, to_y = nearest.x - pose.x, nearest.y - pose.y
        distance = math.hypot(to_x, to_y)
        if distance > 0.0:
            side = math.copysign(1.0, ahead_x * to_y - ahead_y * to_x)
            error = side * distance
            error_rate = -side * speed * (ahead_x * to_x + ahead_y * to_y) / distance
        else:
            error = 0.0
            error_rate = -speed * math.sin(pose.heading - nearest.heading)
        surface = error_rate + self._saturate(error)
        return 0.0 if surface == 0.0 else math.copysign(self.robot.max_turn_rate, surface)

    def _saturate(self, error: float) -> float:
        """Return X(e) [m/s]: lambda e, limited to lambda sigma."""
        return self.convergence_rate * min(max(error, -self.saturation), self.saturation)


def _check_capture(robot: RobotSpec, convergence_rate: float, saturation: float) -> None:
    approach = convergence_rate * saturation / robot.speed
    if approach > 0.5 or convergence_rate * math.tan(math.asin(approach)) >= robot.max_turn_rate:
        raise InvalidInput(
            f"tracker of {robot.id!r}: convergence_rate {convergence_rate:.3g} 1/s and saturation {saturation:.3g} m "
            f"are too large for speed {robot.speed} m/s and max_turn_rate {robot.max_turn_rate} rad/s; "
            "lambda sigma <= v/2 and lambda tan(asin(lambda sigma/v)) < u_M must hold"
        )
