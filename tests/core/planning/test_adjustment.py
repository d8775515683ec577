"""The adjustment loop yields short paths with even links that keep their margin exactly, in the plane and in space."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from snnav_core.planning.adjustment import AdjustmentResult, AdjustmentSettings, adjust, resample
from snnav_core.planning.fields import BoundaryBarrier, CircleBarrier, DiskBarrier
from snnav_core.types import FloatArray

Query = Callable[[FloatArray], tuple[FloatArray, FloatArray]]


@dataclass(frozen=True)
class Field:
    """A distance field from a function."""

    query: Query


SETTINGS = AdjustmentSettings()
SPRINGS = AdjustmentSettings(exact_barriers=False)
TO_REST = AdjustmentSettings(rest_threshold=0.0003)


def ball(centre: FloatArray, radius: float) -> Query:
    """Return distance and gradient outside of a disk or a ball."""

    def query(points: FloatArray) -> tuple[FloatArray, FloatArray]:
        offset = points - centre
        distance = np.sqrt(np.einsum("ij,ij->i", offset, offset))
        return distance - radius, offset / np.maximum(distance, 1e-12)[:, None]

    return query


def corridor(half_width: float) -> Query:
    def query(points: FloatArray) -> tuple[FloatArray, FloatArray]:
        side = np.where(points[:, 1] > 0.0, -1.0, 1.0)
        return half_width - np.abs(points[:, 1]), np.column_stack((np.zeros(len(points)), side))

    return query


def around(radius: float, length: float = 8.0, link: float = 0.25, dimension: int = 2) -> FloatArray:
    """Return a wide way around the origin from (-length, 0) to (length, 0), above it."""
    knots = np.array([[-length, 0.0], [-length, 2.0 * radius], [length, 2.0 * radius], [length, 0.0]])
    return resample(np.pad(knots, ((0, 0), (0, dimension - 2))), link)


def settle(
    points: FloatArray, target: FloatArray, link: float, query: Query, margin: float
) -> AdjustmentResult:
    barrier = BoundaryBarrier(Field(query), np.full(3, margin))
    return adjust(points, target, link, [barrier], TO_REST, 6000, 500)


def total_length(result: AdjustmentResult, target: FloatArray) -> float:
    chain = np.vstack((result.points, target))
    return float(np.linalg.norm(np.diff(chain, axis=0), axis=1).sum())


def shortest_around(radius: float, length: float) -> float:
    """Length of tangent, arc, tangent around a disk in the middle between two points on its diameter."""
    return 2.0 * math.sqrt(length**2 - radius**2) + radius * (math.pi - 2.0 * math.acos(radius / length))


@settings(max_examples=12)
@given(
    st.floats(0.3, 1.5),
    st.floats(0.3, 1.5),
    st.sampled_from((0.25, 0.4)),
    st.sampled_from((2, 3)),
    st.floats(-math.pi, math.pi),
)
def test_around_a_ball_the_path_keeps_its_margin_and_is_as_short_as_can_be(
    radius: float, margin: float, link: float, dimension: int, angle: float
) -> None:
    target = np.zeros(dimension)
    target[0] = 8.0
    points = around(radius + margin, 8.0, link, dimension)
    if dimension == 3:
        turn = np.array(
            [
                [1.0, 0.0, 0.0],
                [0.0, math.cos(angle), -math.sin(angle)],
                [0.0, math.sin(angle), math.cos(angle)],
            ]
        )
        points = points @ turn.T
    query = ball(np.zeros(dimension), radius)
    result = settle(points, target, link, query, margin)
    assert result.settled
    np.testing.assert_array_equal(result.points[0], points[0])
    assert query(result.points[1:])[0].min() >= margin - 1e-9, "exact at the points"
    links = np.linalg.norm(np.diff(result.points, axis=0), axis=1)
    assert np.abs(links / link - 1.0).max() < 0.02
    optimum = shortest_around(radius + margin, 8.0)
    # Chords of the arc are shorter than the arc, by L^2 / (24 r^2).
    assert 0.995 * optimum < total_length(result, target) < 1.001 * optimum


@settings(max_examples=8)
@given(st.floats(-math.pi, math.pi), st.integers(0, 2**32 - 1))
def test_the_adjusted_path_turns_with_the_map(angle: float, seed: int) -> None:
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    shift = np.random.default_rng(seed).normal(0.0, 5.0, 2)
    points, target = around(1.5), np.array([8.0, 0.0])
    plain = settle(points, target, 0.25, ball(np.zeros(2), 1.0), 0.5)
    moved = settle(points @ turn.T + shift, turn @ target + shift, 0.25, ball(shift, 1.0), 0.5)
    assert moved.passes == plain.passes
    np.testing.assert_allclose(moved.points, plain.points @ turn.T + shift, atol=1e-6)


@settings(max_examples=15)
@given(st.floats(0.3, 1.5), st.floats(0.3, 1.5), st.sampled_from((0.1, 0.25, 0.4)))
def test_with_the_quick_threshold_a_tight_candidate_keeps_its_margin_and_gets_no_longer(
    radius: float, margin: float, link: float
) -> None:
    """What the navigator does: candidates follow the boundary of the reduced area, and the loop ends early."""
    reduced = radius + margin
    opening = math.acos(reduced / 8.0)
    arc = np.linspace(math.pi - opening, opening, 40)
    knots = np.vstack(([[-8.0, 0.0]], reduced * np.column_stack((np.cos(arc), np.sin(arc))), [[8.0, 0.0]]))
    target, query = np.array([8.0, 0.0]), ball(np.zeros(2), radius)
    barrier = BoundaryBarrier(Field(query), np.array([margin]))
    result = adjust(resample(knots, link), target, link, [barrier], SETTINGS, SETTINGS.cold_passes, 500)
    assert result.settled
    assert query(result.points[1:])[0].min() >= margin - 1e-9
    assert total_length(result, target) < 1.002 * shortest_around(reduced, 8.0)
    assert np.abs(np.linalg.norm(np.diff(result.points, axis=0), axis=1) / link - 1.0).max() < 0.1


@pytest.mark.parametrize(("pull", "radius"), [(0.02, 3.0), (0.1, 3.0), (0.05, 1.5)])
def test_as_a_spring_the_margin_is_missed_by_what_the_notes_say(pull: float, radius: float) -> None:
    """Deviation C0-5: G_P L / (rho G_R) on a half circle of radius rho; G_P is `pull` times L here."""
    spring = AdjustmentSettings(exact_barriers=False, pull=pull, rest_threshold=0.0003)
    arc = np.linspace(math.pi, 0.0, 50)
    half_circle = radius * np.column_stack((np.cos(arc), np.sin(arc)))
    target, link = np.array([radius, -6.0]), 0.5
    points = resample(np.vstack(([[-radius, -6.0]], half_circle, target[None])), link)
    query = ball(np.zeros(2), 0.5)
    result = adjust(
        points, target, link, [BoundaryBarrier(Field(query), np.array([radius - 0.5]))], spring, 6000, 500
    )
    assert result.settled
    deficit = radius - 0.5 - float(query(result.points)[0].min())
    assert deficit == pytest.approx(pull * link * link / (radius * spring.barrier_gain), rel=0.05)


def test_without_the_shorter_rest_length_every_link_would_be_too_long() -> None:
    """Deviation C0-3: the constant pull stretches a free chain by nothing."""
    target = np.array([10.1, 0.0])
    points = np.column_stack((np.arange(11.0), 0.3 * np.sin(np.arange(11.0))))
    result = adjust(points, target, 1.0, [], TO_REST, 3000, 100)
    assert result.settled
    np.testing.assert_allclose(np.linalg.norm(np.diff(result.points, axis=0), axis=1), 1.0, atol=0.01)
    np.testing.assert_allclose(result.points[:, 1], 0.0, atol=0.05)


@pytest.mark.parametrize("gains", [SETTINGS, SPRINGS])
def test_a_passage_narrower_than_twice_the_margin_has_no_rest(gains: AdjustmentSettings) -> None:
    points = resample(np.array([[0.0, 0.1], [6.0, 0.1]]), 0.25)
    barrier = BoundaryBarrier(Field(corridor(0.4)), np.array([0.6]))
    result = adjust(points, np.array([6.0, 0.0]), 0.25, [barrier], gains, 400, 200)
    kept = corridor(0.4)(result.points[1:])[0].min() >= 0.6
    assert not (result.settled and kept)
    assert np.isfinite(result.points).all()
    assert result.passes <= 400


def test_a_start_nearer_than_the_margin_climbs_with_a_growing_margin() -> None:
    """C3-13: the demanded distance grows from where the robot stands."""
    margins = np.minimum(0.2 + 0.1 * np.arange(1, 20), 1.0)
    wall = ball(np.array([0.0, -50.0]), 50.0)
    points = resample(np.array([[0.0, 0.2], [8.0, 1.2]]), 0.25)
    result = adjust(
        points, np.array([8.0, 1.2]), 0.25, [BoundaryBarrier(Field(wall), margins)], SETTINGS, 3000, 200
    )
    assert result.settled
    distance = wall(result.points[1:])[0]
    demanded = np.minimum(0.2 + 0.1 * np.arange(1, len(distance) + 1), 1.0)
    assert (distance >= demanded - 1e-9).all()


def test_several_barriers_hold_together() -> None:
    """An initial circle, a boundary and a robot that crosses."""
    target = np.array([8.0, 0.0])
    query = ball(np.array([4.0, 0.5]), 0.5)
    other = np.column_stack((np.full(60, 6.0), 3.0 - 0.1 * np.arange(60)))
    barriers = [
        BoundaryBarrier(Field(query), np.array([0.5])),
        DiskBarrier(other, np.full(60, 0.6)),
        CircleBarrier(np.array([0.0, 1.0]), 1.0, 20),
    ]
    points = resample(np.array([[0.0, 0.0], [4.0, -1.5], [8.0, 0.0]]), 0.25)
    result = adjust(points, target, 0.25, barriers, SETTINGS, 3000, 200)
    assert result.settled
    for barrier in barriers:
        barrier.reset()
        assert barrier.violation(result.points[1:])[0].max() <= 1e-6


@given(st.integers(0, 2**32 - 1), st.integers(1, 80), st.integers(0, 30))
def test_the_loop_always_ends_within_its_bounds(seed: int, max_passes: int, max_points: int) -> None:
    generator = np.random.default_rng(seed)
    points = generator.normal(0.0, 3.0, (int(generator.integers(1, 12)), 2))
    target = generator.normal(0.0, 30.0, 2)
    barriers = [
        BoundaryBarrier(Field(corridor(0.5)), np.array([0.7])),
        DiskBarrier(np.zeros((1, 2)), np.ones(1)),
    ]
    result = adjust(points, target, 0.3, barriers, SETTINGS, max_passes, max_points)
    assert result.passes <= max_passes
    assert len(result.points) <= max(max_points + 2, len(points) + 1)
    assert np.isfinite(result.points).all()
    np.testing.assert_array_equal(result.points[0], points[0])
    if result.settled:
        gap = float(np.linalg.norm(target - result.points[-1]))
        assert gap <= SETTINGS.longest_end * 0.3 + 1e-9


def test_points_are_added_and_removed_at_the_end_until_the_target_is_near() -> None:
    target = np.array([5.0, 0.0])
    for start in (np.array([[0.0, 0.0]]), np.column_stack((np.linspace(0.0, 9.0, 31), np.zeros(31)))):
        result = adjust(start, target, 0.3, [], TO_REST, 3000, 100)
        assert result.settled
        assert SETTINGS.shortest_end * 0.3 <= np.linalg.norm(target - result.points[-1]) <= 1.5 * 0.3
        assert len(result.points) in (16, 17)


def test_a_settled_path_stays_where_it_is() -> None:
    query, target = ball(np.zeros(2), 1.0), np.array([8.0, 0.0])
    first = settle(around(1.5), target, 0.25, query, 0.5)
    again = settle(first.points, target, 0.25, query, 0.5)
    assert again.settled
    assert again.passes < first.passes
    np.testing.assert_allclose(again.points, first.points, atol=0.005)


@given(st.integers(0, 2**32 - 1), st.floats(0.05, 3.0), st.sampled_from((2, 3)))
def test_resampling_keeps_to_the_chain_at_equal_steps_along_it(
    seed: int, spacing: float, dimension: int
) -> None:
    generator = np.random.default_rng(seed)
    knots = generator.normal(0.0, 3.0, (int(generator.integers(2, 9)), dimension))
    points = resample(knots, spacing)
    along = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(knots, axis=0), axis=1))))
    assert len(points) == math.floor(along[-1] / spacing + 1e-9) + 1
    for index, point in enumerate(points):
        station = index * spacing
        segment = min(int(np.searchsorted(along, station, side="right")) - 1, len(knots) - 2)
        share = (station - along[segment]) / (along[segment + 1] - along[segment])
        np.testing.assert_allclose(
            point, knots[segment] + share * (knots[segment + 1] - knots[segment]), atol=1e-9
        )
