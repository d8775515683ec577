"""The decision for one robot in one step: keep the last path, find a new one, turn, or say why not."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
import shapely

from snnav_core.errors import GoalBlocked, GoalUnreachable, PlanningError, StartBlocked
from snnav_core.navigator.attempt import Attempt
from snnav_core.navigator.evasion import closes, evade, may_stand
from snnav_core.navigator.foresight import weigh
from snnav_core.navigator.plans import (
    BY_ROBOT,
    NONE_CERTIFIED,
    best_profile,
    better,
    profiles,
    turn_and_leg,
    turn_first,
    turn_on,
)
from snnav_core.navigator.progress import Progress
from snnav_core.navigator.search import Route, find_route, route_candidates, shortest_way
from snnav_core.navigator.standing import names_in_the_way, standing
from snnav_core.planning.adjustment import resample
from snnav_core.types import FloatArray, PathSource, PlannedPath, Pose2D, Stop, StopReason

__all__ = ["RobotMemory", "plan_robot"]

_PATIENCE = 15  # decisions that a robot gets no nearer to its target, and for which it is less choosy then
_LONG = 1_000  # steps: a robot whose path ends soon, or that must not stay, does not wait for its turn
_PAUSE = 4  # in a crowd a path certified for a part of the window is followed so many steps between searches
_CANDIDATES = 3  # in a crowd at most so many are adjusted in a search: what bars one mostly bars the next
_CROWD_INTERVAL = 2  # in a crowd ways shorter than one that holds are sought so many times as seldom: few are
_RETRY, _CROWD_RETRY = 2, 3  # a fruitless search is repeated every so many steps while things change
_DETOUR = 1.3  # a path certified for a part of the window is left for one at most so much longer ...
_MOST = 0.7  # ... unless it holds for less than this share of the window

_REASONS: dict[type[PlanningError], StopReason] = {
    StartBlocked: StopReason.START_BLOCKED,
    GoalBlocked: StopReason.GOAL_BLOCKED,
    GoalUnreachable: StopReason.GOAL_UNREACHABLE,
}


@dataclass(frozen=True)
class RobotMemory:
    """What the navigator keeps of one robot from step to step.

    Parameters
    ----------
    goal : tuple of float
        Target as it was given [m, map].
    target : ndarray, shape (2,)
        Target that is planned for: the goal, or a point so near that it counts as arrived [m, map].
    plan : PlannedPath or None
        The last path.
    profile : int
        Margin profile that the last path came from.
    steps_since_search : int
    arrived : bool
    failure : tuple or None
        Situation and outcome of a fruitless search, so that it is not repeated while nothing changes.
    evading : bool
        The last path leads out of the way, not to the target.
    shortest : float
        Shortest path to the target up to now [m].
    stalled : int
        Decisions with a path to the target since one was shorter than ever before.
    hurry : int
        For so many decisions more the shortest certified path is taken, be its window short or something near it.
    followed : int
        Steps for which the last path has been followed without adjusting it again.
    waited : int
        Steps for which the robot has waited for its turn to seek a way.
    progress : Progress
        Whether it gets anywhere.
    """

    goal: tuple[float, float]
    target: FloatArray
    plan: PlannedPath | None = None
    profile: int = 0
    steps_since_search: int = 0
    arrived: bool = False
    failure: tuple[tuple[object, ...], Stop] | None = None
    evading: bool = False
    shortest: float = math.inf
    stalled: int = 0
    hurry: int = 0
    followed: int = 0
    waited: int = 0
    progress: Progress = field(default_factory=Progress.at_start)


def plan_robot(
    attempt: Attempt, memory: RobotMemory, area_changed: bool
) -> tuple[PlannedPath | Stop, RobotMemory]:
    """Decide for one robot that has a goal and is not there yet (Ch. 3, with the deviations of `GroundNavigator`).

    Parameters
    ----------
    attempt : Attempt
        Area, robot, pose, others; its target is replaced by the one that is planned for.
    memory : RobotMemory
        Of the same goal.
    area_changed : bool
        Whether the unoccupied area differs from the one of the last step.

    Returns
    -------
    decision, memory
    """
    robot, settings, position = attempt.robot, attempt.settings, attempt.pose.position
    progress = memory.progress.here(position)
    rest = None
    if progress.rest > 0:
        rest = progress.stop(robot, position, attempt.context.clearance(position), settings.safety_margin)
    decision, memory = _weighed(attempt, memory, area_changed, rest)
    progress = progress.after(decision, settings.sampling_interval, robot.speed, attempt.in_company)
    return decision, replace(memory, progress=progress)


def _weighed(
    attempt: Attempt, memory: RobotMemory, area_changed: bool, rest: Stop | None
) -> tuple[PlannedPath | Stop, RobotMemory]:
    """On to the target, unless the robot rests, or out of the way, or wait."""
    last, memory = memory, replace(memory, evading=False)
    decision: PlannedPath | Stop
    if rest is not None:
        decision = rest
    else:
        decision, memory = _to_target(
            attempt, memory if not last.evading else replace(memory, plan=None), area_changed
        )
    if isinstance(decision, PlannedPath):
        memory = _with_progress(memory, decision, attempt.distances.stride)
    away = (_kept(attempt, last) or turn_on(attempt, last.plan)) if last.evading else None
    if attempt.forecast is not None:
        disks = standing(attempt, parked=False)
        decision, evading = weigh(
            attempt, attempt.forecast, decision, away, disks, _hurries(attempt, memory, decision)
        )
        return decision, replace(memory, evading=evading)
    if isinstance(decision, PlannedPath) and (
        attempt.is_full(decision) or not closes(attempt, decision) or _hurries(attempt, memory, decision)
    ):
        return decision, memory
    if may_stand(attempt):
        if isinstance(decision, PlannedPath):
            message = f"robot {attempt.robot.id} waits: something comes nearer along its way"
            decision = Stop(attempt.robot.id, StopReason.NO_PATH, message)
        return decision, memory
    if away is None or not attempt.is_whole(away):
        away = better(away, evade(attempt, standing(attempt, parked=False)))
    if away is None or (isinstance(decision, PlannedPath) and better(decision, away) is decision):
        return decision, memory
    return away, replace(memory, evading=True)


def _hurries(attempt: Attempt, memory: RobotMemory, decision: PlannedPath | Stop) -> bool:
    """Whether to drive on whatever may come nearer.

    Not up to the end of a window, where no way out is left; and who turns in place stands in the way of what comes.
    """
    if memory.hurry == 0 or isinstance(decision, Stop) or decision.path.turn_to is not None:
        return False
    return attempt.is_lasting(decision)


def _with_progress(memory: RobotMemory, plan: PlannedPath, stride: float) -> RobotMemory:
    """Note whether the robot gets nearer to its target; one that does not for long becomes less choosy for a while.

    Else it could turn round before a narrow place again and again: a way back is always safe for longer.
    """
    hurry, length = max(memory.hurry - 1, 0), plan.path.length
    if plan.path.turn_to is None and length < memory.shortest - 0.5 * stride:
        return replace(memory, shortest=length, stalled=0, hurry=hurry)
    if memory.stalled + 1 < _PATIENCE:
        return replace(memory, stalled=memory.stalled + 1, hurry=hurry)
    shortest = length if plan.path.turn_to is None else math.inf
    return replace(memory, shortest=shortest, stalled=0, hurry=_PATIENCE)


def _to_target(
    attempt: Attempt, memory: RobotMemory, area_changed: bool
) -> tuple[PlannedPath | Stop, RobotMemory]:
    """The best certified path towards the target, or why there is none."""
    if memory.plan is not None:
        attempt = replace(attempt, planning_distance=memory.plan.planning_distance)
    best, memory = _onwards(attempt, memory)
    interval = attempt.settings.search_interval * (_CROWD_INTERVAL if attempt.crowd.is_large else 1)
    due = area_changed and memory.steps_since_search + 1 >= interval
    if best is not None and attempt.is_full(best) and not due:
        return best, replace(memory, steps_since_search=memory.steps_since_search + 1)
    if best is not None and _is_patient(attempt, best, memory):
        return best, replace(memory, steps_since_search=memory.steps_since_search + 1)
    situation = _situation(attempt)
    if best is None and memory.failure is not None:
        waited = memory.steps_since_search + 1
        retry = _CROWD_RETRY if attempt.crowd.is_large else _RETRY
        if memory.failure[0] == situation or waited < retry:
            return memory.failure[1], replace(memory, steps_since_search=waited)
    can_wait = attempt.is_lasting(best) if best is not None else may_stand(attempt)
    if not attempt.turns.take(attempt.robot.id, memory.waited if can_wait else _LONG):
        return best or _until_its_turn(attempt), replace(memory, waited=memory.waited + 1)
    memory = replace(memory, steps_since_search=0, failure=None, waited=0)
    found = _search(attempt, best, memory)
    if found.best is None and attempt.crowd.is_large:
        attempt.turns.pay()
    memory = replace(memory, target=found.target)
    decision = found.best
    if found.route is not None and attempt.robot.can_turn_in_place:
        if decision is None:
            decision = turn_on(attempt, memory.plan) or turn_and_leg(attempt, found.route, memory.plan)
        else:
            decision = turn_first(attempt, memory.plan, decision, found.route) or decision
    if decision is None:
        return found.stop, replace(memory, failure=(situation, found.stop))
    return decision, memory


def _is_patient(attempt: Attempt, best: PlannedPath, memory: RobotMemory) -> bool:
    """In a crowd: whether a path certified for a part of the window will do, for a better one was sought lately."""
    return attempt.crowd.is_large and attempt.is_lasting(best) and memory.steps_since_search < _PAUSE


@dataclass(frozen=True)
class _Search:
    """Result of a search: the best path so far, or why there is none, and where a turn in place should point."""

    best: PlannedPath | None
    stop: Stop
    route: Route | None
    target: FloatArray


def _situation(attempt: Attempt) -> tuple[object, ...]:
    others = tuple(other.path.points.tobytes() for other in attempt.others)
    return attempt.context.digest, attempt.pose, others


def _until_its_turn(attempt: Attempt) -> Stop:
    name = attempt.robot.id
    message = f"robot {name} waits: its way is sought when that of others has been, within six steps"
    return Stop(name, StopReason.NO_PATH, message)


def _onwards(attempt: Attempt, memory: RobotMemory) -> tuple[PlannedPath | None, RobotMemory]:
    """The last path: adjusted again, or as it is where that is certified for longer.

    In a crowd as it is for a few steps, while it is certified for the whole window; between searches while it lasts.
    """
    kept: PlannedPath | None = None
    as_it_is = attempt.crowd.is_large and memory.followed < attempt.settings.followed_steps
    if as_it_is:
        kept = _kept(attempt, memory)
        if kept is not None and attempt.is_full(kept):
            return kept, replace(memory, followed=memory.followed + 1, waited=0)
        if kept is not None and _is_patient(attempt, kept, memory):
            return kept, memory
    best, memory = _warm(attempt, replace(memory, followed=0))
    if best is None or not attempt.is_full(best):
        best = better(best, kept if as_it_is else _kept(attempt, memory))
    return best, memory


def _warm(attempt: Attempt, memory: RobotMemory) -> tuple[PlannedPath | None, RobotMemory]:
    """The last path, shifted to the robot and adjusted again; None when the certificate refuses it."""
    chain = _ahead(attempt, memory)
    if chain is None or float(np.linalg.norm(chain[-1] - memory.target)) > attempt.distances.stride:
        return None, memory
    attempt = replace(attempt, target=memory.target)
    points = resample(chain, attempt.distances.link)
    rotation = _side(chain, attempt.pose)
    best: PlannedPath | None = None
    margins = profiles(attempt)
    first = 0 if memory.steps_since_search == 0 else min(memory.profile, len(margins) - 1)
    for index in (first, *(index for index in range(len(margins)) if index != first)):
        passes = attempt.settings.adjustment.warm_passes
        plan = attempt.adjusted(points, rotation, margins[index], passes, PathSource.WARM_START)
        best = better(best, plan)
        if attempt.is_full(plan):
            return plan, replace(memory, profile=index)
    return best, memory


def _search(attempt: Attempt, best: PlannedPath | None, memory: RobotMemory) -> _Search:
    """Best of the warm start and of new candidates; else the typed reason why there is none."""
    robot, settings = attempt.robot, attempt.settings
    try:
        route = _route(attempt, np.array(memory.goal))
    except PlanningError as error:
        return _Search(best, _stop_for(error, attempt, np.array(memory.goal)), None, memory.target)
    attempt = replace(attempt, target=route.target, planning_distance=route.distance)
    rejected, by_robot = "no candidate leaves along the heading of the robot", False
    candidates = route_candidates(attempt.context, route, attempt.pose, attempt.distances, settings)
    most = min(_CANDIDATES, settings.max_adjusted) if attempt.crowd.is_large else settings.max_adjusted
    for candidate in candidates[:most]:
        long = best is not None and candidate.length > (1.0 - settings.switch_gain) * best.path.length
        if best is not None and attempt.is_full(best) and long:
            break
        plan = best_profile(attempt, candidate.polyline, candidate.rotation, candidate.source)
        if not plan.certificate.accepted:
            refusal = plan.certificate.reason
            if BY_ROBOT in refusal or not by_robot:  # a robot in the way is told before everything else
                rejected, by_robot = refusal, BY_ROBOT in refusal
        elif best is None or _replaces(attempt, plan, best, memory.hurry > 0):
            best = plan
            if attempt.is_full(plan) or memory.hurry > 0:
                break
    reason = StopReason.BLOCKED_BY_ROBOT if by_robot else StopReason.NO_PATH
    message = f"robot {robot.id}: {len(candidates)} {NONE_CERTIFIED}; one of them {rejected}"
    return _Search(best, Stop(robot.id, reason, message), route, route.target)


def _route(attempt: Attempt, goal: FloatArray) -> Route:
    """Around robots that will not move again; around others that stand only where they are in the way, in a crowd soon.

    So most robots of a step share the curves and the tangent graph of one reduced area.
    """
    parked, disks = standing(attempt, parked=True), standing(attempt, parked=False)
    arguments = (attempt.context, attempt.robot, attempt.pose, goal, attempt.distances, attempt.settings)
    route = find_route(*arguments, parked)
    here = attempt.pose.position
    near = attempt.crowd.own_reach + attempt.distances.stride if attempt.crowd.is_large else math.inf
    around = tuple(disk for disk in disks if disk in parked or math.dist(disk[:2], here) - disk[2] <= near)
    passing = np.array([disk for disk in around if disk not in parked])
    way = shortest_way(attempt.context, route, attempt.pose) if len(passing) else None
    if way is None:
        return route
    centres, radii = shapely.points(passing[:, :2]), passing[:, 2]
    if not shapely.dwithin(shapely.linestrings(way), centres, radii).any():
        return route
    try:
        return find_route(*arguments, around)
    except PlanningError:
        return route


def _replaces(attempt: Attempt, plan: PlannedPath, best: PlannedPath, hurried: bool) -> bool:
    """Whether a new path is worth leaving the last one: shorter, or safe for longer without a great detour."""
    if not hurried and attempt.is_full(plan) != attempt.is_full(best):
        left = best.certificate.valid_until - attempt.time
        window = attempt.settings.time_window * attempt.settings.sampling_interval
        patient = left > _MOST * window - 1e-6
        return attempt.is_full(plan) and (not patient or plan.path.length < _DETOUR * best.path.length)
    return plan.path.length < (1.0 - attempt.settings.switch_gain) * best.path.length


def _stop_for(error: PlanningError, attempt: Attempt, goal: FloatArray) -> Stop:
    """The typed reason; standing robots are named when it is them that block the way."""
    robot = attempt.robot
    if standing(attempt, parked=False) and not isinstance(error, StartBlocked):
        arguments = (attempt.context, robot, attempt.pose, goal, attempt.distances, attempt.settings)
        try:
            route = find_route(*arguments, ())
        except PlanningError as without:
            error = without
        else:
            names = names_in_the_way(attempt, route)
            message = f"robot {robot.id} waits: the way to its target is blocked by standing robots ({names})"
            return Stop(robot.id, StopReason.BLOCKED_BY_ROBOT, message)
    return Stop(robot.id, _REASONS.get(type(error), StopReason.NO_PATH), str(error))


def _kept(attempt: Attempt, memory: RobotMemory) -> PlannedPath | None:
    """The last path as it is, while it verifies for at least one sampling interval (C3-14)."""
    chain = _ahead(attempt, memory)
    if chain is None:
        return None
    plan = attempt.along(chain, PathSource.LAST_PATH)
    return plan if plan.certificate.accepted else None


def _ahead(attempt: Attempt, memory: RobotMemory) -> FloatArray | None:
    """The part of the last path that lies ahead, from the robot on (N, 2) [m, map]; None at its end or without any."""
    if memory.plan is None or memory.plan.path.turn_to is not None or len(memory.plan.path) < 2:
        return None
    points, position = np.asarray(memory.plan.path.points), attempt.pose.position
    begin, change = points[:-1], np.diff(points, axis=0)
    share = np.einsum("ij,ij->i", position - begin, change)
    share = np.clip(share / np.maximum(np.einsum("ij,ij->i", change, change), 1e-18), 0.0, 1.0)
    # The robot is near the front of its path: a later part that comes back past it is not meant.
    window = min(len(begin), 2 * attempt.distances.parts + 2)
    away = np.linalg.norm((begin + share[:, None] * change)[:window] - position, axis=1)
    ahead = points[int(np.argmin(away)) + 1 :]
    if float(np.linalg.norm(ahead[0] - position)) < 0.3 * attempt.distances.link:
        ahead = ahead[1:]
    return np.vstack((position, ahead)) if len(ahead) else None


def _side(points: FloatArray, pose: Pose2D) -> int:
    """Side of the heading on which a path starts: +1 left, -1 right."""
    direction = points[1] - points[0]
    across = math.cos(pose.heading) * direction[1] - math.sin(pose.heading) * direction[0]
    return 1 if across >= 0.0 else -1
