"""The unicycle with bounded turn rate (Ch. 3, robot model), integrated exactly."""

from __future__ import annotations

import math

import numpy as np

from snnav_core.errors import InvalidInput
from snnav_core.types import FloatArray, Pose2D, wrap_angle

__all__ = ["clip_turn_rate", "integrate_unicycle", "step_unicycle"]


def clip_turn_rate(turn_rate: float, max_turn_rate: float) -> float:
    """Return the turn rate [rad/s] limited to |u| <= max_turn_rate (Ch. 3, non-holonomic constraint).

    Raises
    ------
    InvalidInput
        If the turn rate is NaN or the limit is not a number >= 0.
    """
    if math.isnan(turn_rate) or not max_turn_rate >= 0.0:
        raise InvalidInput(f"turn rate {turn_rate} rad/s cannot be limited to {max_turn_rate} rad/s")
    return min(max(turn_rate, -max_turn_rate), max_turn_rate)


def integrate_unicycle(
    poses: FloatArray, speed: FloatArray | float, turn_rate: FloatArray | float, dt: float
) -> FloatArray:
    """Move unicycles along exact arcs for one period.

    Parameters
    ----------
    poses : ndarray, shape (..., 3)
        Position [m, map] and heading [rad, map].
    speed, turn_rate : ndarray or float, shape (...)
        Forward speed [m/s] and turn rate [rad/s], constant over the period.
    dt : float
        Period [s].

    Returns
    -------
    ndarray, shape (..., 3)
        Poses after the period; headings are not wrapped, so that turns can be counted.

    Notes
    -----
    With constant inputs the path is an arc; its chord has the length v dt sinc(u dt / 2) and the direction
    heading + u dt / 2. This form needs no case for u = 0.
    """
    poses = np.asarray(poses, dtype=np.float64)
    half_turn = 0.5 * np.asarray(turn_rate, dtype=np.float64) * dt
    chord = np.asarray(speed, dtype=np.float64) * dt * np.sinc(half_turn / np.pi)
    direction = poses[..., 2] + half_turn
    return np.stack(
        (
            poses[..., 0] + chord * np.cos(direction),
            poses[..., 1] + chord * np.sin(direction),
            poses[..., 2] + 2.0 * half_turn,
        ),
        axis=-1,
    )


def step_unicycle(pose: Pose2D, speed: float, turn_rate: float, dt: float) -> Pose2D:
    """Move one unicycle along an exact arc; the heading is wrapped to (-pi, pi].

    Parameters
    ----------
    pose : Pose2D
    speed, turn_rate : float
        Forward speed [m/s] and turn rate [rad/s], constant over the period.
    dt : float
        Period [s].

    Examples
    --------
    A quarter of a circle of radius 2 m:

    >>> pose = step_unicycle(Pose2D(0.0, 0.0, 0.0), speed=1.0, turn_rate=0.5, dt=math.pi)
    >>> round(pose.x, 9), round(pose.y, 9)
    (2.0, 2.0)
    """
    x, y, heading = integrate_unicycle(
        np.array((pose.x, pose.y, pose.heading)), speed, turn_rate, dt
    ).tolist()
    return Pose2D(x, y, wrap_angle(heading))
