"""Why a flying robot hovers, in words."""

from __future__ import annotations

import numpy as np

from snnav_core.navigator.flight_seek import can_be_reached
from snnav_core.navigator.flight_task import FlightTask
from snnav_core.planning.flight_separation import OtherFlyer
from snnav_core.types import Stop, StopReason

__all__ = ["explain", "without_search"]


def explain(task: FlightTask) -> Stop:
    """Return why there is no path, after one was sought."""
    stop = without_search(task) or _blocked(task)
    if stop is not None:
        return stop
    name, margin = task.robot.id, task.settings.safety_margin
    if not can_be_reached(task):
        return Stop(
            name,
            StopReason.GOAL_UNREACHABLE,
            f"no way to the target of robot {name} keeps {margin:.2f} m and what may move in the window, from cell to "
            f"cell of {task.area.grid.spacing:g} m",
        )
    reason = task.faults[-1] if task.faults else "no candidate"
    return Stop(name, StopReason.NO_PATH, f"no path of robot {name} was accepted: {reason}")


def without_search(task: FlightTask) -> Stop | None:
    """Return why no path has to be sought, if that is so."""
    name, margin = task.robot.id, task.settings.safety_margin
    present = float(task.area.clearance_at(task.state.position[None], task.now)[0])
    if present <= 0.0:
        where = np.round(task.state.position, 2).tolist()
        return Stop(
            name, StopReason.START_BLOCKED, f"robot {name} at {where} is where nothing is proved free"
        )
    at_goal = float(task.area.clearance_at(task.goal[None], task.growth)[0])
    if at_goal < margin:
        return Stop(
            name,
            StopReason.GOAL_BLOCKED,
            f"the target {np.round(task.goal, 2).tolist()} has a clearance of {at_goal:.2f} m over the window, "
            f"the margin is {margin:.2f} m",
        )
    for other in task.others:
        if len(other.path) == 1 and not other.leaves and _is_at_target(task, other):
            return Stop(name, StopReason.BLOCKED_BY_ROBOT, f"robot {name} waits for {other.id} at its target")
    return None


def _is_at_target(task: FlightTask, other: OtherFlyer) -> bool:
    """Whether another robot ends so near to the target that this one cannot arrive."""
    apart = task.settings.safety_margin + other.radius - task.distances.arrival
    return float(np.linalg.norm(other.path.points[-1] - task.goal)) < apart


def _blocked(task: FlightTask) -> Stop | None:
    """Other robots that stay at the target or were in the way, at most three."""
    named = " ".join(task.faults)
    found = []
    for other in task.others:
        if float(np.linalg.norm(other.path.points[-1] - task.goal)) < task.apart(other):
            found.append(f"{other.id} at its target")
        elif f"robot {other.id} " in named:
            found.append(other.id)
    if not found:
        return None
    name = task.robot.id
    return Stop(
        name, StopReason.BLOCKED_BY_ROBOT, f"robot {name} waits for {', '.join([*dict.fromkeys(found)][:3])}"
    )
