"""From a way to a plan: adjusted, timed and certified."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from snnav_core.navigator.attempt import Attempt, margin_profiles
from snnav_core.navigator.search import Route, next_corner, shortest_way
from snnav_core.planning.adjustment import resample
from snnav_core.types import FloatArray, PathSource, PlannedPath, Stop, StopReason, TimedPath

__all__ = [
    "BY_ROBOT",
    "NONE_CERTIFIED",
    "best_profile",
    "better",
    "profiles",
    "shortened",
    "turn_and_leg",
    "turn_first",
    "turn_on",
]

BY_ROBOT = " of robot "
"""In the reasons of certificates that another robot is to blame for."""

NONE_CERTIFIED = "candidates, none certified"
"""In the reasons of robots all of whose ways were refused."""

_WORTH = 1.1  # times the shortest way: a longer path is worth a turn in place before
_ALIGNED = 0.02  # a turn by less than this [rad] brings nothing
_NEARLY = 0.15  # [rad]; a robot that has turned need not turn by less than this again


def profiles(attempt: Attempt) -> list[FloatArray]:
    """Margins to plan for from where the robot stands, the preferred ones first, see `margin_profiles`."""
    present = attempt.context.clearance(attempt.pose.position)
    return margin_profiles(
        attempt.distances, attempt.settings, attempt.robot, attempt.planning_distance, present
    )


def best_profile(attempt: Attempt, polyline: FloatArray, rotation: int, source: PathSource) -> PlannedPath:
    """The candidate adjusted with the first margin profile that holds for the whole window, else the best of all."""
    points = resample(polyline, attempt.distances.link)
    best: PlannedPath | None = None
    plan: PlannedPath | None = None
    adjustment = attempt.settings.adjustment
    # In a crowd most ways that do not rest soon are blocked: nearly all others rest within the smaller number.
    passes = adjustment.warm_passes if attempt.crowd.is_large else adjustment.cold_passes
    for margins in profiles(attempt):
        plan = attempt.adjusted(points, rotation, margins, passes, source)
        best = better(best, plan)
        if attempt.is_full(plan):
            return plan
        if BY_ROBOT in plan.certificate.reason:
            break  # other distances to the boundary do not help
    assert plan is not None
    return best or plan


def turn_and_leg(attempt: Attempt, route: Route, last: PlannedPath | None = None) -> PlannedPath | None:
    """For ways too tight for the turning radius: turn on the spot towards the next bend, then straight to it.

    Noise moves the bend while the robot turns: one whose last path was a turn, now done, drives off along its heading
    when that is nearly right. Else it could turn after the bend for ever.
    """
    corner = next_corner(attempt.context, route, attempt.pose)
    if corner is None:
        return None
    start = attempt.pose.position
    heading = math.atan2(corner[1] - start[1], corner[0] - start[0])
    if _is_off(attempt, heading):
        leg = _own_leg(attempt, corner) if _has_turned(attempt, last) else None
        plan = leg or _turn(attempt, heading)
    else:
        plan = attempt.along(np.vstack((start, corner)), PathSource.STRAIGHT_LEG)
    return plan if plan.certificate.accepted else None


def _has_turned(attempt: Attempt, last: PlannedPath | None) -> bool:
    return last is not None and last.path.turn_to is not None and not _is_off(attempt, last.path.turn_to)


def _own_leg(attempt: Attempt, corner: FloatArray) -> PlannedPath | None:
    """Straight ahead as the robot heads, within the window, towards a bend (2,) [m, map] nearly there; else None."""
    start, heading = attempt.pose.position, attempt.pose.heading
    ahead = np.array([math.cos(heading), math.sin(heading)])
    length = float((corner - start) @ ahead)
    if length < math.cos(_NEARLY) * float(np.linalg.norm(corner - start)):
        return None
    length = min(length, attempt.crowd.own_reach)  # beyond that it would miss the bend by too much
    plan = attempt.along(np.vstack((start, start + length * ahead)), PathSource.STRAIGHT_LEG)
    return plan if plan.certificate.accepted and attempt.is_lasting(plan) else None


def turn_on(attempt: Attempt, last: PlannedPath | None) -> PlannedPath | None:
    """A turn in place that was begun, to its end: where two ways are as good, the robot must not turn to and fro."""
    if last is None or last.path.turn_to is None or not _is_off(attempt, last.path.turn_to):
        return None
    plan = _turn(attempt, last.path.turn_to)
    return plan if plan.certificate.accepted else None


def turn_first(
    attempt: Attempt, last: PlannedPath | None, plan: PlannedPath, route: Route
) -> PlannedPath | None:
    """A turn in place of a robot that stands, where driving off along its heading makes the way much longer.

    On its circles a robot that faces away drives up to three quarters of a turn, and around what is beside it. Among
    others, and where something may come nearer, it drives off: while it stands and turns it is in their way.
    """
    stands, alone = last is None or last.path.turn_to is not None, not attempt.others
    if not alone or attempt.settings.boundary_speed > 0.0 or not stands or plan.path.turn_to is not None:
        return None
    way = shortest_way(attempt.context, route, attempt.pose)
    if way is None or plan.path.length <= _WORTH * float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum()):
        return None
    turn = turn_on(attempt, last) or turn_and_leg(attempt, route)
    return turn if turn is not None and turn.path.turn_to is not None and attempt.is_whole(turn) else None


def _is_off(attempt: Attempt, heading: float) -> bool:
    return abs(math.remainder(heading - attempt.pose.heading, 2.0 * math.pi)) >= _ALIGNED


def _turn(attempt: Attempt, heading: float) -> PlannedPath:
    points = np.repeat(attempt.pose.position[None], attempt.distances.window_points + 1, axis=0)
    path = TimedPath(attempt.time, attempt.distances.step, points, turn_to=heading)
    return attempt.planned(path, PathSource.TURN_IN_PLACE)


def better(best: PlannedPath | None, plan: PlannedPath | None) -> PlannedPath | None:
    """The accepted plan with the longer window; None while none is accepted."""
    if plan is None or not plan.certificate.accepted:
        return best
    if best is None or plan.certificate.valid_until > best.certificate.valid_until + 1e-6:
        return plan
    return best


def shortened(plan: PlannedPath, fails: float, interval: float, fault: str) -> PlannedPath | Stop:
    """A path with the whole intervals of its window that are left before it fails [s]; a stop without any."""
    whole = math.floor((fails - plan.path.start_time) / interval + 1e-6)
    if plan.path.start_time + whole * interval >= plan.certificate.valid_until:
        whole -= 1  # it fails within what is rounded off: still shorter each time, or nobody would ever agree
    if whole < 1:
        message = f"robot {plan.robot_id} waits: {fault}"
        return Stop(plan.robot_id, StopReason.BLOCKED_BY_ROBOT, message)
    valid_until = plan.path.start_time + whole * interval
    return replace(plan, certificate=replace(plan.certificate, valid_until=valid_until))
