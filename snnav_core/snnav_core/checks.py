"""Checks that settings share: every message names the setting, its value and what it must be."""

from __future__ import annotations

import math
from collections.abc import Iterable

from snnav_core.errors import InvalidInput
from snnav_core.types import RobotSpec

__all__ = ["check_not_negative", "check_positive", "check_robot", "check_whole"]


def check_positive(settings: object, names: Iterable[str], owner: str = "", optional: bool = False) -> None:
    """Check that attributes are positive, finite numbers.

    Parameters
    ----------
    settings : object
    names : iterable of str
        Of its attributes.
    owner : str
        What a message begins with, such as ``"flight: "``.
    optional : bool
        Whether None is allowed too.

    Raises
    ------
    InvalidInput
        At the first that is not.
    """
    for name in names:
        value = getattr(settings, name)
        if value is None and optional:
            continue
        if not (math.isfinite(value) and value > 0.0):
            left_out = " or left out" if optional else ""
            raise InvalidInput(f"{owner}{name} is {value}, must be a positive number{left_out}")


def check_not_negative(
    settings: object, names: Iterable[str], owner: str = "", optional: bool = False
) -> None:
    """Check that attributes are finite numbers of at least 0; parameters as of `check_positive`.

    Raises
    ------
    InvalidInput
        At the first that is not.
    """
    for name in names:
        value = getattr(settings, name)
        if value is None and optional:
            continue
        if not (math.isfinite(value) and value >= 0.0):
            left_out = " or left out" if optional else ""
            raise InvalidInput(f"{owner}{name} is {value}, must be a number >= 0{left_out}")


def check_whole(settings: object, names: Iterable[str], least: int, owner: str = "") -> None:
    """Check that attributes, whole numbers, are not below the least allowed; parameters as of `check_positive`.

    Raises
    ------
    InvalidInput
        At the first that is.
    """
    for name in names:
        value = getattr(settings, name)
        if value < least:
            raise InvalidInput(f"{owner}{name} is {value}, must be a whole number >= {least}")


def check_robot(robot: RobotSpec, boundary_speed: float, safety_margin: float) -> None:
    """Check that a robot can be guided: faster than whatever moves, and its body within the margin.

    Parameters
    ----------
    robot : RobotSpec
    boundary_speed : float
        V_max [m/s].
    safety_margin : float
        d_s [m].

    Raises
    ------
    InvalidInput
        If the robot is not faster than what moves, or larger than the safety margin.
    """
    if boundary_speed >= robot.speed:
        raise InvalidInput(
            f"boundary_speed {boundary_speed} m/s must be below the speed {robot.speed} m/s of robot {robot.id}: it "
            "could not get out of the way; lower boundary_speed to what really moves there, or use a faster robot"
        )
    if safety_margin < robot.radius:
        raise InvalidInput(
            f"safety_margin {safety_margin} m is below the radius {robot.radius} m of robot {robot.id}: give a margin "
            "of at least the radius"
        )
