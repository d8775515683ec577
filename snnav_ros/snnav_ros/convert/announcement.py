"""Robots that join and leave, as a diagnostic_msgs/DiagnosticStatus on `robots`."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from snnav_core.errors import InvalidInput
from snnav_core.types import RobotSpec
from snnav_ros.convert.stamps import nanoseconds, seconds
from snnav_ros.convert.status import status_to_message, values_from_message
from snnav_ros.parameter_ranges import RANGES
from snnav_sim.scene_read import is_name

__all__ = ["Announcement", "announcement_from_message", "announcement_to_message"]

_JOINS, _LEAVES = "joins", "leaves"
_NUMBERS = ("radius", "speed", "max_turn_rate")
_LONGEST_QUOTE = 60


@dataclass(frozen=True)
class Announcement:
    """A robot is in the workspace from a time on, or no longer.

    Parameters
    ----------
    id : str
    stamp : int
        [ns]
    spec : RobotSpec or None
        What has to be known of it; None when it leaves.
    """

    id: str
    stamp: int
    spec: RobotSpec | None


def announcement_to_message(announcement: Announcement) -> Any:
    """Return the DiagnosticStatus of an announcement; reading it gives the same numbers."""
    spec = announcement.spec
    values = {"stamp": repr(seconds(announcement.stamp))}
    if spec is not None:
        values |= {name: repr(float(getattr(spec, name))) for name in _NUMBERS}
        values["can_turn_in_place"] = "true" if spec.can_turn_in_place else "false"
    text = _LEAVES if spec is None else _JOINS
    return status_to_message(announcement.id, announcement.id, text, values)


def announcement_from_message(message: Any, topic: str = "robots") -> Announcement:
    """Return what a robot says of itself.

    Raises
    ------
    InvalidInput
        If its name is none, a key is missing, unreadable or there twice, or a number lies outside of what a parameter
        of that name may be.
    """
    name = str(message.name)
    shown = name if len(name) <= _LONGEST_QUOTE else name[:_LONGEST_QUOTE] + "..."
    if not is_name(name):
        raise InvalidInput(
            f"{topic}: {shown!r} is no name for a robot; use letters, digits and single underscores, a letter first, "
            "and no reserved name"
        )
    values = values_from_message(message, f"{topic}: robot {name}")
    if message.message not in (_JOINS, _LEAVES):
        raise InvalidInput(
            f"{topic}: robot {name}: message is {message.message[:20]!r}, write joins or leaves"
        )
    try:
        stamp = nanoseconds(_number("stamp", values["stamp"], 0.0, 1e10))
        if message.message == _LEAVES:
            return Announcement(name, stamp, None)
        numbers = {key: _number(key, values[key], *RANGES[key]) for key in _NUMBERS}
        turns = values["can_turn_in_place"]
        if turns not in ("true", "false"):
            raise ValueError(f"can_turn_in_place is {turns[:20]!r}, write true or false")
    except KeyError as error:
        raise InvalidInput(f"{topic}: robot {name}: key {error} is missing; send it") from None
    except ValueError as error:
        raise InvalidInput(f"{topic}: robot {name}: {error}") from None
    return Announcement(name, stamp, RobotSpec(name, can_turn_in_place=turns == "true", **numbers))


def _number(key: str, text: str, least: float, most: float) -> float:
    try:
        value = float(text)
    except ValueError:
        raise ValueError(f"{key} is {text[:20]!r}, write a number") from None
    if not (math.isfinite(value) and least <= value <= most):
        raise ValueError(f"{key} is {value:g}, give {least:g} to {most:g}")
    return value
