"""What is solid never counts as free: areas of scans without noise, against the bodies that were scanned.

Each sensor's area and the union of all. Sampled beams leave some bodies unseen whatever one makes of their returns, and
these scenes hold none of them: bodies thinner than the gap between two beams (4 to 26 cm at 5 to 30 m and 0.5 degrees),
and corners sharper than 90 degrees of which one beam alone met a side.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from shapely.geometry.base import BaseGeometry

from snnav_core.area.agreement import agree, cut_returns
from snnav_core.area.overlay import union_all
from snnav_core.area.planar import UnoccupiedArea, as_multipolygon
from snnav_core.sensing.scan import DetectedArea, detect_planar
from snnav_sim.campaign.halls import draw_hall, draw_sensors
from snnav_sim.configure import fusion_settings, planar_sensor
from snnav_sim.devices.factory import make_device
from snnav_sim.scene_types import Circle, Point, Polygon, Scene, SensorScene, Shape
from snnav_sim.world import World

# [m] Beams are exact to 0.1 um (float32 angles over 30 m: 3 um); a surface may stand out by 0.1 mm before it counts as
# another one (`corners._LEAST`), at both beams of a wedge; circles of the true region are polygons within 0.1 mm; the
# fusion lets returns of other sensors lie up to 1 mm (`return_tolerance`) inside. The latter is the largest.
TOLERANCE = 1e-3
STEP = math.radians(0.5)


def device(name: str, x: float, y: float, heading_deg: float) -> SensorScene:
    return SensorScene(
        id=name,
        device="lms200",
        position=(x, y),
        heading=math.radians(heading_deg),
        field_of_view=math.pi,
        resolution=STEP,
        range_max=30.0,
        angle_min=-0.5 * math.pi,
        noise="none",
    )


def hall(obstacles: tuple[Shape, ...]) -> Scene:
    """A hall of 12 by 8 m seen from the middle of its left wall, a corner, and the right wall."""
    sensors = (device("a", 0.1, 4.0, 0.0), device("b", 0.1, 0.1, 45.0), device("c", 11.9, 5.3, 180.0))
    border = Polygon(((0.0, 0.0), (12.0, 0.0), (12.0, 8.0), (0.0, 8.0)))
    return Scene("solids", 0.5, border, 0.5, sensors, (), obstacles)


def box(x: float, y: float, length: float, width: float, turn: float) -> Polygon:
    corners = 0.5 * np.array([[-length, -width], [length, -width], [length, width], [-length, width]])
    cosine, sine = math.cos(turn), math.sin(turn)
    turned = corners @ np.array([[cosine, sine], [-sine, cosine]]) + (x, y)
    return Polygon(tuple((float(px), float(py)) for px, py in turned))


def parts_of(scene: Scene, world: World) -> list[DetectedArea]:
    parts = []
    for sensor in scene.sensors:
        scan, known = make_device(sensor, world, 0).scan(0.0), planar_sensor(sensor)
        parts.append(detect_planar(sensor.id, scan, known.pose, known.settings))
    return parts


def areas_of(scene: Scene, world: World) -> dict[str, BaseGeometry]:
    """What each sensor alone shows to be free, and all together."""
    parts, settings = parts_of(scene, world), fusion_settings(scene)
    agreed, _ = agree(parts, settings)
    union = as_multipolygon(union_all([part.polygon for part in agreed]))
    return {part.sensor_id: part.polygon for part in parts} | {"union": cut_returns(union, agreed, settings)}


def overlap(area: BaseGeometry, free: BaseGeometry) -> tuple[float, float]:
    """How deep an area reaches into the solids, and how deep these into it [m].

    Both have to be small: a clearance that a robot reads from the area errs by the latter.
    """
    inside = shapely.get_coordinates(shapely.segmentize(shapely.difference(area, free), 0.01))
    if len(inside) == 0:
        return 0.0, 0.0
    into_solids = shapely.distance(shapely.points(inside), free)
    into_area = UnoccupiedArea(0.0, as_multipolygon(area)).clearance(inside)
    return float(into_solids.max()), float(into_area.max())


def assert_nothing_solid_is_free(scene: Scene) -> None:
    world = World(scene)
    for name, area in areas_of(scene, world).items():
        assert area.area > 1.0, name
        assert max(overlap(area, world.static_region)) <= TOLERANCE, name


def random_scene(seed: int) -> Scene:
    """A hall of the campaigns, its devices without noise."""
    draws = np.random.default_rng([7, seed])
    drawn = draw_hall(draws, 10.0, 20.0, 6, 2)
    sensors = tuple(replace(one, noise="none") for one in draw_sensors(draws, drawn, 3, 6, False))
    return Scene("hall", 0.5, drawn.border, 0.5, sensors, (), drawn.obstacles)


UNSEEN = pytest.param(
    37,
    marks=pytest.mark.xfail(strict=True, reason="a tip 1.5 cm long sticks out of a wall between two beams"),
)


@pytest.mark.parametrize("seed", [*range(37), UNSEEN, 38, 39])
def test_random_halls(seed: int) -> None:
    assert_nothing_solid_is_free(random_scene(seed))


@given(st.floats(2.0, 10.0), st.floats(0.2, 0.8), st.floats(0.02, 0.6))
def test_pillars_in_front_of_a_wall(x: float, radius: float, behind: float) -> None:
    """Nearer to the wall than a range jump: beams beside the rim meet the wall."""
    assert_nothing_solid_is_free(hall((Circle(x, 8.0 - behind - radius, radius),)))


@given(st.floats(2.0, 10.0), st.floats(1.5, 6.5), st.floats(0.15, 0.8))
def test_pillars_anywhere(x: float, y: float, radius: float) -> None:
    assert_nothing_solid_is_free(hall((Circle(x, y, radius),)))


@given(
    st.floats(2.5, 9.5),
    st.floats(1.5, 6.8),
    st.floats(0.4, 2.0),
    st.floats(0.7, 2.0),
    st.floats(0.0, 2.0 * math.pi),
    st.floats(-0.1, 0.6),
)
def test_crates_with_a_pillar_at_one_end(
    x: float, y: float, length: float, width: float, turn: float, beyond: float
) -> None:
    """Bodies in front of each other, or one growing out of the other by more than the gap between two beams."""
    reach = 0.5 * length + beyond
    pillar = Circle(x + reach * math.cos(turn), y + reach * math.sin(turn), 0.3)
    assert_nothing_solid_is_free(hall((box(x, y, length, width, turn), pillar)))


@given(st.floats(3.0, 9.0), st.floats(0.2, 0.3), st.floats(1.0, 5.5), st.floats(-0.5, 0.5))
def test_partitions_from_a_wall(x: float, thick: float, length: float, aslant: float) -> None:
    """Seen at a grazing angle, their ends by a few beams."""
    along = np.array([math.sin(aslant), math.cos(aslant)])
    middle = np.array([x, 0.0]) + 0.5 * (length - 0.5) * along
    assert_nothing_solid_is_free(hall((box(*middle, length, thick, 0.5 * math.pi - aslant),)))


@given(st.floats(3.0, 9.0), st.floats(3.0, 5.0), st.floats(0.35, 0.8), st.floats(-0.1, 0.1))
def test_sharp_corners_that_point_at_a_sensor(x: float, y: float, half: float, turn: float) -> None:
    """Many beams meet both sides: down to 40 degrees, with sides at 14 degrees to the beams, their corner is exact."""
    tip, direction = np.array([x, y]), math.atan2(y - 4.0, x - 0.1) + turn

    def along(angle: float) -> Point:
        px, py = tip + 2.0 * np.array([math.cos(angle), math.sin(angle)])
        return float(px), float(py)

    scene = hall((Polygon(((x, y), along(direction - half), along(direction + half))),))
    world = World(replace(scene, sensors=scene.sensors[:1]))
    area = areas_of(world.scene, world)["a"]
    assert max(overlap(area, world.static_region)) <= TOLERANCE
