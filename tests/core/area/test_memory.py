"""What is remembered as free cannot have been reached by anything slower than the bound."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from shapely.geometry.base import BaseGeometry

from snnav_core.area.memory import remember
from snnav_core.errors import InvalidInput


def blob(generator: np.random.Generator, vertices: int, radius: float, roughness: float) -> shapely.Polygon:
    """Return a star polygon about a random place: smooth, rough or spiky."""
    angle = np.sort(generator.uniform(0.0, 2.0 * math.pi, vertices))
    distance = radius * (1.0 + roughness * generator.uniform(-1.0, 1.0, vertices))
    centre = generator.uniform(-4.0, 4.0, 2)
    return shapely.make_valid(
        shapely.Polygon(centre + distance[:, None] * np.column_stack((np.cos(angle), np.sin(angle))))
    )


def region(generator: np.random.Generator, roughness: float) -> BaseGeometry:
    """Return some big rough pieces with rough obstacles cut out."""
    pieces = shapely.union_all(
        [blob(generator, int(generator.integers(5, 120)), 5.0, roughness) for _ in range(3)]
    )
    obstacles = [blob(generator, int(generator.integers(3, 40)), 0.7, roughness) for _ in range(4)]
    return shapely.difference(pieces, shapely.union_all(obstacles))


def outline_points(geometry: BaseGeometry) -> np.ndarray:
    """Return points along the whole boundary, vertices included."""
    return shapely.points(shapely.get_coordinates(shapely.segmentize(geometry.boundary, 0.05)))


@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from((0.0, 0.01, 0.1, 0.6)),
    st.sampled_from((0.001, 0.05, 0.3, 1.0)),
    st.sampled_from((0.1, 0.5, 2.0)),
)
def test_points_free_by_memory_alone_are_out_of_reach(
    seed: int, roughness: float, elapsed: float, speed: float
) -> None:
    generator = np.random.default_rng(seed)
    previous, current = region(generator, roughness), region(generator, roughness)
    united = remember(previous, current, elapsed, speed)
    assert united.is_valid
    assert shapely.difference(current, united).area < 1e-9, "what is seen now stays free"
    points = outline_points(united)
    by_memory = points[shapely.distance(points, current) > 1e-7]
    assert shapely.covers(previous, by_memory).all()
    assert (shapely.distance(by_memory, previous.boundary) >= elapsed * speed - 1e-9).all()


@given(st.integers(0, 2**32 - 1), st.sampled_from((0.05, 0.5)))
def test_little_more_is_forgotten_than_must_be(seed: int, reach: float) -> None:
    previous = region(np.random.default_rng(seed), 0.1)
    seen = shapely.Point(0.0, 0.0).buffer(0.1)
    kept = remember(previous, seen, 1.0, reach)
    exact = previous.buffer(-1.015 * reach, quad_segs=64)
    assert shapely.difference(exact, kept).area < 1e-6


def test_a_corner_is_rounded_on_the_safe_side_for_every_angle() -> None:
    room = shapely.box(-30.0, -30.0, 30.0, 30.0)
    for turn in np.linspace(0.02, 1.5, 60):
        edge = (5.0 * math.cos(turn / 2), -5.0 * math.sin(turn / 2))
        wedge = shapely.Polygon([(0.0, 0.0), edge, (0.0, -9.0), (-edge[0], edge[1])])
        kept = remember(room.difference(wedge), shapely.Polygon(), 2.0, 0.5)
        assert shapely.distance(outline_points(kept), wedge).min() >= 1.0 - 1e-9


@pytest.mark.parametrize(("elapsed", "speed"), [(1.0, 0.0), (0.0, 0.5), (0.0, 0.0)])
def test_without_time_or_motion_everything_is_kept(elapsed: float, speed: float) -> None:
    generator = np.random.default_rng(3)
    previous, current = region(generator, 0.3), region(generator, 0.3)
    united = remember(previous, current, elapsed, speed)
    assert united.symmetric_difference(previous.union(current)).area < 1e-9


def test_empty_regions_are_no_special_case() -> None:
    square = shapely.box(0.0, 0.0, 1.0, 1.0)
    nothing = shapely.Polygon()
    assert remember(nothing, square, 1.0, 0.5).equals(square)
    assert remember(square, nothing, 10.0, 0.5).is_empty
    assert remember(nothing, nothing, 1.0, 0.5).is_empty


def test_a_shadow_that_sweeps_fast_moves_no_faster_than_the_bound() -> None:
    """A body passes close to a sensor; its shadow 20 m behind sweeps ten times faster (C3-5)."""
    speed, dt = 0.5, 0.2
    room = shapely.box(0.0, -20.0, 20.0, 20.0)
    memory: BaseGeometry | None = None
    watched = shapely.Point(19.0, 0.0)
    clearance = math.inf
    for step in range(40):
        at = -2.0 + speed * dt * step
        shadow = shapely.Polygon(
            [(2.0, at - 0.2), (2.0, at + 0.2), (40.0, 20 * at + 4.0), (40.0, 20 * at - 4.0)]
        )
        seen = room.difference(shadow)
        memory = seen if memory is None else remember(memory, seen, dt, speed)
        now = watched.distance(memory.boundary) if memory.covers(watched) else 0.0
        assert now >= min(clearance, 1.0) - 1.02 * speed * dt - 1e-9
        clearance = now
    assert not seen.equals(memory)


def test_when_most_sensors_fall_silent_the_memory_decays_no_faster_than_it_must() -> None:
    generator = np.random.default_rng(1)
    angle = np.linspace(0.0, 2.0 * math.pi, 4000, endpoint=False)
    distance = 8.0 + generator.normal(0.0, 0.005, 4000)
    seen = shapely.Polygon(distance[:, None] * np.column_stack((np.cos(angle), np.sin(angle))))
    kept = remember(seen, shapely.Polygon(), 1.0, 0.5)
    assert shapely.get_num_coordinates(kept) <= 2000
    assert kept.area > math.pi * (8.0 - 0.02 - 1.3 * 0.5) ** 2


@pytest.mark.parametrize("reach", [0.001, 0.005, 0.05])
def test_the_vertices_do_not_pile_up_under_noise(reach: float) -> None:
    generator = np.random.default_rng(1)
    angle = np.linspace(0.0, 2.0 * math.pi, 720, endpoint=False)
    directions = np.column_stack((np.cos(angle), np.sin(angle)))
    memory: BaseGeometry | None = None
    for _ in range(60):
        seen = shapely.Polygon((8.0 + generator.normal(0.0, 0.01, 720))[:, None] * directions)
        memory = seen if memory is None else remember(memory, seen, 1.0, reach)
        assert shapely.get_num_coordinates(memory) <= 2 * 721 + 2000
    assert memory is not None
    assert memory.area > math.pi * 7.99**2


@pytest.mark.parametrize(
    ("elapsed", "speed", "message"),
    [
        (-0.1, 0.5, "elapsed is -0.1 s.*reset the memory"),
        (math.nan, 0.5, "elapsed is nan"),
        (math.inf, 0.5, "elapsed is inf"),
        (1.0, -0.5, "boundary_speed is -0.5"),
        (1.0, math.nan, "boundary_speed is nan"),
    ],
)
def test_time_running_backwards_and_bad_speeds_are_refused(
    elapsed: float, speed: float, message: str
) -> None:
    with pytest.raises(InvalidInput, match=message):
        remember(shapely.box(0, 0, 1, 1), shapely.box(0, 0, 1, 1), elapsed, speed)
