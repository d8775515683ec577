"""Why a robot of the global navigator gets no path: typed, and in words."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from snnav_core.errors import GoalBlocked, GoalUnreachable, PlanningError, StartBlocked
from snnav_core.navigator.journey import Planner, Situation, set_out
from snnav_core.types import Stop, StopReason

__all__ = ["not_tracked", "stop_for"]

_NAMED = 5  # bodies in a message, at most
_REASONS: dict[type[PlanningError], StopReason] = {
    StartBlocked: StopReason.START_BLOCKED,
    GoalBlocked: StopReason.GOAL_BLOCKED,
    GoalUnreachable: StopReason.GOAL_UNREACHABLE,
}


def not_tracked(now: Situation) -> Stop | None:
    """A robot does not set out while it is not known how bodies move; None when it is."""
    most = now.settings.known_velocity
    unknown = [body.id for body in now.bodies if body.velocity_deviation > most]
    if not unknown:
        return None
    named = ", ".join(unknown[:_NAMED]) + (", ..." if len(unknown) > _NAMED else "")
    message = (
        f"robot {now.robot.id} waits: the velocity of {named} is not yet known to {most:g} m/s; "
        "it sets out when they were measured more often"
    )
    return Stop(now.robot.id, StopReason.NOT_TRACKED, message)


def stop_for(error: PlanningError, now: Situation, goal: tuple[float, float], planner: Planner) -> Stop:
    """The reason that an error stands for; other robots are named when it is them that are in the way."""
    name, reason = now.robot.id, _REASONS.get(type(error), StopReason.NO_PATH)
    if not now.others or reason is StopReason.START_BLOCKED:
        return Stop(name, reason, str(error))
    try:
        alone = set_out(replace(now, others=()), goal, planner, reserved=False)
    except PlanningError:
        return Stop(name, reason, str(error))
    target, empty = np.array(goal), replace(now, bodies=(), workspace=None)
    in_the_way = [
        other.id
        for other in now.others
        if not replace(empty, others=(other,)).whole(alone.path, target).accepted
    ]
    message = f"robot {name} waits: its way is blocked by {', '.join(in_the_way)}; {error}"
    return Stop(name, StopReason.BLOCKED_BY_ROBOT, message)
