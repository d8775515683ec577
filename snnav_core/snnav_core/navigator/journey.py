"""One robot on its way through space-time: a plan, made once, and what of it may be published now."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from snnav_core.errors import NoPathFound
from snnav_core.navigator.global_settings import GlobalSettings
from snnav_core.navigator.pace import offset, remainder, retimed
from snnav_core.navigator.prediction import up_to
from snnav_core.obstacles import MovingObstacle
from snnav_core.planning.spacetime_certificate import DEVIATIONS, certify_in_spacetime
from snnav_core.planning.spacetime_problem import OtherRobot, SpacetimePlan, SpacetimeProblem
from snnav_core.types import (
    TIME_TOLERANCE,
    Certificate,
    FloatArray,
    PathSource,
    PlannedPath,
    Pose2D,
    RobotSpec,
    TimedPath,
    wrap_angle,
)

__all__ = ["Adjuster", "Journey", "Planner", "Situation", "Step", "bent", "deviates", "go_on", "set_out"]

Planner = Callable[[SpacetimeProblem], SpacetimePlan]
"""Makes a plan or raises a `PlanningError`."""

Adjuster = Callable[[TimedPath, SpacetimeProblem], TimedPath | None]
"""Adjusts what is left of a path, if that can be done."""

_HAIR = 1e-3  # [m]
_RETIME = 0.5  # of the tracking tolerance: from here on a path is timed anew
_TRIES = 4  # to find out how long the turn before the start takes


@dataclass(frozen=True)
class Situation:
    """What one robot is in at one decision.

    Parameters
    ----------
    robot : RobotSpec
    pose : Pose2D
        Now [m, rad, map].
    time : float
        [s]
    bodies : tuple of MovingObstacle
        As measured.
    workspace : tuple of ndarray or None
        See `SpacetimeProblem`.
    others : tuple of OtherRobot
        All other robots that it has to heed, with the distance that is kept.
    settings : GlobalSettings
    """

    robot: RobotSpec
    pose: Pose2D
    time: float
    bodies: tuple[MovingObstacle, ...]
    workspace: tuple[FloatArray, ...] | None
    others: tuple[OtherRobot, ...]
    settings: GlobalSettings

    @property
    def window_end(self) -> float:
        """Until when a path that is published now may be followed at most [s]."""
        return self.time + self.settings.time_window * self.settings.interval

    def problem(
        self, start: Pose2D, start_time: float, target: FloatArray, reserved: bool = False
    ) -> SpacetimeProblem:
        """The problem from a start on, among bodies that are larger by what is not known of them within the window.

        With `reserved` also by what a path keeps in reserve when it is planned.
        """
        standing = self.settings.planning_reserve if reserved else 0.0
        moving = self.settings.moving_reserve if reserved else 0.0
        bodies = tuple(
            replace(body, radius=body.radius + self._doubt(body) + (moving if body.speed > 0.0 else standing))
            for body in self.bodies
        )
        others = tuple(replace(other, distance=other.distance + standing) for other in self.others)
        return SpacetimeProblem(self.robot, start, start_time, target, bodies, others, self.workspace)

    def at_once(self) -> Situation:
        """The same without `lead`: a robot that drives does not stop while a path is computed."""
        return replace(self, settings=replace(self.settings, lead=0))

    def _doubt(self, body: MovingObstacle) -> float:
        age = max(self.window_end - body.stamp, 0.0)
        # what stands is slower than its deviation says
        speed = (DEVIATIONS if body.speed > 0.0 else 1.0) * body.velocity_deviation
        return DEVIATIONS * body.position_deviation + age * min(speed, self.settings.body_speed + body.speed)

    def whole(self, path: TimedPath, target: FloatArray) -> Certificate:
        """Certificate of a path to its end."""
        x, y = path.points[0, :2].tolist()
        start = Pose2D(x, y, self.pose.heading)
        problem = self.problem(start, self.time, target)
        return certify_in_spacetime(path, problem, self.settings.spacetime)

    def window(self, path: TimedPath) -> Certificate:
        """Certificate of a path, or of standing, for the window alone; others are taken to stop at its end."""
        end = self.window_end
        others = tuple(replace(other, path=up_to(other.path, end)) for other in self.others)
        part = up_to(path, end)
        return replace(self, others=others).whole(part, np.asarray(part.points[-1, :2]))

    def lowered(self, path: TimedPath) -> Certificate:
        """Certificate for the window with no more margin than there is; the robot still touches nothing.

        Its `least_clearance` says how much that is.
        """
        verdict = self.window(path)
        if verdict.accepted:
            return verdict
        spacetime = self.settings.spacetime
        margin = verdict.least_clearance - spacetime.tracking_tolerance - _HAIR
        if not self.robot.radius <= margin < spacetime.safety_margin:
            return verdict
        settings = replace(self.settings, spacetime=replace(spacetime, safety_margin=margin))
        return replace(self, settings=settings).window(path)

    def standing(self, step: float, heading: float) -> TimedPath:
        """Stand for the window, and turn to a heading [rad, map] meanwhile."""
        count = self.settings.time_window * max(1, round(self.settings.interval / step)) + 1
        return TimedPath(self.time, step, np.repeat(self.pose.position[None], count, axis=0), turn_to=heading)

    def published(self, path: TimedPath, verdict: Certificate, source: PathSource) -> PlannedPath:
        """A path with the verdict on it, or on its window, to be followed for the window at most."""
        until = min(verdict.valid_until, self.window_end)
        certificate = replace(verdict, path_digest=path.digest(), valid_until=until)
        return PlannedPath(self.robot.id, path, certificate, source, self.settings.spacetime.safety_margin)


@dataclass(frozen=True)
class Journey:
    """A plan that a robot follows.

    Parameters
    ----------
    goal : tuple of float
        [m, map]
    plan : SpacetimePlan
        As it was made.
    path : TimedPath
        The same way as it is timed now.
    heading : float
        That the robot must have when the path starts [rad, map].
    bodies : mapping
        Id -> the body as the plan took it to move.
    """

    goal: tuple[float, float]
    plan: SpacetimePlan
    path: TimedPath
    heading: float
    bodies: Mapping[str, MovingObstacle]


@dataclass(frozen=True)
class Step:
    """How a journey goes on.

    Parameters
    ----------
    decision : PlannedPath or None
        None when the robot must not go on.
    journey : Journey
        Timed anew, if need be.
    holds : bool
        Whether the rest of the way is certified and not the window alone.
    reason : str
        What is wrong, in words.
    """

    decision: PlannedPath | None
    journey: Journey
    holds: bool
    reason: str = ""


def set_out(now: Situation, goal: tuple[float, float], planner: Planner, reserved: bool = True) -> Journey:
    """Plan a way from where the robot stands, with the time in it that the turn before takes (C2-11).

    Parameters
    ----------
    now : Situation
    goal : tuple of float
        [m, map]
    planner : callable
    reserved : bool
        Whether the path keeps something in reserve, see `Situation.problem`.

    Raises
    ------
    PlanningError
        If there is no way.
    """
    settings, target = now.settings, np.array(goal, dtype=np.float64)
    way = target - now.pose.position
    wait = _turn_intervals(now, math.atan2(way[1], way[0]))
    for _ in range(_TRIES):
        start_time = now.time + wait * settings.interval
        plan = planner(now.problem(now.pose, start_time, target, reserved))
        heading = _first_heading(plan.path, now.pose.heading)
        needed = _turn_intervals(now, heading)
        if needed <= wait:
            turns = abs(wrap_angle(heading - now.pose.heading)) > settings.heading_tolerance
            bodies = {body.id: body for body in now.bodies}
            return Journey(goal, plan, plan.path, heading if turns else now.pose.heading, bodies)
        wait = needed
    raise NoPathFound(
        f"robot {now.robot.id}: every plan starts in another direction, the turn before it takes too long"
    )


def _turn_intervals(now: Situation, heading: float) -> int:
    """Sampling intervals before a path can start in a direction [rad, map]."""
    settings, turn = now.settings, abs(wrap_angle(heading - now.pose.heading))
    if turn <= settings.heading_tolerance:
        return settings.lead
    return max(settings.lead, math.ceil(turn / (now.robot.max_turn_rate * settings.interval) - 1e-9))


def _first_heading(path: TimedPath, otherwise: float) -> float:
    if len(path) < 2:
        return otherwise
    way = path.points[1] - path.points[0]
    return math.atan2(way[1], way[0])


def go_on(now: Situation, journey: Journey) -> Step:
    """Say what of a journey may be published now: the rest of its path, checked against what is measured now."""
    if now.time < journey.path.start_time - TIME_TOLERANCE:
        return _before_start(now, journey)
    speed, tolerance = now.robot.speed, now.settings.spacetime.tracking_tolerance
    gap = offset(journey.path, speed, now.pose.position, now.time)
    if gap.across > tolerance:
        text = f"robot {now.robot.id} is {gap.across:.3f} m off its path, allowed {tolerance:.3f} m"
        return Step(None, journey, False, text)
    if gap.distance > _RETIME * tolerance:
        # constant speed along a curve between the points drifts away from their times
        journey = replace(journey, path=retimed(journey.path, speed, now.time, gap.ahead))
    rest = remainder(journey.path, speed, now.time)
    verdict = now.whole(rest, np.array(journey.goal))
    if verdict.accepted:
        return Step(now.published(rest, verdict, PathSource.SPACETIME), journey, True)
    part = now.window(rest)
    if not part.accepted:
        # where a body has come so near that the margin is lost either way, what keeps more of it
        stays = now.window(now.standing(rest.step, now.pose.heading))
        if part.least_clearance > stays.least_clearance + _HAIR:
            part = now.lowered(rest)
    decision = now.published(rest, part, PathSource.SPACETIME) if part.accepted else None
    return Step(decision, journey, False, f"path of robot {now.robot.id}: {verdict.reason}")


def bent(now: Situation, journey: Journey, readjust: Adjuster) -> Step | None:
    """A path that does not hold any more, adjusted to what is measured now, if the robot can follow it as it heads."""
    if now.time < journey.path.start_time - TIME_TOLERANCE:
        return None
    problem = now.problem(now.pose, now.time, np.array(journey.goal), reserved=True)
    path = readjust(journey.path, problem)
    if path is None:
        return None
    turn = wrap_angle(_first_heading(path, now.pose.heading) - now.pose.heading)
    if abs(turn) > now.settings.heading_tolerance:
        return None
    step = go_on(now, replace(journey, path=path))
    return step if step.holds else None


def _before_start(now: Situation, journey: Journey) -> Step:
    """Stand and turn until the path starts."""
    path, robot, settings = journey.path, now.robot, now.settings
    away = math.dist(path.points[0, :2], now.pose.position)
    if away > settings.spacetime.tracking_tolerance:
        return Step(None, journey, False, f"robot {robot.id} is {away:.3f} m away from the start of its path")
    turn = abs(wrap_angle(journey.heading - now.pose.heading))
    if turn > robot.max_turn_rate * (path.start_time - now.time) + settings.heading_tolerance:
        return Step(None, journey, False, f"robot {robot.id} cannot turn in time for its path")
    standing = now.standing(path.step, journey.heading)
    ahead = now.whole(path, np.array(journey.goal))
    verdict = now.lowered(standing)  # it would stand anyway
    if not verdict.accepted:
        return Step(None, journey, False, f"robot {robot.id} before its start: {verdict.reason}")
    decision = now.published(standing, verdict, PathSource.TURN_IN_PLACE)
    return Step(decision, journey, ahead.accepted, ahead.reason)


def deviates(now: Situation, journey: Journey) -> str:
    """Say which body moves otherwise than the plan took it to; empty when none does.

    Where a body is, and not how it moves, is told by the certificate of the path.
    """
    settings = now.settings
    present = {body.id: body for body in now.bodies}
    for name, before in journey.bodies.items():
        body = present.get(name)
        if body is None and before.speed > settings.velocity_tolerance:
            return f"body {name} does not move any more as it did"
    for body in now.bodies:
        earlier = journey.bodies.get(body.id)
        known = np.zeros(2) if earlier is None else earlier.velocity
        change = float(np.hypot(*(body.velocity - known)))
        if change > settings.velocity_tolerance + DEVIATIONS * body.velocity_deviation:
            return f"body {body.id} moves by {change:.3f} m/s otherwise than it did"
    return ""
