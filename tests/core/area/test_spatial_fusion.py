"""What cameras carve free out of space is free: exactly, with memory, with robots, with inputs that lie."""

from __future__ import annotations

import functools
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from snnav_core.area.grid import Grid
from snnav_core.area.spatial_fusion import SpatialFusion, SpatialFusionSettings
from snnav_core.errors import InvalidInput, ScanError
from snnav_core.sensing.depth import DepthCamera, DepthImage, equal_angle, looking_at, pinhole
from snnav_core.types import FloatArray
from support.box_world import distance, image

ROOM = np.array([[0.0, 0.0, 0.0], [6.0, 5.0, 3.0]])
GRID = Grid.covering(ROOM[0], ROOM[1], 0.1)
MODEL = equal_angle(96, 96, range_max=9.0)
CENTRES = GRID.centres()


def camera(name: str, position: FloatArray, target: FloatArray, kind: str = "equal_angle") -> DepthCamera:
    model = MODEL if kind == "equal_angle" else pinhole(96, 80, (70.0, 70.0), (47.5, 39.5))
    return DepthCamera(name, position, looking_at(position, target), model)


def corners(count: int, kind: str = "equal_angle") -> list[DepthCamera]:
    places = np.array([[0.05, 0.05, 2.9], [5.95, 4.95, 2.9], [5.95, 0.05, 2.9], [0.05, 4.95, 2.9]])
    return [camera(f"cam_{k}", place, np.array([3.0, 2.5, 0.8]), kind) for k, place in enumerate(places)][
        :count
    ]


@functools.cache
def network(kind: str = "equal_angle", boundary_speed: float = 0.0) -> SpatialFusion:
    """Return the fusion of four cameras; what is worked out once for them takes longer than all images."""
    return SpatialFusion(corners(4, kind), SpatialFusionSettings(GRID, boundary_speed=boundary_speed))


def random_boxes(rng: np.random.Generator, count: int) -> FloatArray:
    low = rng.uniform([0.8, 0.8, 0.0], [4.0, 3.2, 1.2], (count, 3))
    return np.stack((low, low + rng.uniform(0.4, 1.2, (count, 3))), axis=1)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 4), st.sampled_from(["equal_angle", "pinhole"]))
def test_no_ball_that_is_proved_free_touches_a_body(seed: int, count: int, kind: str) -> None:
    rng = np.random.default_rng(seed)
    boxes = random_boxes(rng, 3)
    fusion = network(kind)
    fusion.reset()
    for one in corners(count, kind):
        fusion.add_image(one.id, image(one, boxes, ROOM))
    area = fusion.area(0.0)
    proved = area.moving > 0.0
    assert proved.any()
    assert (area.moving[proved] <= distance(CENTRES, boxes)[proved] + 1e-5).all()
    points = rng.uniform(ROOM[0], ROOM[1], (2000, 3))
    bound = area.clearance_at(points)
    to_walls = np.minimum(points - ROOM[0], ROOM[1] - points).min(axis=1)
    true = np.minimum(distance(points, boxes), to_walls)
    assert (bound[bound > 0.0] <= true[bound > 0.0] + 1e-5).all()


def test_an_empty_room_is_free_up_to_its_walls() -> None:
    fusion = SpatialFusion(corners(2), SpatialFusionSettings(GRID))
    for one in corners(2):
        fusion.add_image(one.id, image(one, np.empty((0, 2, 3)), ROOM))
    area = fusion.area(0.0)
    assert float((area.moving > 0.5).mean()) > 0.97
    assert float(area.clearance_at(np.array([[3.0, 2.5, 1.5]]))[0]) == pytest.approx(1.5, abs=0.15)
    assert area.components(0.5)[1] == 1


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_memory_is_sound_while_bodies_move(seed: int) -> None:
    rng = np.random.default_rng(seed)
    speed = 0.3
    boxes = random_boxes(rng, 2)
    heading = rng.uniform(-math.pi, math.pi, 2)
    velocity = speed * np.column_stack((np.cos(heading), np.sin(heading), np.zeros(2)))
    eyes = corners(3)
    fusion = network(boundary_speed=speed)
    fusion.reset()
    for step in range(5):
        time = 0.4 * step
        now = boxes + velocity[:, None, :] * time
        for one in eyes:
            if rng.random() < 0.6:  # the others are silent
                fusion.add_image(one.id, image(one, now, ROOM, time))
        area = fusion.area(time)
        proved = area.moving > 0.0
        assert (area.moving[proved] <= distance(CENTRES, now)[proved] + 1e-5).all()
        later = distance(CENTRES, now + velocity[:, None, :] * 0.7)
        grown = area.moving - 0.7 * speed
        assert (grown[grown > 0.0] <= later[grown > 0.0] + 1e-5).all()
        assert not any(fusion.contradictions.values())


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_images_that_come_late_prove_no_more_than_they_showed(seed: int) -> None:
    """Every camera has its own latency: its images come after newer ones of the others."""
    rng = np.random.default_rng(seed)
    speed = 0.4
    boxes = random_boxes(rng, 2)
    velocity = speed * np.array([[0.6, 0.8, 0.0], [-1.0, 0.0, 0.0]])
    eyes = corners(3)
    fusion = network(boundary_speed=speed)
    fusion.reset()
    latency = dict(zip((one.id for one in eyes), rng.uniform(0.0, 0.5, 3), strict=True))
    added = 0
    for step in range(6):
        time = 0.2 * step
        for one in eyes:
            stamp = time - latency[one.id]
            fusion.add_image(one.id, image(one, boxes + velocity[:, None, :] * stamp, ROOM, stamp))
        before = fusion.area(time)
        true = distance(CENTRES, boxes + velocity[:, None, :] * time)
        proved = before.moving > 0.0
        assert (before.moving[proved] <= true[proved] + 1e-5).all()
        added += int(proved.sum())
    assert added > 0


def test_a_late_image_of_one_camera_adds_what_only_it_saw() -> None:
    eyes = corners(2)
    empty = np.empty((0, 2, 3))
    fusion = SpatialFusion(eyes, SpatialFusionSettings(GRID, boundary_speed=0.25))
    fusion.add_image("cam_0", image(eyes[0], empty, ROOM, 1.0))
    alone = fusion.area(1.0)
    fusion.add_image("cam_1", image(eyes[1], empty, ROOM, 0.8))
    both = fusion.area(1.0)
    assert (both.moving >= alone.moving).all()
    other = SpatialFusion(eyes, SpatialFusionSettings(GRID, boundary_speed=0.25))
    other.add_image("cam_1", image(eyes[1], empty, ROOM, 0.8))
    np.testing.assert_allclose(
        both.moving, np.maximum(alone.moving, other.area(1.0).moving), rtol=0.0, atol=1e-6
    )
    assert (both.moving > alone.moving).any()


def test_a_clock_that_may_be_behind_costs_what_may_have_moved_since() -> None:
    eyes = corners(2)
    areas = []
    for tolerance in (0.0, 0.2):
        settings_ = SpatialFusionSettings(GRID, boundary_speed=0.25, clock_tolerance=tolerance)
        fusion = SpatialFusion(eyes, settings_)
        for one in eyes:
            fusion.add_image(one.id, image(one, np.empty((0, 2, 3)), ROOM))
        areas.append(fusion.area(0.0).moving)
    np.testing.assert_allclose(areas[1], np.maximum(areas[0] - 0.05, 0.0), atol=1e-6)


def test_what_is_no_longer_seen_shrinks_at_the_speed_of_bodies() -> None:
    eyes = corners(2)
    fusion = SpatialFusion(eyes, SpatialFusionSettings(GRID, boundary_speed=0.25))
    for one in eyes:
        fusion.add_image(one.id, image(one, np.empty((0, 2, 3)), ROOM))
    first, second = fusion.area(0.0), fusion.area(2.0)
    np.testing.assert_allclose(second.moving, np.maximum(first.moving - 0.5, 0.0), atol=1e-6)
    np.testing.assert_array_equal(first.static, second.static)


def test_known_walls_do_not_grow_and_take_their_place() -> None:
    walls = np.zeros(GRID.shape, dtype=np.uint8)
    walls[28:32, :, :18] = 1  # up to 1.8 m
    boxes = np.array([[[2.8, 0.0, 0.0], [3.2, 5.0, 1.8]]])
    eyes = corners(2)
    fusion = SpatialFusion(eyes, SpatialFusionSettings(GRID, walls, boundary_speed=0.5))
    for one in eyes:
        fusion.add_image(one.id, image(one, boxes, ROOM))
    area = fusion.area(0.0)
    over = np.array([[3.0, 2.5, 2.5]])
    assert float(area.clearance_at(over, growth=0.3)[0]) == pytest.approx(0.5, abs=0.15)
    assert float(area.clearance_at(np.array([[3.0, 2.5, 1.0]]))[0]) <= 0.0
    assert (area.static <= distance(CENTRES, boxes) + 1e-5).all()


def test_behind_a_known_wall_nothing_is_proved() -> None:
    walls = np.zeros(GRID.shape, dtype=np.uint8)
    walls[28:32] = 1
    boxes = np.array([[[2.8, 0.0, 0.0], [3.2, 5.0, 3.0]]])
    eye = corners(1)[0]
    fusion = SpatialFusion([eye], SpatialFusionSettings(GRID, walls))
    fusion.add_image(eye.id, image(eye, boxes, ROOM))
    proved = fusion.area(0.0).moving > 0.0
    assert proved[5:28, 10:-10, 5:-5].all()
    assert not proved[32:].any()


def test_a_known_robot_does_not_shut_itself_in() -> None:
    position, radius = np.array([3.0, 2.5, 1.5]), 0.2
    body = np.array([[position - 0.1, position + 0.1]])
    eyes = corners(3)
    spheres = np.array([[*position, radius]])
    for robots, clear in ((None, False), (spheres, True)):
        fusion = SpatialFusion(eyes, SpatialFusionSettings(GRID))
        for one in eyes:
            fusion.add_image(one.id, image(one, body, ROOM), robots)
        assert (fusion.area(0.0).moving[30, 25, 15] > 0.5) == clear


def test_a_body_that_appears_where_all_was_free_is_an_obstacle_and_told() -> None:
    """It is faster than boundary_speed allows; a known robot at the same place is no contradiction."""
    body = np.array([[[2.9, 2.4, 1.3], [3.2, 2.7, 1.6]]])
    place = body.mean(axis=(0, 1))
    eyes = corners(3)
    fusion = SpatialFusion(eyes, SpatialFusionSettings(GRID, boundary_speed=0.1))
    for one in eyes:
        fusion.add_image(one.id, image(one, np.empty((0, 2, 3)), ROOM, 0.0))
    assert fusion.area(0.0).clearance_at(place[None])[0] > 1.0
    for one in eyes:
        fusion.add_image(one.id, image(one, body, ROOM, 0.2), np.array([[*place, 0.2]]))
    assert fusion.area(0.2).clearance_at(place[None])[0] > 1.0
    assert not any(fusion.contradictions.values())
    for one in eyes[:2]:
        fusion.add_image(one.id, image(one, body, ROOM, 0.4))
    area = fusion.area(0.4)
    assert [fusion.contradictions[one.id] > 10 for one in eyes] == [True, True, False]
    seen = body[0]  # the corners that two cameras look at
    assert (area.clearance_at(seen) <= 0.0).all()
    proved = area.moving > 0.0
    away = distance(CENTRES, body)
    assert (area.moving[proved] <= away[proved] + 0.3).all()  # up to the depth of the body behind its surface
    for one in eyes:
        fusion.add_image(one.id, image(one, np.empty((0, 2, 3)), ROOM, 0.6))
    assert fusion.area(0.6).clearance_at(place[None])[0] > 1.0


def test_where_a_robot_is_put_down_can_be_declared_free() -> None:
    fusion = SpatialFusion([], SpatialFusionSettings(GRID))
    fusion.declare_free(np.array([3.0, 2.5, 1.5]), 0.6)
    bound = fusion.area(0.0).clearance_at(np.array([[3.0, 2.5, 1.5], [3.0, 2.5, 2.2]]))
    assert 0.599 - 2 * GRID.half_diagonal <= bound[0] <= 0.6
    assert bound[1] <= 0.0


def test_what_was_declared_free_shrinks_though_no_image_comes() -> None:
    fusion = SpatialFusion([], SpatialFusionSettings(GRID, boundary_speed=0.1))
    fusion.declare_free(np.array([3.0, 2.5, 1.5]), 0.6)
    first, later = (fusion.area(time).moving.max() for time in (5.0, 7.0))
    assert later == pytest.approx(first - 0.2, abs=1e-6)


@pytest.mark.parametrize("lie", [math.nan, 0.0, -1.0, 20.0, math.inf])
def test_pixels_without_measurement_prove_nothing(lie: float) -> None:
    one = corners(1)[0]
    fusion = SpatialFusion([one], SpatialFusionSettings(GRID))
    fusion.add_image(one.id, DepthImage(0.0, np.full((96, 96), lie)))
    assert not (fusion.area(0.0).moving > 0.0).any()


def test_no_return_is_free_space_only_where_the_camera_says_so() -> None:
    one = replace(corners(1)[0], inf_is_free=True)
    fusion = SpatialFusion([one], SpatialFusionSettings(GRID))
    fusion.add_image(one.id, DepthImage(0.0, np.full((96, 96), math.inf)))
    assert (fusion.area(0.0).moving > 0.0).any()


def test_wrong_images_are_refused_in_words() -> None:
    eyes = corners(2)
    fusion = SpatialFusion(eyes, SpatialFusionSettings(GRID))
    empty = np.empty((0, 2, 3))
    with pytest.raises(InvalidInput, match="no camera 'cam_9'"):
        fusion.add_image("cam_9", image(eyes[0], empty, ROOM))
    with pytest.raises(ScanError, match="5 x 4 pixels"):
        fusion.add_image("cam_0", DepthImage(0.0, np.ones((4, 5))))
    fusion.add_image("cam_0", image(eyes[0], empty, ROOM, 1.0))
    with pytest.raises(ScanError, match="left out"):
        fusion.add_image("cam_0", image(eyes[0], empty, ROOM, 0.5))
    with pytest.raises(InvalidInput, match="robots"):
        fusion.add_image("cam_1", image(eyes[1], empty, ROOM, 1.0), np.full((1, 4), math.nan))
    fusion.area(2.0)
    with pytest.raises(InvalidInput, match="reset"):
        fusion.area(1.0)
    fusion.reset()
    assert not (fusion.area(0.0).moving > 0.0).any()
    with pytest.raises(InvalidInput, match="two cameras"):
        SpatialFusion([eyes[0], eyes[0]], SpatialFusionSettings(GRID))
    with pytest.raises(InvalidInput, match="walls have shape"):
        SpatialFusionSettings(GRID, np.zeros((2, 2, 2), dtype=np.uint8))
    with pytest.raises(InvalidInput, match="boundary_speed is nan"):
        SpatialFusionSettings(GRID, boundary_speed=math.nan)
