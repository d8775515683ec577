"""The true unoccupied area among moving bodies, against areas computed whole and against what fusion claims."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely

from snnav_core.area.fusion import AreaFusion
from snnav_sim.configure import fusion_settings, planar_sensor
from snnav_sim.devices import make_device
from snnav_sim.devices.feed import SensorFeed
from snnav_sim.report.true_area import TrueMemory
from snnav_sim.report.truth import GroundTruth
from snnav_sim.scene_types import Circle, Mover, Scene
from snnav_sim.world import World

WALKERS = (
    Mover("w", Circle(0.0, 0.0, 0.3), ((3.0, 1.0), (3.0, 7.0)), speed=0.5, loop=True),
    Mover("v", Circle(0.0, 0.0, 0.4), ((8.0, 6.5), (7.0, 1.5)), speed=0.3),
)


@pytest.fixture
def busy(room: Scene) -> Scene:
    """The room with two walkers, seen by one sensor all round and by one with a gap behind it."""
    first, second = room.sensors
    second = replace(second, field_of_view=math.radians(300), angle_min=math.radians(-150), heading=0.5)
    return replace(room, movers=WALKERS, boundary_speed=0.5, sensors=(first, second))


def whole_area(scene: Scene, memory: TrueMemory, time: float) -> shapely.Geometry:
    """M(t) between sampling instants, the long way: everything seen, and all of the eroded memory."""
    number = math.floor(time / scene.sampling_interval + 1e-9)
    age = time - number * scene.sampling_interval
    kept = memory.region(number).buffer(-age * scene.boundary_speed, quad_segs=200)
    return shapely.union(World(scene).true_unoccupied_area(time), kept)


def signed(area: shapely.Geometry, point: np.ndarray) -> float:
    where = shapely.Point(point)
    distance = shapely.distance(where, shapely.boundary(area))
    return float(distance if area.intersects(where) else -distance)


def test_distances_between_sampling_instants_are_those_of_the_whole_area(busy: Scene) -> None:
    memory = TrueMemory(World(busy))
    generator = np.random.default_rng(3)
    points = generator.uniform((0.2, 0.2), (9.8, 7.8), (150, 2))
    times = generator.integers(0, 240, 150) * busy.control_period
    values, exact = memory.clearance(points, times)
    true = np.array([signed(whole_area(busy, memory, t), p) for p, t in zip(points, times, strict=True)])
    assert np.all(values <= true + 1e-4), "a lower bound everywhere"
    assert values[exact] == pytest.approx(true[exact], abs=2e-3)
    assert exact.sum() > 50
    assert exact[values < busy.safety_margin].all()
    assert exact[np.argmin(values)]


def test_the_memory_holds_what_is_seen_and_what_nothing_can_have_reached(busy: Scene) -> None:
    memory, world = TrueMemory(World(busy)), World(busy)
    remembered = 0.0
    for number in range(1, 25):
        area, seen = memory.region(number), world.true_unoccupied_area(0.5 * number)
        bodies = world.free_region(0.5 * number)
        assert seen.difference(area).area < 1e-6
        assert area.difference(bodies).area < 1e-6, "never where a body is"
        left = memory.region(number - 1).buffer(-0.25)
        assert area.difference(seen.union(left)).area < 1e-3
        remembered = max(remembered, area.difference(seen).area)
    assert remembered > 0.5


@pytest.mark.parametrize(("period", "offset"), [(None, 0.0), (0.2, 0.1), (0.7, 0.3)])
def test_fusion_never_claims_more(busy: Scene, period: float | None, offset: float) -> None:
    own = replace(busy.sensors[1], scan_period=period, scan_offset=offset)
    scene = replace(busy, sensors=(busy.sensors[0], own))
    memory, world = TrueMemory(World(scene)), World(scene)
    fusion = AreaFusion([planar_sensor(sensor) for sensor in scene.sensors], fusion_settings(scene))
    feeds = [
        SensorFeed(make_device(sensor, world, 0), scene.scan_period(sensor), 0) for sensor in scene.sensors
    ]
    for number in range(20):
        for feed in feeds:
            for scan in feed.arrivals(0.5 * number):
                fusion.add_scan(feed.device.sensor.id, scan)
        claimed = fusion.area(0.5 * number).region
        excess = claimed.difference(memory.region(number))
        assert excess.buffer(-0.005).is_empty, number
        assert number == 0 or claimed.area > 0.85 * memory.region(number).area


def test_where_nothing_moves_the_area_is_one(room: Scene) -> None:
    standing = replace(WALKERS[0], waypoints=(), speed=0.0, loop=False, start=(3.0, 1.0))
    scene = replace(room, movers=(standing,))
    points, times = np.array([[3.0, 2.0], [3.0, 1.1], [2.0, 2.0]]), np.array([0.0, 0.33, 7.0])
    values, exact = GroundTruth(scene).area_clearance(points, times)
    assert exact.all()
    assert values[0] == pytest.approx(0.7, abs=1e-3)
    assert values[1] < 0.0
    assert values[2] == pytest.approx(math.sqrt(2.0) - 0.3, abs=1e-3)
