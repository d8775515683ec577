"""Times: nanoseconds in messages, seconds in the core.

Seconds are the float nearest to the nanoseconds. So every stamp gives the same float on every side, and going to
seconds and back loses nothing up to 2^23 s (97 days); beyond, floats are coarser than a nanosecond, and going from
seconds to nanoseconds and back loses nothing.
"""

from __future__ import annotations

import math
from typing import Any

from snnav_core.errors import InvalidInput
from snnav_ros.available import new_message

__all__ = ["nanoseconds", "nanoseconds_from_stamp", "seconds", "seconds_from_stamp", "stamp_message"]

_SECOND = 1_000_000_000


def seconds(stamp_ns: int) -> float:
    """Return the float nearest to a time in nanoseconds [s]."""
    return stamp_ns / _SECOND


def nanoseconds(time: float) -> int:
    """Return a time [s] rounded to whole nanoseconds, computed without rounding in between.

    Raises
    ------
    InvalidInput
        If the time is not finite.
    """
    if not math.isfinite(time):
        raise InvalidInput(f"time is {time} s, must be finite")
    numerator, denominator = time.as_integer_ratio()
    return (2 * numerator * _SECOND + denominator) // (2 * denominator)


def nanoseconds_from_stamp(stamp: Any) -> int:
    """Return the nanoseconds of a builtin_interfaces/Time."""
    return int(stamp.sec) * _SECOND + int(stamp.nanosec)


def seconds_from_stamp(stamp: Any) -> float:
    """Return the seconds of a builtin_interfaces/Time."""
    return seconds(nanoseconds_from_stamp(stamp))


def stamp_message(stamp_ns: int) -> Any:
    """Return builtin_interfaces/Time of a time [ns]."""
    sec, nanosec = divmod(stamp_ns, _SECOND)
    return new_message("builtin_interfaces/Time", sec=sec, nanosec=nanosec)
