"""The global planner in space-time: cost against bodies and length, beside OMPL's RRT* in x, y and t."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numba
import numpy as np
from harness import Row, absent, milliseconds, repeat, stopwatch

from snnav_core.errors import PlanningError
from snnav_core.obstacles import MovingObstacle
from snnav_core.planning.spacetime import plan_in_spacetime
from snnav_core.planning.spacetime_problem import SpacetimeProblem, SpacetimeSettings
from snnav_core.planning.travel_bound import travel_bound
from snnav_core.types import FloatArray, Pose2D, RobotSpec

ROBOT = RobotSpec("robot_1", 0.25, 0.5, 2.0)  # as in the simulations of Ch. 2
SETTINGS = SpacetimeSettings()
MARGIN = SETTINGS.safety_margin + SETTINGS.tracking_tolerance
FIELDS = 10
LENGTH = 20.0
COUNTS = (1, 2, 5, 10, 20, 50)
LENGTHS = (5.0, 10.0, 20.0, 40.0)
LIMIT_MS = 500.0
PEER_LIMIT = 5.0
PEER_FIELDS = 5
PEER_LONGEST = 3.0  # straight ways that the time axis is long


def field(seed: int, count: int, length: float) -> SpacetimeProblem:
    """Return disks that cross the straight way of a robot at up to half its speed, free at its ends."""
    draws = np.random.default_rng([seed, count, round(length)])
    target, lasting = np.array([length, 0.0]), 2.0 * length / ROBOT.speed
    bodies: list[MovingObstacle] = []
    while len(bodies) < count:
        radius, when = draws.uniform(0.2, 0.6), draws.uniform(0.0, 1.0)
        angle, speed = draws.uniform(0.0, 2.0 * math.pi), draws.uniform(0.0, 0.5) * ROBOT.speed
        velocity = speed * np.array([math.cos(angle), math.sin(angle)])
        # somewhere near the way when the robot may come by
        place = np.array([when * length, draws.uniform(-3.0, 3.0)]) - velocity * when * length / ROBOT.speed
        clear = radius + MARGIN + 0.05
        passes = place - target + velocity * np.linspace(0.0, lasting, 400)[:, None]
        if math.hypot(*place) > clear and np.hypot(*passes.T).min() > clear:
            bodies.append(MovingObstacle(f"disk_{len(bodies) + 1}", place[None], radius, velocity))
    return SpacetimeProblem(ROBOT, Pose2D(0.0, 0.0, 0.0), 0.0, target, tuple(bodies))


def plan(problem: SpacetimeProblem) -> float:
    """Plan and return the travel time [s]; infinite if there is no path."""
    try:
        return plan_in_spacetime(problem, SETTINGS, np.random.default_rng(1)).travel_time
    except PlanningError:
        return math.inf


def ours(what: str, problems: list[SpacetimeProblem], demanded: bool = False) -> tuple[Row, FloatArray]:
    """Measure our planner, and return its travel times too."""
    plan(problems[0])  # compiles
    found, times = np.empty(len(problems)), np.empty(len(problems))
    for k, problem in enumerate(problems):

        def work(k: int = k, problem: SpacetimeProblem = problem) -> None:
            found[k] = plan(problem)

        times[k] = stopwatch(work)
    bounds = np.array([travel_bound(problem, MARGIN).time for problem in problems])
    solved = np.isfinite(found)
    gap = float(np.median(found[solved] / bounds[solved] - 1.0))
    result = (
        f"{milliseconds(times)}; {int(solved.sum())} of {len(problems)}, {100.0 * gap:.2f} % above the bound"
    )
    worst = float(times.max()) * 1e3
    limit = f"<= {LIMIT_MS:g} ms" if demanded else ""
    return Row(what, result, float(np.median(times)), limit, demanded and worst > LIMIT_MS), found


def bound_row(what: str, problems: list[SpacetimeProblem]) -> Row:
    """Measure the lower bound of the travel time."""
    times = np.concatenate([repeat(partial(travel_bound, problem, MARGIN), 5) for problem in problems])
    return Row(what, milliseconds(times), float(np.median(times)))


def by_count() -> list[Row]:
    """The same way among more and more bodies."""
    rows = []
    for count in COUNTS:
        problems = [field(seed, count, LENGTH) for seed in range(FIELDS)]
        row, _ = ours(f"snnav, {count} bodies", problems, demanded=count == 10)
        rows += [row, bound_row(f"lower bound, {count} bodies", problems)]
    return rows


def by_length() -> list[Row]:
    """Longer and longer ways, a body for every 2 m."""
    rows = []
    for length in LENGTHS:
        count = round(0.5 * length)
        problems = [field(seed, count, length) for seed in range(FIELDS)]
        row, _ = ours(f"snnav, {length:g} m, {count} bodies", problems)
        rows.append(row)
    return rows


@numba.njit(cache=True)
def is_free(ax: float, ay: float, begin: float, bx: float, by: float, end: float, disks: FloatArray) -> bool:
    """Whether a straight way in space-time keeps out of all disks, rows x, y, vx, vy, radius; exact."""
    for k in range(len(disks)):
        x, y, vx, vy, radius = disks[k]
        px, py = ax - x - vx * begin, ay - y - vy * begin
        wx, wy = bx - x - vx * end - px, by - y - vy * end - py
        square = wx * wx + wy * wy
        share = min(max(-(px * wx + py * wy) / square, 0.0), 1.0) if square > 0.0 else 0.0
        if (px + share * wx) ** 2 + (py + share * wy) ** 2 < radius * radius:
            return False
    return True


def ompl_run(problem: SpacetimeProblem, seed: int, enough: float) -> tuple[float, float]:
    """Run OMPL's RRT* in its space-time until a path arrives within `enough` [s] or the limit is over.

    Returns
    -------
    seconds, travel_time : float
        What it took and what it found [s]; infinite without a path.

    Notes
    -----
    The wheel has the space of states, but not ST-RRT*. Cost is time; sight is tested exactly by a compiled function,
    called through Python as all validators of the binding are.
    """
    from ompl import base, util

    util.setLogLevel(util.LogLevel.LOG_NONE)
    util.RNG.setSeed(seed)
    disks = np.array([[*body.outline[0], *body.velocity, body.radius + MARGIN] for body in problem.obstacles])
    longest = PEER_LONGEST * math.dist(problem.start.position, problem.target) / ROBOT.speed
    plane = base.RealVectorStateSpace(2)
    bounds = base.RealVectorBounds(2)
    for axis, (low, high) in enumerate(((-4.0, problem.target[0] + 4.0), (-8.0, 8.0))):
        bounds.setLow(axis, low)
        bounds.setHigh(axis, high)
    plane.setBounds(bounds)
    space = base.SpaceTimeStateSpace(plane, ROBOT.speed, 1.0)
    space.setTimeBounds(0.0, longest)
    setup, *_kept_alive = ompl_setup(space, disks, problem.target, longest, seed, enough)
    seconds = stopwatch(lambda: setup.solve(PEER_LIMIT))
    if not setup.haveExactSolutionPath():
        return seconds, math.inf
    return seconds, float(setup.getSolutionPath().getStates()[-1][1].position)


def ompl_setup(
    space: Any, disks: FloatArray, goal: FloatArray, longest: float, seed: int, enough: float
) -> tuple[Any, ...]:
    """Return what OMPL has to solve, and what must live as long."""
    from ompl import base, geometric

    setup = geometric.SimpleSetup(space)
    information = setup.getSpaceInformation()

    class Straight(base.MotionValidator):  # type: ignore[misc]
        def checkMotion(self, one: Any, other: Any, *_: Any) -> bool:  # noqa: N802
            (ax, ay), begin, (bx, by), end = (
                (one[0][0], one[0][1]),
                one[1].position,
                (other[0][0], other[0][1]),
                other[1].position,
            )
            if math.hypot(bx - ax, by - ay) > ROBOT.speed * (end - begin) * (1.0 + 1e-9):
                return False
            return bool(is_free(ax, ay, begin, bx, by, end, disks))

    class Arrival(base.GoalSampleableRegion):  # type: ignore[misc]
        def __init__(self, si: Any) -> None:
            super().__init__(si)
            self.draws = np.random.default_rng(seed)

        def distanceGoal(self, state: Any) -> float:  # noqa: N802
            return math.hypot(state[0][0] - goal[0], state[0][1] - goal[1])

        def sampleGoal(self, state: Any) -> None:  # noqa: N802
            state[0][0], state[0][1] = float(goal[0]), float(goal[1])
            state[1].position = float(self.draws.uniform(math.hypot(*goal) / ROBOT.speed, longest))

        def maxSampleCount(self) -> int:  # noqa: N802
            return 1_000_000

    def valid(state: Any) -> bool:
        x, y, now = state[0][0], state[0][1], state[1].position
        return bool(is_free(x, y, now, x, y, now, disks))

    setup.setStateValidityChecker(valid)
    validator = Straight(information)
    information.setMotionValidator(validator)
    start = space.allocState()
    start[0][0], start[0][1] = 0.0, 0.0
    start[1].position = 0.0
    setup.setStartState(start)
    region = Arrival(information)
    region.setThreshold(ROBOT.speed * SETTINGS.sampling_interval)
    setup.setGoal(region)
    objective = base.PathLengthOptimizationObjective(information)
    objective.setCostThreshold(base.Cost(enough))
    setup.setOptimizationObjective(objective)
    setup.setPlanner(geometric.RRTstar(information))
    setup.setup()
    return setup, validator, region, objective


def beside(count: int) -> list[Row]:
    """Our planner and RRT* on the same fields."""
    problems = [field(seed, count, LENGTH) for seed in range(PEER_FIELDS)]
    row, found = ours(f"snnav, {count} bodies, {LENGTH:g} m", problems)
    try:
        import ompl  # noqa: F401
    except ImportError:
        return [row, absent("OMPL")]
    rows = [row]
    for share, words in ((math.inf, "any path"), (1.1, "10 % more time than ours")):
        runs = [
            ompl_run(problem, seed + 1, min(share * time, 1e6))
            for seed, (problem, time) in enumerate(zip(problems, found, strict=True))
        ]
        done = [taken <= share * time for (_, taken), time in zip(runs, found, strict=True)]
        good = [math.isfinite(taken) and ok for (_, taken), ok in zip(runs, done, strict=True)]
        median = float(
            np.median([seconds if ok else math.inf for (seconds, _), ok in zip(runs, good, strict=True)])
        )
        late = [
            taken / time - 1.0 for (_, taken), time in zip(runs, found, strict=True) if math.isfinite(taken)
        ]
        result = f"{median * 1e3:,.0f} ms" if math.isfinite(median) else f"not in {PEER_LIMIT:g} s"
        if late:
            result += f"; {sum(good)} of {len(good)}, {100.0 * float(np.median(late)):.1f} % later"
        rows.append(Row(f"OMPL RRT* in space-time to {words}, may wait, any turn", result, median, peer=True))
    return rows


def benches() -> dict[str, Any]:
    """All that is measured, by title."""
    return {
        f"global planner, {LENGTH:g} m among moving disks, against their number ({FIELDS} fields each)": by_count,
        f"global planner, a moving disk for every 2 m, against the length ({FIELDS} fields each)": by_length,
        f"global planner beside OMPL, 10 moving disks ({PEER_FIELDS} fields)": partial(beside, 10),
    }
