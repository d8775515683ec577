"""What flying robots may count on of each other: also of one that is not heard of, or was told otherwise later."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from snnav_core.flight_types import FlyerState
from snnav_core.navigator.flight_settings import FlightSettings
from snnav_core.navigator.plans import shortened
from snnav_core.navigator.prediction import up_to
from snnav_core.planning.flight_separation import OtherFlyer, least_gap
from snnav_core.types import PlannedPath, RobotSpec, Stop, TimedPath

__all__ = ["settle", "silent"]

_TINY = 1e-6  # [m], [s]


def silent(
    robot: RobotSpec, last: FlyerState | None, plan: PlannedPath | None, time: float
) -> list[OtherFlyer]:
    """Where a robot may be of which nothing is heard: on its way, or hovering anywhere on the rest of that.

    Parameters
    ----------
    robot : RobotSpec
    last : FlyerState or None
        The last that is known of it; None for nothing.
    plan : PlannedPath or None
        What it was told last; None for a stop.
    time : float
        [s]
    """
    if last is None:
        return []
    paths = []
    places = last.position[None]
    if plan is not None:
        path, until = plan.path, plan.certificate.valid_until
        begin = max(last.stamp, path.start_time)
        if time < until:
            paths.append(path)
        if begin < until:
            places = path.positions_at(np.append(np.arange(begin, until, path.step), until))
    paths += [TimedPath(time, 1.0, place[None]) for place in places]
    return [OtherFlyer(robot.id, robot.radius, one) for one in paths]


def settle(
    time: float,
    decisions: dict[str, PlannedPath | Stop],
    ways: dict[str, list[OtherFlyer]],
    states: Mapping[str, FlyerState],
    settings: FlightSettings,
) -> list[str]:
    """Shorten windows, in place, that do not agree with what others were told after them, until all agree.

    Who was decided first counted on the last paths of the others. Where one of these was stopped since, or has a
    shorter window, at the end of which it hovers, the path of the first is safe only for so many intervals.

    Parameters
    ----------
    time : float
        [s]
    decisions : dict
    ways : dict
        Where each robot is for all that was decided; renewed with the decisions.
    states : mapping
    settings : FlightSettings

    Returns
    -------
    list of str
        Robots whose decision changed: a shorter window, or a stop where no interval is left.
    """
    changed: list[str] = []
    agree = False
    while not agree:
        agree = True
        for name, decision in decisions.items():
            if not isinstance(decision, PlannedPath):
                continue
            others = [one for other, those in ways.items() if other != name for one in those]
            until, fault = _until(decision, others, settings)
            if not fault:
                continue
            shorter = decisions[name] = shortened(decision, until, settings.sampling_interval, fault)
            path = TimedPath(time, settings.sampling_interval, states[name].position[None])
            if isinstance(shorter, PlannedPath):
                path = up_to(shorter.path, shorter.certificate.valid_until)
            ways[name] = [OtherFlyer(name, ways[name][0].radius, path)]
            changed.append(name)
            agree = False
    return changed


def _until(plan: PlannedPath, others: Sequence[OtherFlyer], settings: FlightSettings) -> tuple[float, str]:
    """Until when a path keeps the margin to all others within its window [s], and what fails then."""
    start, interval, margin = plan.path.start_time, settings.sampling_interval, settings.safety_margin
    until, fault = plan.certificate.valid_until, ""
    for other in others:
        present = least_gap(plan.path, other.path, start, start)[0] - other.radius
        limit = min(margin, present)
        for count in range(math.ceil((until - start) / interval - 1e-3)):
            begin = start + count * interval
            gap, when = least_gap(plan.path, other.path, begin, begin + interval)
            if gap - other.radius < limit - _TINY:
                until = begin
                fault = (
                    f"comes within {gap - other.radius:.3f} m of robot {other.id} after {when - start:.2f} s, "
                    f"margin {limit:.3f} m"
                )
                break
    return until, fault
