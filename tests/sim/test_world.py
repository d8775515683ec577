"""Moving bodies, true clearance and the true unoccupied area."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from snnav_sim.scene import Circle, Mover, Polygon, Scene, parse_scene
from snnav_sim.world import World, mover_positions

SQUARE = Polygon(((-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)))


def test_to_and_fro_for_ever() -> None:
    walker = Mover("w", Circle(0, 0, 0.3), ((0.0, 0.0), (4.0, 0.0), (4.0, 3.0)), speed=0.5, loop=True)
    times = np.array([0.0, 4.0, 8.0, 14.0, 20.0, 28.0, 29.0, 56.0])
    expected = [(0, 0), (2, 0), (4, 0), (4, 3), (4, 0), (0, 0), (0.5, 0), (0, 0)]
    assert mover_positions(walker, times) == pytest.approx(np.array(expected, dtype=float))


def test_without_loop_it_stays_at_the_last_point() -> None:
    walker = Mover("w", Circle(0, 0, 0.3), ((0.0, 0.0), (4.0, 0.0)), speed=0.5)
    assert mover_positions(walker, np.array([4.0, 8.0, 80.0])) == pytest.approx(
        np.array([[2.0, 0], [4.0, 0], [4.0, 0]])
    )


def test_a_velocity_lasts_for_ever() -> None:
    cart = Mover("c", SQUARE, start=(50.0, 10.0), velocity=(0.0, 0.3))
    assert mover_positions(cart, 1000.0) == pytest.approx(np.array([[50.0, 310.0]]))


@given(st.floats(0.0, 500.0), st.floats(0.0, 2.0), st.booleans())
def test_no_body_is_faster_than_its_speed(time: float, step: float, loop: bool) -> None:
    walker = Mover(
        "w", Circle(0, 0, 0.3), ((0.0, 0.0), (4.0, 0.0), (4.0, 3.0), (1.0, 1.0)), speed=0.4, loop=loop
    )
    before, after = mover_positions(walker, np.array([time, time + step]))
    assert math.dist(before, after) <= 0.4 * step + 1e-9


def test_clearance_by_hand(room: Scene) -> None:
    world = World(room)
    points = np.array([[2.0, 4.0], [3.5, 4.0], [5.0, 4.0], [5.0, 5.5], [9.5, 7.0], [7.0, 6.0], [-1.0, 4.0]])
    expected = [2.0, 0.5, -1.0, 0.5, 0.5, math.sqrt(2.0), -1.0]
    assert world.obstacle_clearance(points) == pytest.approx(np.array(expected))


@given(st.floats(0.0, 70.0), st.floats(0.0, 45.0), st.floats(0.0, 200.0))
def test_clearance_against_shapely(x: float, y: float, time: float) -> None:
    scene = parse_scene(_EXAMPLE, "example.yaml")
    world = World(scene)
    person, cart = scene.movers
    px, py = mover_positions(person, time)[0]
    cx, cy = mover_positions(cart, time)[0]
    solids = [
        shapely.Polygon(scene.obstacles[0].vertices),
        shapely.Point(40, 20).buffer(2.5, quad_segs=512),
        shapely.Point(px, py).buffer(0.3, quad_segs=256),
        shapely.box(cx - 1, cy - 1, cx + 1, cy + 1),
    ]
    point = shapely.Point(x, y)
    border = shapely.Polygon(scene.workspace)
    expected = border.exterior.distance(point)
    for solid in solids:
        inside = solid.contains(point)
        expected = min(expected, -solid.exterior.distance(point) if inside else solid.distance(point))
    assert world.obstacle_clearance(np.array([[x, y]]), time)[0] == pytest.approx(expected, abs=1e-5)
    assert world.obstacle_clearance(np.array([[x, y]]), np.array([time]))[0] == pytest.approx(
        expected, abs=1e-5
    )


def test_a_body_on_a_sensor(example: Scene) -> None:
    world = World(example)
    assert world.is_covered((20.2, 5.0), 0.0)
    assert not world.is_covered((20.2, 5.0), 10.0)


def test_true_area_of_a_room_with_a_block(room: Scene) -> None:
    """Each sensor sees the room but for the block and its shadow."""
    world = World(room)
    area = world.true_unoccupied_area()
    hidden = shapely.Polygon(room.workspace).difference(shapely.box(4, 3, 6, 5)).difference(area)
    # above and below the block a triangle of 2 m by 1/3 m lies in the shadow of both
    assert hidden.area == pytest.approx(2.0 / 3.0)
    one = World(replace(room, sensors=room.sensors[:1])).true_unoccupied_area()
    assert not one.contains(shapely.Point(7.0, 4.0))
    assert one.contains(shapely.Point(2.0, 4.0))
    assert area is world.true_unoccupied_area(5.0), "a static world is computed once"


def test_true_area_follows_the_bodies(example: Scene) -> None:
    mover = Mover("m", Circle(0, 0, 0.5), start=(4.0, 4.0), velocity=(0.1, 0.0))
    world = World(replace(example, movers=(mover,)))
    assert not world.true_unoccupied_area(0.0).intersects(shapely.Point(4.0, 4.0))
    assert not world.true_unoccupied_area(0.0).contains(shapely.Point(8.0, 8.0)), "its shadow"
    assert world.true_unoccupied_area(20.0).contains(shapely.Point(4.0, 4.0))
    covered = World(replace(example, movers=(replace(mover, start=(2.0, 2.0)),)))
    assert covered.true_unoccupied_area(0.0).is_empty


_EXAMPLE = """\
name: e
sampling_interval: 1.0
boundary_speed: 0.5
safety_margin: 1.0
workspace: {polygon: [[0, 0], [70, 0], [70, 45], [0, 45]]}
obstacles:
  - {polygon: [[10, 5], [14, 5], [14, 30], [10, 30]]}
  - {circle: [40, 20, 2.5]}
movers:
  - {id: person_1, circle: [0, 0, 0.3], waypoints: [[20, 5], [20, 40]], speed: 0.4, loop: true}
  - {id: cart_1, polygon: [[-1, -1], [1, -1], [1, 1], [-1, 1]], start: [50, 10], velocity: [0.0, 0.3]}
sensors:
  - {id: lms, device: lms200, position: [2, 2], heading_deg: 45, field_of_view_deg: 180,
     resolution_deg: 0.5, range_max: 15.0}
robots: []
"""
