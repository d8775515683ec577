"""The lower bound of the travel time: no feasible path beats it, and its own way shows that it is tight."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
import shapely
from hypothesis import assume, example, given
from hypothesis import strategies as st

from snnav_core.errors import InvalidInput
from snnav_core.obstacles import MovingObstacle
from snnav_core.planning.spacetime_problem import SpacetimeProblem, TravelBound
from snnav_core.planning.travel_bound import travel_bound
from snnav_core.types import FloatArray, Pose2D, RobotSpec

SPEED, MARGIN, BEGIN = 0.5, 0.6, 3.0
ROBOT = RobotSpec("robot_1", 0.25, SPEED, 2.0)
SIZE = 8.0
CHORDS = 1.0 - math.cos(math.pi / 32)  # what chords cut off, as a share of the radius
HALL = (np.array([[-1.0, -1.0], [9.0, -1.0], [9.0, 9.0], [-1.0, 9.0]]),)

seeds = st.integers(0, 2**32 - 1)


def problem(
    *bodies: MovingObstacle,
    start: tuple[float, float] = (0.0, 0.0),
    target: tuple[float, float] = (10.0, 0.0),
    workspace: tuple[FloatArray, ...] | None = None,
) -> SpacetimeProblem:
    return SpacetimeProblem(ROBOT, Pose2D(*start, 0.0), BEGIN, np.array(target), bodies, (), workspace)


def disk(
    x: float, y: float, radius: float, vx: float = 0.0, vy: float = 0.0, name: str = "disk"
) -> MovingObstacle:
    return MovingObstacle(name, np.array([[x, y]]), radius, np.array([vx, vy]), BEGIN)


def keeps(bound: TravelBound, bodies: tuple[MovingObstacle, ...], margin: float) -> bool:
    """Whether the way of a bound is one: at speed, and with a margin but for what chords cut off."""
    ways, times = np.diff(bound.route[:, :2], axis=0), bound.route[:, 2]
    assert (np.hypot(*ways.T) <= SPEED * np.diff(times) + 1e-9).all()
    least = math.inf
    for body in bodies:
        seen = bound.route[:, :2] - body.velocity * (times - body.stamp)[:, None]
        shape = shapely.MultiPoint(body.outline).convex_hull
        shape = shapely.Polygon(body.outline) if len(body.outline) > 3 else shape
        least = min(
            least, shapely.LineString(seen).distance(shape) - body.radius + CHORDS * (body.radius + MARGIN)
        )
    return least >= margin


def test_a_free_way_is_straight() -> None:
    bound = travel_bound(problem(), MARGIN)
    assert bound.time == pytest.approx(20.0)
    assert bound.route == pytest.approx(np.array([[0.0, 0.0, BEGIN], [10.0, 0.0, BEGIN + 20.0]]))


def test_round_a_disk_that_stands() -> None:
    radius, half = 0.5 + MARGIN, 5.0
    exact = 2.0 * (math.sqrt(half**2 - radius**2) + radius * math.asin(radius / half)) / SPEED
    bound = travel_bound(problem(disk(5.0, 0.0, 0.5)), MARGIN).time
    assert exact * (1.0 - 2e-3) < bound <= exact


def test_in_the_frame_of_a_robot_on_a_belt_motion_changes_nothing() -> None:
    """Everything on a belt, target included, is the same as at rest: here the body runs beside the robot."""
    # Seen from the body the robot goes from (0, 0) to (6, 0) through a wind; with none in its way it is straight.
    assert travel_bound(problem(disk(0.0, 1.2, 0.5, 0.5 * 0.99)), MARGIN).time == pytest.approx(20.0)


def test_what_crosses_is_passed_behind_or_before_whichever_is_quicker() -> None:
    early, late = disk(5.0, 3.0, 0.5, 0.0, -0.35), disk(5.0, 5.0, 0.5, 0.0, -0.4)
    for body in (early, late):
        bound = travel_bound(problem(body), MARGIN)
        assert 20.0 < bound.time < 20.6
        assert keeps(bound, (body,), MARGIN - 1e-6)
    assert travel_bound(problem(disk(5.0, 9.0, 0.5, 0.0, -0.4)), MARGIN).time == pytest.approx(20.0)


def test_the_target_is_free_only_later() -> None:
    """A body stands over the target and leaves: the bound is the time at which it has left, or the way."""
    body = disk(2.0, 0.0, 0.5, 0.0, 0.05)
    bound = travel_bound(problem(body, target=(2.0, 0.0)), MARGIN).time
    assert bound == pytest.approx((0.5 + MARGIN) / 0.05, rel=6e-3)
    assert bound <= (0.5 + MARGIN) / 0.05


def test_no_way_is_an_infinite_time() -> None:
    wall = MovingObstacle("wall", np.array([[4.0, -5.0], [4.5, -5.0], [4.5, 15.0], [4.0, 15.0]]))
    bound = travel_bound(problem(wall, start=(1.0, 1.0), target=(7.0, 7.0), workspace=HALL), MARGIN)
    assert bound.time == math.inf
    assert bound.route.shape == (0, 3)
    assert travel_bound(problem(disk(10.0, 0.0, 0.5)), MARGIN).time == math.inf


def test_what_is_as_fast_as_the_robot_is_left_out_and_named() -> None:
    bound = travel_bound(problem(disk(5.0, 0.0, 0.5), disk(5.0, 5.0, 1.0, 0.0, -0.5, "train")), MARGIN)
    assert bound.left_out == ("train",)
    assert bound.time == travel_bound(problem(disk(5.0, 0.0, 0.5)), MARGIN).time


def test_a_body_nearer_than_the_margin_at_the_start_counts_with_what_it_leaves() -> None:
    assert 20.0 < travel_bound(problem(disk(0.9, 0.0, 0.5)), MARGIN).time < 21.2


def test_nonsense_is_refused() -> None:
    with pytest.raises(InvalidInput, match="margin of the travel bound is 0"):
        travel_bound(problem(), 0.0)
    with pytest.raises(InvalidInput, match="outside the workspace"):
        travel_bound(problem(start=(-5.0, 0.0), workspace=HALL), MARGIN)


def scattered(draws: np.random.Generator, count: int, most: float) -> tuple[MovingObstacle, ...]:
    """Disks that may overlap, start and target free of them at the start."""
    bodies: list[MovingObstacle] = []
    while len(bodies) < count:
        x, y = draws.uniform(0.0, SIZE, 2)
        angle, fast = draws.uniform(0.0, 2.0 * math.pi), draws.uniform(0.0, most) * draws.integers(0, 2)
        radius = draws.uniform(0.1, 0.9)
        if min(math.hypot(x, y), math.hypot(SIZE - x, SIZE - y)) > radius + MARGIN:
            vx, vy = fast * math.cos(angle), fast * math.sin(angle)
            bodies.append(disk(x, y, radius, vx, vy, f"disk_{len(bodies)}"))
    return tuple(bodies)


def free(
    starts: FloatArray,
    begins: FloatArray,
    ends: FloatArray,
    finishes: FloatArray,
    bodies: tuple[MovingObstacle, ...],
) -> FloatArray:
    """Whether straight ways (N, 2) -> (N, 2) at uniform speed keep the margin to all disks."""
    result = np.ones(len(starts), dtype=bool)
    for body in bodies:
        first = starts - body.outline[0] - body.velocity * (begins - body.stamp)[:, None]
        way = ends - body.outline[0] - body.velocity * (finishes - body.stamp)[:, None] - first
        square = np.maximum(np.einsum("ij,ij->i", way, way), 1e-12)
        share = np.clip(-np.einsum("ij,ij->i", first, way) / square, 0.0, 1.0)
        result &= np.hypot(*(first + share[:, None] * way).T) >= body.radius + MARGIN
    return result


def quickest_bend(draws: np.random.Generator, bodies: tuple[MovingObstacle, ...], goal: FloatArray) -> float:
    """Travel time of the best of many ways with a wait at the start and up to two bends."""
    count = 5_000
    places = np.stack(
        [np.zeros((count, 2)), *draws.uniform(-0.5, SIZE + 0.5, (2, count, 2)), np.tile(goal, (count, 1))]
    )
    straight, single = draws.random(count) < 0.1, draws.random(count) < 0.6
    places[1, straight | single] = 0.0
    places[2, straight] = 0.0
    now = BEGIN + draws.uniform(0.0, 8.0, count) * draws.integers(0, 2, count)
    good = free(places[0], np.full(count, BEGIN), places[0], now, bodies)
    for here, there in pairwise(places):
        then = now + np.hypot(*(there - here).T) / SPEED
        good &= free(here, now, there, then, bodies)
        now = then
    return float(np.min(now[good], initial=math.inf)) - BEGIN


def time_expanded(bodies: tuple[MovingObstacle, ...], goal: FloatArray) -> float:
    """Travel time of the best way over a grid in x, y and t, with waits, and from there straight to the target."""
    spacing, layers = 0.25, 60
    step = 2.0 * spacing / SPEED
    axis = spacing * np.arange(-4, round(SIZE / spacing) + 5)
    grid = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1)
    moves = [(i, j) for i in range(-2, 3) for j in range(-2, 3) if i * i + j * j <= 4]
    reached = np.zeros(grid.shape[:2], dtype=bool)
    reached[4, 4] = True
    best = math.inf
    for layer in range(layers):
        now = BEGIN + layer * step
        rows, columns = np.nonzero(reached)
        here = grid[rows, columns]
        arrival = now + np.hypot(*(goal - here).T) / SPEED
        good = free(here, np.full(len(here), now), np.tile(goal, (len(here), 1)), arrival, bodies)
        best = min(best, float(np.min(arrival[good], initial=math.inf)) - BEGIN)
        if now - BEGIN > best:
            break
        following = np.zeros_like(reached)
        for i, j in moves:
            to_rows, to_columns = rows + i, columns + j
            inside = (to_rows >= 0) & (to_rows < len(axis)) & (to_columns >= 0) & (to_columns < len(axis))
            there = grid[to_rows[inside], to_columns[inside]]
            begins, ends = np.full(len(there), now), np.full(len(there), now + step)
            ok = free(here[inside], begins, there, ends, bodies)
            following[to_rows[inside][ok], to_columns[inside][ok]] = True
        reached = following
    return best


@given(seeds)
@example(0)
def test_no_feasible_way_beats_the_bound(seed: int) -> None:
    draws = np.random.default_rng(seed)
    bodies = scattered(draws, int(draws.integers(1, 8)), 0.9 * SPEED)
    goal = np.array([SIZE, SIZE])
    bound = travel_bound(problem(*bodies, target=(SIZE, SIZE)), MARGIN)
    assert bound.time >= math.hypot(SIZE, SIZE) / SPEED - 1e-9
    best = min(quickest_bend(draws, bodies, goal), time_expanded(bodies, goal))
    assert bound.time <= best + 1e-9


@given(seeds)
def test_the_way_of_the_bound_is_one_but_for_the_chords(seed: int) -> None:
    """Where bodies do not lay bare each other's corners, the bound is attained."""
    draws = np.random.default_rng(seed)
    bodies = scattered(draws, int(draws.integers(1, 8)), 0.9 * SPEED)
    bound = travel_bound(problem(*bodies, target=(SIZE, SIZE)), MARGIN)
    assume(math.isfinite(bound.time))
    assert bound.route[0] == pytest.approx([0.0, 0.0, BEGIN])
    assert bound.route[-1] == pytest.approx([SIZE, SIZE, BEGIN + bound.time])
    lengths = np.hypot(*np.diff(bound.route[:, :2], axis=0).T)
    assume((lengths >= SPEED * np.diff(bound.route[:, 2]) - 1e-9).all())
    assert keeps(bound, bodies, MARGIN - 1e-6)


@given(seeds)
def test_the_plane_may_be_turned_and_time_begin_anywhere(seed: int) -> None:
    draws = np.random.default_rng(seed)
    bodies = scattered(draws, 4, 0.5 * SPEED)
    whole = travel_bound(problem(*bodies, target=(SIZE, SIZE)), MARGIN).time
    turned = tuple(
        MovingObstacle(
            body.id,
            body.outline_at(BEGIN + 11.0) @ np.array([[0.0, 1.0], [-1.0, 0.0]]),
            body.radius,
            body.velocity @ np.array([[0.0, 1.0], [-1.0, 0.0]]),
            BEGIN + 11.0,
        )
        for body in bodies
    )
    assert travel_bound(problem(*turned, target=(-SIZE, SIZE)), MARGIN).time == pytest.approx(whole, rel=5e-3)
