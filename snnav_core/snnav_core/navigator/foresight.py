"""On, wait or make room: what is likely to come nearer after a short window decides (beyond the thesis).

Whatever the robot does is certified for the window; this only chooses.
"""

from __future__ import annotations

import math

import numpy as np

from snnav_core.navigator.attempt import Attempt
from snnav_core.navigator.context import Disks
from snnav_core.navigator.evasion import towards
from snnav_core.navigator.forecast import Forecast
from snnav_core.types import FloatArray, PlannedPath, Stop, StopReason

__all__ = ["weigh"]

_NO_RISK = 1e-4  # [m^2]: less than that, see `Forecast.risk`, counts as none
_NARROW = 5e-4  # [m^2] that standing costs where the margin may be lost within the window, ...
_SHORT = 1e-3  # ... and going where it may be
_TURNING = 0.9  # a turn that was begun leads away: it is worth so much of standing still
_GRID = 0.3  # [m] between places that are looked at
_REFUGES = 4
_APART = 0.6  # [m] between refuges
_DEEP = 2.0  # more room than so many times the demanded distance makes a refuge no better
_CLEARLY = 0.8  # another way out of the way is taken when its risk is at most this share of the last one's


def weigh(
    attempt: Attempt,
    forecast: Forecast,
    decision: PlannedPath | Stop,
    kept: PlannedPath | None,
    disks: Disks,
    hurried: bool,
) -> tuple[PlannedPath | Stop, bool]:
    """Follow the path to the target, wait or make room, whichever lets the robot keep most room.

    Parameters
    ----------
    attempt : Attempt
    forecast : Forecast
    decision : PlannedPath or Stop
        The best certified path to the target, or why there is none.
    kept : PlannedPath or None
        The way out of the way that the robot is on, as far as it still holds.
    disks : Disks
        Of standing robots.
    hurried : bool
        Whether to go on to the target whatever may come.

    Returns
    -------
    decision
    evading : bool
        Whether it is a path out of the way.
    """
    plan = decision if isinstance(decision, PlannedPath) else None
    risk = math.inf if plan is None else _risk_of_plan(attempt, forecast, plan)
    if plan is not None and (hurried or risk <= _NO_RISK):
        return plan, False
    standing = _risk_of_standing(attempt, forecast)
    if standing > _NO_RISK:
        away, left = _away(attempt, forecast, kept, disks)
        if away is not None and left < min(risk, standing):
            return away, True
    if plan is None or risk <= standing:
        return decision, False
    message = f"robot {attempt.robot.id} waits: something comes nearer along its way"
    return Stop(attempt.robot.id, StopReason.NO_PATH, message), False


def _away(
    attempt: Attempt, forecast: Forecast, kept: PlannedPath | None, disks: Disks
) -> tuple[PlannedPath | None, float]:
    """The last way out of the way and its risk, or a new one with clearly less."""
    if kept is not None and kept.path.turn_to is None and kept.path.length < attempt.distances.stride:
        kept = None  # it is there
    risk = math.inf if kept is None else _risk_of_plan(attempt, forecast, kept)
    if risk > _NO_RISK:
        found = _evade(attempt, forecast, disks)
        if found is not None and found[1] < _CLEARLY * risk:
            return found
    return kept, risk


def _risk_of_standing(attempt: Attempt, forecast: Forecast) -> float:
    """What standing still will cost [m^2], see `Forecast.risk`; something where the window is not safe."""
    demanded = float(attempt.distances.demanded()[-1])
    narrow = _NARROW if attempt.context.clearance(attempt.pose.position) < demanded else 0.0
    return (
        _risk_of(attempt, forecast, np.broadcast_to(attempt.pose.position, (len(forecast.times), 2))) + narrow
    )


def _risk_of_plan(attempt: Attempt, forecast: Forecast, plan: PlannedPath) -> float:
    """What a path and standing at its end will cost [m^2], see `Forecast.risk`."""
    risk = _risk_of(attempt, forecast, plan.path.positions_at(attempt.time + forecast.times)[:, :2])
    return risk if plan.path.turn_to is None else _TURNING * risk


def _evade(attempt: Attempt, forecast: Forecast, disks: Disks) -> tuple[PlannedPath, float] | None:
    """The certified path to a place where what advances leaves most room, and its risk; None without any.

    As `evasion.evade`, but where to is a guess from what has moved before (`Forecast`); the way there is certified.
    """
    best: tuple[PlannedPath, float] | None = None
    for refuge, straight in _refuges(attempt, forecast):
        plan = towards(attempt, refuge, disks)
        if plan is None:
            continue
        risk = straight if plan.path.turn_to is not None else _risk_of_plan(attempt, forecast, plan)
        if not attempt.is_whole(plan):
            risk += _SHORT
        if best is None or risk < best[1]:
            best = plan, risk
    return best


def _risk_of(attempt: Attempt, forecast: Forecast, way: FloatArray) -> float:
    return float(forecast.risk(way[None], attempt.distances.tightest)[0])


def _refuges(attempt: Attempt, forecast: Forecast) -> list[tuple[FloatArray, float]]:
    """Places around the robot, with the risk of turning and going there straight [m^2], the best first.

    The least risk first, then the most room to the end, then the shortest way.
    """
    robot, here = attempt.robot, attempt.pose.position
    reach = robot.speed * forecast.times[-1]
    ticks = np.arange(-reach, reach + 0.5 * _GRID, _GRID)
    offsets = np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(-1, 2)
    lengths = np.linalg.norm(offsets, axis=1)
    clearance = attempt.context.area.clearance(here + offsets)
    usable = (lengths <= reach) & (lengths > 0.5 * _GRID) & (clearance >= attempt.distances.tightest)
    if not usable.any():
        return []
    offsets, lengths = offsets[usable], lengths[usable]
    turn = np.arctan2(offsets[:, 1], offsets[:, 0]) - attempt.pose.heading
    wait = np.abs(np.remainder(turn + math.pi, 2.0 * math.pi) - math.pi) / robot.max_turn_rate
    driven = np.clip((forecast.times - wait[:, None]) * robot.speed, 0.0, lengths[:, None])
    ways = here + (driven / lengths[:, None])[:, :, None] * offsets[:, None, :]
    risk = forecast.risk(ways, attempt.distances.tightest)
    deep = np.minimum(forecast.room(ways)[:, -1], _DEEP * attempt.distances.demanded()[-1])
    found: list[tuple[FloatArray, float]] = []
    for index in np.lexsort((lengths, -np.round(deep, 1), np.round(risk, 4))):
        place = here + offsets[index]
        if all(np.linalg.norm(place - other) >= _APART for other, _ in found):
            found.append((place, float(risk[index])))
            if len(found) == _REFUGES:
                break
    return found
