"""The global planner in space-time (Ch. 2): the shortest certified path among bodies in uniform motion."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from snnav_core.errors import GoalBlocked, NoPathFound, PlanningError, StartBlocked
from snnav_core.planning.homotopy_search import Found, search
from snnav_core.planning.prolonging import Chain
from snnav_core.planning.settling import fine_gains, settle, spacing, with_target
from snnav_core.planning.spacetime_certificate import certify_in_spacetime
from snnav_core.planning.spacetime_kernel import distance
from snnav_core.planning.spacetime_problem import (
    Candidate,
    CandidateOutcome,
    OtherRobot,
    SpacetimePlan,
    SpacetimeProblem,
    SpacetimeSettings,
)
from snnav_core.planning.spacetime_world import Layout, TurningReserve, lay_out
from snnav_core.types import Certificate, FloatArray, TimedPath

__all__ = ["plan_in_spacetime", "plan_in_turn"]

_SETTLING_PASSES = 3000  # C0-15
_SPARE = 40  # points that an earlier plan may grow by
_SAME = 0.2  # of the link length: candidates nowhere farther apart than this are the same path


def plan_in_spacetime(
    problem: SpacetimeProblem,
    settings: SpacetimeSettings,
    rng: np.random.Generator,
    previous: SpacetimePlan | None = None,
) -> SpacetimePlan:
    """Find the shortest collision-free path of one robot among static and uniformly moving bodies (Ch. 2).

    Parameters
    ----------
    problem : SpacetimeProblem
    settings : SpacetimeSettings
    rng : numpy.random.Generator
        For tie-breaks only: same seed, same candidates.
    previous : SpacetimePlan or None
        The rest of this plan is one more candidate.

    Returns
    -------
    SpacetimePlan
        The fastest candidate that `certify_in_spacetime` accepts.

    Raises
    ------
    StartBlocked
        If something is nearer to the robot than its own radius.
    GoalBlocked
        If something is nearer to the target than the safety margin at a time at which the robot may be there (C2-14).
    GoalUnreachable
        If bodies that stand still, or the border of the workspace, enclose the robot or the target.
    NoPathFound
        If no candidate reaches the target or none is accepted.

    Notes
    -----
    Best of the candidates that were tried; that there is no better one is not claimed (C2-13).
    """
    layout = lay_out(problem, settings, TurningReserve.CORNERS)
    _check_ends(problem, settings, layout)
    failure: NoPathFound | None = None
    for reserve in TurningReserve:
        other = lay_out(problem, settings, reserve)
        if failure is not None and (other.world.kept[:, 0] == layout.world.kept[:, 0]).all():
            continue
        layout = other
        arrivals = _Arrivals(problem, settings, layout)
        found = search(layout, settings, rng, arrivals.add)
        if previous is not None and (rest := _rest_of(previous, problem, layout)) is not None:
            arrivals.add(rest)
            found.append(rest)
        try:
            return _choose(found, arrivals, problem, layout)
        except NoPathFound as error:
            failure = failure or error
    assert failure is not None
    raise failure


def _check_ends(problem: SpacetimeProblem, settings: SpacetimeSettings, layout: Layout) -> None:
    """Say who blocks the start, or the target, where and when."""
    kept, margins, start = layout.world.kept, layout.margins, problem.start
    name = problem.robot.id
    for body, close in enumerate(kept[:, 1]):
        if close < min(problem.robot.radius, margins[body]):
            raise StartBlocked(
                f"robot {name} at ({start.x:.2f}, {start.y:.2f}) is {close:.2f} m from {layout.names[body]} at "
                f"{problem.start_time:.2f} s, its radius is {problem.robot.radius:.2f} m: move one of them"
            )
    for body, close in enumerate(kept[:, 2]):
        if close < margins[body]:
            time, there = _blocked_at(problem, layout, body)
            raise GoalBlocked(
                f"target ({problem.target[0]:.2f}, {problem.target[1]:.2f}) of robot {name} is {there:.2f} m from "
                f"{layout.names[body]} at {time:.2f} s, demanded {margins[body]:.2f} m: choose another target"
            )


def _blocked_at(problem: SpacetimeProblem, layout: Layout, body: int) -> tuple[float, float]:
    """When a body is first too near to the target [s], and how near [m]; not before the robot can be there."""
    x, y = problem.target
    earliest = int(math.dist(problem.start.position, problem.target) / layout.link)
    for k in range(earliest, layout.most_points):
        rho, _, _ = distance(layout.world, body, k, x, y)
        if rho < layout.margins[body]:
            break
    return problem.start_time + k * layout.step, float(rho)


def _rest_of(previous: SpacetimePlan, problem: SpacetimeProblem, layout: Layout) -> Found | None:
    """What is left of an earlier plan as a candidate."""
    left = previous.path.end_time - problem.start_time
    goes_there = math.dist(previous.path.points[-1, :2], problem.target) <= layout.link
    if left < layout.step or not goes_there or left / layout.step + 2 > layout.most_points:
        return None
    times: FloatArray = problem.start_time + layout.step * np.arange(1.0, int(left / layout.step) + 1)
    points = np.vstack((problem.start.position, previous.path.positions_at(times)[:, :2]))
    return Found(Chain.along(points, layout.link, _SPARE))


class _Arrivals:
    """Candidates that have reached the target: adjusted to the end, told apart, and checked when they are the best."""

    def __init__(self, problem: SpacetimeProblem, settings: SpacetimeSettings, layout: Layout) -> None:
        self.problem, self.settings, self.layout = problem, settings, layout
        self.best: Found | None = None
        self.certificate: Certificate | None = None
        self._paths: list[TimedPath] = []

    def add(self, one: Found) -> float:
        """Settle a candidate; travel time of the best that is accepted [s], infinite if there is none."""
        chain, layout, problem = one.chain, self.layout, self.problem
        gains = fine_gains(layout.link, self.settings.adjustment)
        rests = settle(chain, layout.world, gains, self.settings.adjustment, _SETTLING_PASSES)
        points = with_target(chain, layout.world.ends[1], layout.link)
        one.outcome, one.reason = _verdict(points[:-1], rests, layout.link, self.settings)
        one.path = TimedPath(problem.start_time, layout.step, points)
        if one.outcome is CandidateOutcome.REACHED:
            rest = math.dist(points[-2], points[-1])
            one.travel_time = (len(points) - 2) * layout.step + rest / problem.robot.speed
            self._compare(one, one.path)
        return math.inf if self.best is None else self.best.travel_time

    def _compare(self, one: Found, path: TimedPath) -> None:
        if any(_same(path, other) for other in self._paths):
            one.outcome, one.travel_time = CandidateOutcome.DUPLICATE, math.inf
            one.reason = "another candidate is adjusted to the same path"
            return
        self._paths.append(path)
        if self.best is not None and one.travel_time >= self.best.travel_time:
            return
        certificate = certify_in_spacetime(path, self.problem, self.settings)
        if certificate.accepted:
            self.best, self.certificate = one, certificate
        else:
            one.outcome, one.reason = CandidateOutcome.REFUSED, certificate.reason


def _verdict(
    points: FloatArray, rests: bool, link: float, settings: SpacetimeSettings
) -> tuple[CandidateOutcome, str]:
    """Whether a candidate may be asked of the certificate: spacing counts, not how still its points are (C0-15)."""
    longest, shortest = spacing(points)
    if longest <= settings.longest_link * link and shortest >= (2.0 - settings.longest_link) * link:
        return CandidateOutcome.REACHED, ""
    reason = f"links from {shortest:.3f} to {longest:.3f} m, demanded {link:.3f} m"
    return (CandidateOutcome.STRETCHED if rests else CandidateOutcome.UNSETTLED), reason


def _same(path: TimedPath, other: TimedPath) -> bool:
    if abs(len(other) - len(path)) > 1:
        return False
    count = min(len(path), len(other))
    link = math.dist(path.points[0], path.points[1])
    return float(np.abs(path.points[:count] - other.points[:count]).max()) < _SAME * link


def _choose(
    found: list[Found], arrivals: _Arrivals, problem: SpacetimeProblem, layout: Layout
) -> SpacetimePlan:
    """The fastest candidate that the certificate accepted, beside all others."""
    candidates = tuple(
        Candidate(
            one.chain.chain.copy() if one.path is None else one.path.points,
            tuple((layout.names[body], side) for body, side in one.chain.turns),
            one.outcome or CandidateOutcome.UNSETTLED,
            one.travel_time,
            one.chain.passes,
            one.reason,
        )
        for one in found
    )
    best, certificate = arrivals.best, arrivals.certificate
    if best is None or best.path is None or certificate is None:
        raise NoPathFound(_why_none(candidates, problem))
    return SpacetimePlan(problem.robot.id, best.path, best.travel_time, certificate, candidates)


def _why_none(candidates: tuple[Candidate, ...], problem: SpacetimeProblem) -> str:
    tried = ", ".join(
        f"{sum(one.outcome is outcome for one in candidates)} {outcome.value}"
        for outcome in CandidateOutcome
        if any(one.outcome is outcome for one in candidates)
    )
    reasons = [one.reason for one in candidates if one.reason]
    first = f"; {reasons[0]}" if reasons else ""
    x, y = problem.target
    return f"no path of robot {problem.robot.id} to ({x:.2f}, {y:.2f}) at {problem.start_time:.2f} s: {tried}{first}"


def plan_in_turn(
    problems: Sequence[SpacetimeProblem], settings: SpacetimeSettings, rng: np.random.Generator
) -> dict[str, SpacetimePlan | PlanningError]:
    """Plan several robots one after the other, each around the paths of those before it (Ch. 2, third simulation).

    Parameters
    ----------
    problems : sequence of SpacetimeProblem
        In the order of precedence; `others` are the robots beside them.
    settings : SpacetimeSettings
    rng : numpy.random.Generator

    Returns
    -------
    dict
        For every robot, in this order, its plan or the reason why it has none; it then stays where it is.

    Notes
    -----
    Robots keep the safety margin between their centres, as in the third simulation.
    """
    answers: dict[str, SpacetimePlan | PlanningError] = {}
    others: list[OtherRobot] = []
    for problem in problems:
        name = problem.robot.id
        try:
            plan = plan_in_spacetime(replace(problem, others=(*problem.others, *others)), settings, rng)
        except PlanningError as error:
            answers[name] = error
            path = TimedPath(problem.start_time, settings.sampling_interval, problem.start.position[None])
        else:
            answers[name], path = plan, plan.path
        others.append(OtherRobot(name, path, settings.safety_margin))
    return answers
