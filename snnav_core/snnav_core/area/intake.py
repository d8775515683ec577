"""Which scans are taken for measurements at all: inputs lie, a wrong stamp above all."""

from __future__ import annotations

import numpy as np

from snnav_core.area.settings import PlanarSensor
from snnav_core.errors import InvalidInput
from snnav_core.sensing.scan import PlanarScan

__all__ = ["TIME_TOLERANCE", "check_clock", "is_repeated", "same_ranges"]

TIME_TOLERANCE = 1e-6
"""Times no farther apart are the same time [s]."""

_TELLING_RETURNS = 100  # measured distances that noise never repeats all at once


def is_repeated(
    sensor: PlanarSensor,
    scan: PlanarScan,
    before: PlanarScan | None,
    now: float | None,
    clock_tolerance: float,
) -> bool:
    """Return whether a scan only repeats the last one of its sensor, ranges and stamp.

    Parameters
    ----------
    sensor : PlanarSensor
    scan : PlanarScan
        As it came.
    before : PlanarScan or None
        What was taken last from this sensor.
    now : float or None
        Time at its arrival [s]; None where there is no clock to compare with.
    clock_tolerance : float
        How far ahead of `now` its stamp may be [s].

    Raises
    ------
    InvalidInput
        If the stamp is ahead of the clock or older than the last one, if a scan of the same stamp has other ranges, or
        if a device that never repeats itself does.
    """
    check_clock(f"scan of {sensor.id}", scan.stamp, now, clock_tolerance)
    if before is None:
        return False
    if scan.stamp < before.stamp - TIME_TOLERANCE:
        raise InvalidInput(
            f"scan of {sensor.id} stamped {scan.stamp:.3f} s is older than its last ({before.stamp:.3f} s): ignored"
        )
    same = same_ranges(before, scan)
    if scan.stamp <= before.stamp + TIME_TOLERANCE:
        if not same:
            raise InvalidInput(
                f"scan of {sensor.id} stamped {scan.stamp:.3f} s differs from its last, which has the same stamp: "
                "ignored; each measurement needs its own stamp"
            )
        return True
    if sensor.settings.never_repeats and (repeated := _repeated_returns(before, scan)) >= _TELLING_RETURNS:
        raise InvalidInput(
            f"scan of {sensor.id} stamped {scan.stamp:.3f} s is frozen: all ranges are those of {before.stamp:.3f} s, "
            f"{repeated} returns; restart the device, or set never_repeats to false for one without noise"
        )
    return False


def _repeated_returns(first: PlanarScan, second: PlanarScan) -> int:
    """Number of beams that returned in both scans, if all of them measured the same; else 0.

    Beams that one of the scans lost tell nothing: a frozen device may lose beams on the way all the same.
    """
    if first.ranges.shape != second.ranges.shape:
        return 0
    both = np.ones(first.ranges.shape, dtype=np.bool_)
    for scan in (first, second):
        both &= (scan.ranges > 0.0) & (scan.ranges <= scan.range_max)
    return int(both.sum()) if np.array_equal(first.ranges[both], second.ranges[both]) else 0


def check_clock(what: str, stamp: float, now: float | None, tolerance: float) -> None:
    """Make sure that a stamp [s] is not ahead of the clock `now` [s], if there is one, by more than a tolerance [s].

    Raises
    ------
    InvalidInput
        With what bears the stamp: in the future it would pass for new.
    """
    if now is not None and not stamp <= now + tolerance + TIME_TOLERANCE:
        raise InvalidInput(
            f"{what} stamped {stamp:.3f} s is {stamp - now:.3f} s ahead of the clock ({now:.3f} s): ignored; "
            "synchronise the clocks or raise clock_tolerance"
        )


def same_ranges(first: PlanarScan, second: PlanarScan) -> bool:
    """Return whether two scans measured exactly the same."""
    return (
        first.angle_min == second.angle_min
        and first.angle_increment == second.angle_increment
        and first.range_min == second.range_min
        and first.range_max == second.range_max
        and np.array_equal(first.ranges, second.ranges, equal_nan=True)
    )
