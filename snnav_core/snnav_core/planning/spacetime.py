"""The global planner in space-time (Ch. 2): the shortest certified path among bodies in uniform motion."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from snnav_core.errors import NoPathFound, PlanningError
from snnav_core.planning.arrivals import Arrivals
from snnav_core.planning.blocked import check_ends, unreachable
from snnav_core.planning.homotopy_search import Found, search
from snnav_core.planning.seeds import lattice_chain, rest_of_path, route_chain
from snnav_core.planning.spacetime_problem import (
    Candidate,
    CandidateOutcome,
    OtherRobot,
    SpacetimePlan,
    SpacetimeProblem,
    SpacetimeSettings,
    TravelBound,
)
from snnav_core.planning.spacetime_world import Layout, TurningReserve, lay_out
from snnav_core.planning.travel_bound import travel_bound
from snnav_core.types import Certificate, FloatArray, TimedPath

__all__ = ["plan_in_spacetime", "plan_in_turn", "readjust"]

_NEAR = 1.05  # times the lower bound: near enough not to look further
_MOST_PROMOTIONS = 2  # of one robot to the front
_COARSE_CELL, _FINE_CELL = 0.6, 0.35  # of the lattice, as shares of a move


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
        The fastest candidate that `certify_in_spacetime` accepts. Slower ones are not asked of it.

    Raises
    ------
    StartBlocked
        If something is nearer to the robot than its own radius.
    GoalBlocked
        If something is nearer to the target than the safety margin at a time at which the robot may be there (C2-14).
    GoalUnreachable
        If bodies and the border of the workspace leave no way, not even for a point that may wait.
    NoPathFound
        If no candidate reaches the target or none is accepted.

    Notes
    -----
    Best of the candidates that were tried; that there is no better one is not claimed (C2-13).

    Deviation: the route of the lower bound of the travel time for the planning distance, and the ways of a coarse
    search over places and times, are further candidates. The search of Ch. 2 is made for bodies whose margins do not
    overlap; where they do, or bodies are many, it may miss classes. What it is given is adjusted and checked like its
    own candidates.
    """
    layout = lay_out(problem, settings, TurningReserve.CORNERS)
    check_ends(problem, layout)
    bound = travel_bound(problem, float(layout.margins[-1])).time
    if math.isinf(bound):
        raise unreachable(problem, layout)
    failure: NoPathFound | None = None
    tried: list[FloatArray] = []
    for reserve in TurningReserve:
        layout = lay_out(problem, settings, reserve)
        kept = layout.world.kept[:, 0]
        if any((kept == other).all() for other in tried):
            continue
        tried.append(kept)
        arrivals = Arrivals(problem, settings, layout)
        seeds = _given(problem, layout, arrivals, previous, _NEAR * bound)
        try:
            found = search(layout, settings, rng, arrivals.add, arrivals.least)
            return _choose([*seeds, *found], arrivals, problem, layout)
        except NoPathFound as error:
            failure = failure or error
    assert failure is not None
    raise failure


def _given(
    problem: SpacetimeProblem,
    layout: Layout,
    arrivals: Arrivals,
    previous: SpacetimePlan | None,
    enough: float,
) -> list[Found]:
    """Candidates that the search is given, already adjusted; a finer lattice if none takes less than `enough` [s]."""
    given: list[Found] = []
    if layout.earliest == 0:
        return given  # nothing but the last link is to be planned

    def add(one: Found | None) -> None:
        if one is not None:
            arrivals.add(one)
            given.append(one)

    if previous is not None:
        add(rest_of_path(previous.path, problem, layout))
    add(route_chain(_route(problem, layout), problem, layout))
    if problem.others or any(body.speed > 0.0 for body in problem.obstacles):
        add(lattice_chain(layout, _COARSE_CELL))
    if arrivals.least > enough:
        add(lattice_chain(layout, _FINE_CELL))
    return given


def _route(problem: SpacetimeProblem, layout: Layout) -> TravelBound:
    """The quickest way of a point that keeps the planning distance, other robots left out."""
    bodies = layout.world.kept[: len(problem.obstacles), 0]
    return travel_bound(problem, float(max([layout.world.kept[-1, 0], *bodies])))


def readjust(
    path: TimedPath, problem: SpacetimeProblem, settings: SpacetimeSettings
) -> tuple[TimedPath, Certificate] | None:
    """Adjust what is left of a path to a problem that has changed a little, without a search.

    Parameters
    ----------
    path : TimedPath
        An earlier answer to the same target.
    problem : SpacetimeProblem
        Starts where and when the robot is now.
    settings : SpacetimeSettings

    Returns
    -------
    path, certificate
        Accepted; None when the rest of the path leads elsewhere, is stretched, or is refused.
    """
    layout = lay_out(problem, settings, TurningReserve.CORNERS)
    rest = rest_of_path(path, problem, layout)
    if rest is None:
        return None
    arrivals = Arrivals(problem, settings, layout)
    arrivals.add(rest)
    if arrivals.certificate is None or rest.path is None:
        return None
    return rest.path, arrivals.certificate


def _choose(
    found: list[Found], arrivals: Arrivals, problem: SpacetimeProblem, layout: Layout
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
        For every robot, in the given order, its plan or the reason why it has none; it then stays where it is, and all
        others keep clear of it.

    Notes
    -----
    Robots keep the safety margin between their centres, as in the third simulation.

    Deviation C2-12: the order is fixed as long as all find a path in it. A robot that finds none, because others stand
    in its way or pass its target after it has arrived, is planned first instead, at most twice. If that does not
    help, it stays where it is.
    """
    order = list(range(len(problems)))
    promotions = [0] * len(problems)
    staying: dict[int, PlanningError] = {}
    while True:
        plans, failed, error = _round(problems, order, staying, settings, rng)
        if error is None:
            break
        first = order[0] == failed
        order.remove(failed)
        if first or promotions[failed] >= _MOST_PROMOTIONS:
            staying[failed] = error
        else:
            promotions[failed] += 1
            order.insert(0, failed)
    return {problem.robot.id: plans.get(i) or staying[i] for i, problem in enumerate(problems)}


def _round(
    problems: Sequence[SpacetimeProblem],
    order: list[int],
    staying: dict[int, PlanningError],
    settings: SpacetimeSettings,
    rng: np.random.Generator,
) -> tuple[dict[int, SpacetimePlan], int, PlanningError | None]:
    """Plan in one order; the plans, and who failed first and why."""
    others = []
    for i in staying:
        problem = problems[i]
        stays = TimedPath(problem.start_time, settings.sampling_interval, problem.start.position[None])
        others.append(OtherRobot(problem.robot.id, stays, settings.safety_margin))
    plans: dict[int, SpacetimePlan] = {}
    for i in order:
        problem = replace(problems[i], others=(*problems[i].others, *others))
        try:
            plan = plan_in_spacetime(problem, settings, rng)
        except PlanningError as error:
            return plans, i, error
        plans[i] = plan
        others.append(OtherRobot(problem.robot.id, plan.path, settings.safety_margin))
    return plans, -1, None
