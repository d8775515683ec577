"""Rays in space end where the bodies are, however a body is described."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from snnav_core.types import FloatArray
from snnav_sim.raycast3d import (
    cast_boxes,
    cast_prisms,
    cast_spheres,
    cast_triangles,
    leave_box,
    mesh_caster,
)
from snnav_sim.space_types import Box
from snnav_sim.space_world import box_distance, boxes_of, prism_distance, triangle_distance

CORNERS = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
FACES = np.array(
    [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4],
     [1, 5, 7], [1, 7, 3]]
)  # fmt: skip


def rays_from(seed: int, count: int = 400) -> FloatArray:
    rays = np.random.default_rng(seed).normal(size=(count, 3))
    return rays / np.linalg.norm(rays, axis=1, keepdims=True)


def as_prism(box: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    outline = box[:2] + CORNERS * (box[3:5] - box[:2])
    return outline, np.array([0, 4]), box[[2, 5]][None]


def as_triangles(box: FloatArray) -> FloatArray:
    eight = np.array(
        [[box[3 * a], box[3 * b + 1], box[3 * c + 2]] for a in (0, 1) for b in (0, 1) for c in (0, 1)]
    )
    return eight[FACES]


places = st.floats(-3.0, 3.0)
sizes = st.floats(0.2, 2.0)


@settings(deadline=None)
@given(st.tuples(places, places, places), st.tuples(sizes, sizes, sizes), st.integers(0, 99))
def test_a_box_a_prism_and_twelve_triangles_are_one_body(
    low: tuple[float, float, float], size: tuple[float, float, float], seed: int
) -> None:
    box = np.array([*low, *(np.array(low) + size)])
    origin, rays = np.full(3, 3.5) + np.array([0.0, 1.0, 2.0]), rays_from(seed)
    ranges = [np.full(len(rays), 50.0) for _ in range(3)]
    cast_boxes(origin, rays, box[None], ranges[0])
    cast_prisms(origin, rays, *as_prism(box), ranges[1])
    cast_triangles(origin, rays, as_triangles(box), ranges[2])
    np.testing.assert_allclose(ranges[1], ranges[0], atol=1e-9)
    np.testing.assert_allclose(ranges[2], ranges[0], atol=1e-9)
    points = origin + rays * ranges[0][:, None]
    hit = ranges[0] < 50.0
    outline, _, heights = as_prism(box)
    for distance in (
        box_distance(points, box),
        prism_distance(points, outline, *heights[0]),
        triangle_distance(points, as_triangles(box)),
    ):
        assert np.abs(distance[hit]).max(initial=0.0) < 1e-6


def test_embree_and_the_compiled_loop_agree() -> None:
    pytest.importorskip("embreex")
    rng = np.random.default_rng(1)
    boxes = [np.array([*low, *(low + rng.uniform(0.2, 1.0, 3))]) for low in rng.uniform(-5.0, 5.0, (60, 3))]
    triangles = np.concatenate([as_triangles(box) for box in boxes])
    origin, rays = np.array([0.1, 0.2, 0.3]), rays_from(2, 5000)
    one, other = np.full(5000, np.inf), np.full(5000, np.inf)
    mesh_caster(triangles)(origin, rays, one)
    cast_triangles(origin, rays, triangles, other)
    same = np.isclose(one, other, atol=1e-4) | (np.isinf(one) & np.isinf(other))
    assert np.isfinite(other).sum() > 500
    assert same.mean() > 0.999  # at edges, single precision may go either way


def test_spheres_end_rays_where_they_are() -> None:
    rays = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    ranges = np.full(3, 9.0)
    cast_spheres(np.zeros(3), rays, np.array([[4.0, 0.0, 0.0, 0.5], [0.0, 3.0, 0.1, 0.2]]), ranges)
    np.testing.assert_allclose(ranges, [3.5, 3.0 - np.sqrt(0.03), 9.0])


def test_a_room_ends_every_ray() -> None:
    low, high = np.zeros(3), np.array([4.0, 3.0, 2.0])
    origin, rays = np.array([1.0, 1.0, 1.0]), rays_from(3)
    ends = origin + rays * leave_box(origin, rays, low, high)[:, None]
    inside = np.minimum(ends - low, high - ends).min(axis=1)
    np.testing.assert_allclose(inside, 0.0, atol=1e-12)
    straight = leave_box(origin, np.array([[0.0, 0.0, 1.0]]), low, high)
    assert straight[0] == 1.0


def test_holes_are_cut_out_of_a_box() -> None:
    window, door = ((0.0, 1.0, 1.0), (1.0, 2.0, 2.0)), ((-1.0, 3.0, 0.0), (2.0, 5.0, 1.0))
    wall = Box((0.0, 0.0, 0.0), (1.0, 4.0, 3.0), (window, door))
    parts = np.array([[*low, *high] for low, high in boxes_of(wall)])
    sizes_of = np.prod(parts[:, 3:] - parts[:, :3], axis=1)
    assert sizes_of.sum() == pytest.approx(12.0 - 1.0 - 1.0)
    points = np.random.default_rng(4).uniform([0, 0, 0], [1, 4, 3], (500, 3))
    solid = np.min([box_distance(points, part) for part in parts], axis=0) < 0.0
    hole = ((points[:, 1:] > 1) & (points[:, 1:] < 2)).all(axis=1) | ((points[:, 1] > 3) & (points[:, 2] < 1))
    np.testing.assert_array_equal(solid, ~hole)
