"""The global planner in space-time (Ch. 2): the shortest certified path among bodies in uniform motion."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

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
from snnav_core.planning.spacetime_world import Layout, lay_out
from snnav_core.types import Certificate, FloatArray, TimedPath

__all__ = ["plan_in_spacetime", "plan_in_turn"]

_SETTLING_PASSES = 3000  # C0-15
_SAME = 0.2  # of the link length: candidates nowhere farther apart than this are the same path


@dataclass
class _Answer:
    """A candidate that was adjusted to the end, and the path made of it."""

    candidate: Candidate
    path: TimedPath | None = None


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
    layout = lay_out(problem, settings)
    _check_ends(problem, settings, layout)
    found = search(layout, settings, rng)
    if previous is not None and (rest := _rest_of(previous, problem, layout)) is not None:
        found.append(rest)
    answers = _settled(found, layout, problem, settings)
    return _choose(answers, problem, settings)


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
    times = problem.start_time + layout.step * np.arange(1, int(left / layout.step) + 1)
    points = np.vstack((problem.start.position, previous.path.positions_at(times)[:, :2]))
    return Found(Chain.along(points, layout.link, 40), CandidateOutcome.REACHED)


def _settled(
    found: list[Found], layout: Layout, problem: SpacetimeProblem, settings: SpacetimeSettings
) -> list[_Answer]:
    """Adjust to the end what has reached the target, and drop what comes out the same."""
    gains = fine_gains(layout.link, settings.adjustment)
    answers: list[_Answer] = []
    for one in found:
        chain = one.chain
        turns = tuple((layout.names[body], side) for body, side in chain.turns)
        if one.outcome is not CandidateOutcome.REACHED:
            outcome = one.outcome or CandidateOutcome.UNSETTLED
            points = chain.chain.copy()
            answers.append(_Answer(Candidate(points, turns, outcome, math.inf, chain.passes, one.reason)))
            continue
        rests = settle(chain, layout.world, gains, settings.adjustment, _SETTLING_PASSES)
        points = with_target(chain, layout.world.ends[1], layout.link)
        time = (len(points) - 2) * layout.step + math.dist(points[-2], points[-1]) / problem.robot.speed
        outcome, reason = _verdict(points[:-1], rests, layout.link, settings)
        if outcome is CandidateOutcome.REACHED and any(_same(points, other, layout.link) for other in answers):
            outcome, reason = CandidateOutcome.DUPLICATE, "another candidate is adjusted to the same path"
        reached = outcome is CandidateOutcome.REACHED
        candidate = Candidate(points, turns, outcome, time if reached else math.inf, chain.passes, reason)
        path = TimedPath(problem.start_time, layout.step, points) if reached else None
        answers.append(_Answer(candidate, path))
    return answers


def _verdict(
    points: FloatArray, rests: bool, link: float, settings: SpacetimeSettings
) -> tuple[CandidateOutcome, str]:
    longest, shortest = spacing(points)
    stretched = longest > settings.longest_link * link or shortest < (2.0 - settings.longest_link) * link
    if stretched and len(points) > 1:
        reason = f"links from {shortest:.3f} to {longest:.3f} m at rest, demanded {link:.3f} m"
        return CandidateOutcome.STRETCHED, reason
    if not rests and False:
        return CandidateOutcome.UNSETTLED, f"no rest after {_SETTLING_PASSES} passes"
    return CandidateOutcome.REACHED, ""


def _same(points: FloatArray, other: _Answer, link: float) -> bool:
    if other.path is None or abs(len(other.path) - len(points)) > 1:
        return False
    count = min(len(points), len(other.path))
    return float(np.abs(points[:count] - other.path.points[:count]).max()) < _SAME * link


def _choose(answers: list[_Answer], problem: SpacetimeProblem, settings: SpacetimeSettings) -> SpacetimePlan:
    """The fastest candidate that the certificate accepts."""
    certificate: Certificate | None = None
    chosen: _Answer | None = None
    for answer in sorted(answers, key=lambda one: one.candidate.travel_time):
        if answer.path is None or chosen is not None:
            continue
        certificate = certify_in_spacetime(answer.path, problem, settings)
        if certificate.accepted:
            chosen = answer
        else:
            answer.candidate = replace(
                answer.candidate, outcome=CandidateOutcome.REFUSED, reason=certificate.reason
            )
    candidates = tuple(answer.candidate for answer in answers)
    if chosen is None or chosen.path is None or certificate is None:
        raise NoPathFound(_why_none(candidates, problem))
    return SpacetimePlan(
        problem.robot.id, chosen.path, chosen.candidate.travel_time, certificate, candidates
    )


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
