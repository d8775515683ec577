"""The unoccupied area holds nothing that a sensor measured as occupied, nor what could have been reached unseen."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from snnav_core.area.fusion import AreaFusion, FusionSettings, PlanarSensor
from snnav_core.area.planar import UnoccupiedArea
from snnav_core.errors import InvalidInput, ScanError
from snnav_core.sensing.scan import PlanarScan, ScanSettings, detect_planar
from snnav_core.types import FloatArray, Pose2D

ROOM = shapely.box(0.0, 0.0, 12.0, 9.0)
BEAMS = 360
POSES = (Pose2D(0.5, 0.5, 0.3), Pose2D(11.0, 8.0, -2.0), Pose2D(6.0, 8.5, 1.0))

seeds = st.integers(0, 2**32 - 1)


def ranges_in(free: shapely.Polygon, pose: Pose2D, beams: int = BEAMS) -> FloatArray:
    """Return the exact distances to the boundary of the free space along all beams of a full turn."""
    rings = [shapely.get_coordinates(ring) for ring in shapely.get_rings(free)]
    starts = np.concatenate([ring[:-1] for ring in rings]) - pose.position
    edges = np.concatenate([np.diff(ring, axis=0) for ring in rings])
    angle = pose.heading + 2.0 * math.pi / beams * np.arange(beams)
    ray = np.column_stack((np.cos(angle), np.sin(angle)))[:, None]
    cross = ray[..., 0] * edges[:, 1] - ray[..., 1] * edges[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        along = (starts[:, 0] * edges[:, 1] - starts[:, 1] * edges[:, 0]) / cross
        share = (starts[:, 0] * ray[..., 1] - starts[:, 1] * ray[..., 0]) / cross
    hit = (along > 0.0) & (share >= 0.0) & (share <= 1.0)
    return np.where(hit, along, np.inf).min(axis=1)


def scan(ranges: FloatArray, stamp: float = 0.0) -> PlanarScan:
    return PlanarScan(stamp, ranges, 0.0, 2.0 * math.pi / len(ranges), 0.05, 30.0)


def network(count: int, **changes: Any) -> AreaFusion:
    sensors = [PlanarSensor(f"s{index}", pose) for index, pose in enumerate(POSES[:count])]
    return AreaFusion(sensors, FusionSettings(**changes))


def measure(fusion: AreaFusion, free: shapely.Polygon, stamp: float = 0.0) -> UnoccupiedArea:
    for sensor in fusion.sensors.values():
        fusion.add_scan(sensor.id, scan(ranges_in(free, sensor.pose), stamp))
    return fusion.area(stamp)


def random_room(generator: np.random.Generator) -> shapely.Polygon:
    """Return the room without some boxes and a disk, all sensors free."""
    corners = generator.uniform((1.5, 1.5), (9.0, 6.0), (4, 2))
    boxes = [shapely.box(*corner, *(corner + generator.uniform(0.05, 2.0, 2))) for corner in corners]
    disk = shapely.Point(generator.uniform((2.0, 2.0), (10.0, 7.0))).buffer(0.4)
    room = shapely.difference(ROOM, shapely.union_all([*boxes, disk]))
    return max(shapely.get_parts(room), key=shapely.area)


def all_returns(fusion: AreaFusion) -> FloatArray:
    return np.concatenate([part.returns for _, part in fusion._latest.values()])


def depth(area: UnoccupiedArea, points: FloatArray) -> float:
    """Return how deep inside the area the deepest of some points lies [m]."""
    return float(area.clearance(points).max(initial=-math.inf))


@settings(max_examples=25)
@given(seeds, st.sampled_from((0.0, 0.005, 0.05)), st.sampled_from((0.0, 0.02)), st.booleans())
def test_no_return_of_any_sensor_lies_inside_the_area(
    seed: int, noise: float, turned: float, memory: bool
) -> None:
    """Neither with noise and wrongly surveyed poses, nor in what is remembered."""
    generator = np.random.default_rng(seed)
    fusion = network(3, boundary_speed=0.3 if memory else 0.0)
    plain = []
    for step in range(3):
        free, plain = random_room(generator), []
        for sensor in fusion.sensors.values():
            true_pose = Pose2D(
                sensor.pose.x, sensor.pose.y, sensor.pose.heading + generator.normal(0.0, turned)
            )
            ranges = ranges_in(free, true_pose) + generator.normal(0.0, noise, BEAMS)
            ranges[generator.uniform(size=BEAMS) < 0.05] = np.nan
            plain.append(fusion.add_scan(sensor.id, scan(ranges, 0.5 * step)).polygon)
        area = fusion.area(0.5 * step)
        assert area.region.is_valid
        assert depth(area, all_returns(fusion)) <= fusion.settings.return_tolerance + 1e-9
    if not memory:
        outside = shapely.difference(area.region, shapely.union_all(plain))
        assert outside.area < 1e-9, "never more than the plain union of what the sensors saw"


@given(seeds, st.sampled_from((0.0, 0.1, 0.6)))
def test_without_noise_the_area_is_free_but_for_the_gaps_between_beams(seed: int, lost: float) -> None:
    """Lost beams free nothing: what is beside them is not seen."""
    generator = np.random.default_rng(seed)
    free, fusion = random_room(generator), network(3)
    parts = []
    for sensor in fusion.sensors.values():
        ranges = ranges_in(free, sensor.pose)
        ranges[generator.uniform(size=BEAMS) < lost] = np.nan
        parts.append(fusion.add_scan(sensor.id, scan(ranges)).polygon)
    area = fusion.area(0.0)
    occupied = shapely.difference(ROOM, free)
    overlap = shapely.intersection(area.region, occupied)
    deepest = shapely.distance(shapely.points(shapely.get_coordinates(overlap)), occupied.boundary)
    # A corner or an arc between two beams of 1 degree, at up to 12 m.
    assert deepest.max(initial=0.0) < 0.11
    assert shapely.difference(area.region, shapely.union_all(parts)).area < 1e-7


def test_a_sensor_that_shows_nothing_counts_as_none() -> None:
    free = random_room(np.random.default_rng(3))
    fusion = network(3)
    measure(fusion, free)
    fusion.add_scan("s2", scan(np.full(BEAMS, np.nan), 0.1))
    assert shapely.equals(fusion.area(0.1).region, measure(network(2), free).region)


def test_what_one_sensor_looks_through_is_an_obstacle_for_all_and_counted() -> None:
    """A pane of glass in the middle of the room: only the first sensor measures it."""
    pane = shapely.box(5.0, 3.0, 5.01, 6.0)
    fusion = network(2)
    fusion.add_scan("s0", scan(ranges_in(shapely.difference(ROOM, pane), POSES[0])))
    fusion.add_scan("s1", scan(ranges_in(ROOM, POSES[1])))
    area = fusion.area(0.0)
    on_pane = fusion._latest["s0"][1].returns
    on_pane = on_pane[(np.abs(on_pane[:, 0] - 5.0) < 0.02) & (on_pane[:, 1] > 2.9) & (on_pane[:, 1] < 6.1)]
    assert len(on_pane) > 10
    assert depth(area, on_pane) <= fusion.settings.return_tolerance
    assert area.contradictions["s0"] == len(on_pane)
    assert area.contradictions["s1"] == 0


def test_a_wall_that_two_sensors_place_5_cm_apart_is_at_the_nearer_place() -> None:
    fusion = network(2)
    fusion.add_scan("s0", scan(ranges_in(ROOM, POSES[0])))
    fusion.add_scan("s1", scan(ranges_in(shapely.box(0.05, 0.05, 12.0, 9.0), POSES[1])))
    area = fusion.area(0.0)
    assert area.contradictions["s0"] == 0
    assert area.contradictions["s1"] < 0.05 * BEAMS, "no more than some at grazing incidence"
    assert depth(area, all_returns(fusion)) <= fusion.settings.return_tolerance


@pytest.mark.parametrize("speed", [0.3, 0.6])
def test_a_body_that_walks_by_is_never_declared_free_nor_one_that_hides_behind_it(speed: float) -> None:
    """A second body keeps to the shadow of the first, as fast as the bound allows."""
    fusion = network(1, boundary_speed=0.6)
    sensor, beams, interval = POSES[0], 1440, 0.5
    hidden, least_shadow = np.array([9.0, 1.6]), math.inf
    for step in range(24):
        time = step * interval
        walker = np.array([3.0, 0.8 + speed * time])
        behind = sensor.position + (walker - sensor.position) * 2.2
        move = behind - hidden
        hidden = hidden + move * min(1.0, 0.6 * interval / max(float(np.linalg.norm(move)), 1e-12))
        bodies = [
            shapely.Point(walker).buffer(0.35, quad_segs=64),
            shapely.Point(hidden).buffer(0.2, quad_segs=64),
        ]
        free = shapely.difference(ROOM, shapely.union_all(bodies))
        fusion.add_scan("s0", scan(ranges_in(free, sensor, beams), time))
        area = fusion.area(time)
        for body in bodies:
            # Chords between beams cut into a round body by a few millimetres.
            assert depth(area, shapely.get_coordinates(body.buffer(-0.01))) <= 0.0, f"at {time} s"
        least_shadow = min(least_shadow, ROOM.area - area.region.area)
    assert least_shadow > math.pi * (0.35**2 + 0.2**2) / 2.0


@settings(max_examples=15)
@given(seeds, st.sampled_from((0.1, 0.5)), st.sampled_from((0.2, 1.0)))
def test_memory_keeps_what_was_free_and_out_of_reach_and_no_more(
    seed: int, speed: float, interval: float
) -> None:
    generator = np.random.default_rng(seed)
    fusion = network(2, boundary_speed=speed)
    last = measure(fusion, random_room(generator), 0.0)
    for step in (1, 2, 3):
        area = measure(fusion, random_room(generator), step * interval)
        seen = network(2)
        for sensor_id, (one, _) in fusion._latest.items():
            seen.add_scan(sensor_id, one)
        now = seen.area(step * interval).region
        points = shapely.get_coordinates(shapely.segmentize(area.region, 0.1))
        remembered = points[shapely.distance(shapely.points(points), now) > 1e-6]
        # Free now although not seen: no body could have come there since the last step.
        assert (last.clearance(remembered) >= speed * interval - 1e-6).all()
        out_of_reach = last.region.buffer(-1.03 * speed * interval - 1e-6)
        lost = shapely.difference(out_of_reach, area.region)
        # But for this step's returns, which are obstacles wherever they are, and crumbs around them.
        lost = shapely.difference(lost, shapely.multipoints(all_returns(fusion)).buffer(0.011))
        assert all(part.area <= fusion.settings.least_part for part in shapely.get_parts(lost))
        last = area


def test_without_memory_only_what_is_seen_is_free() -> None:
    fusion = network(1, boundary_speed=0.5, memory=False)
    measure(fusion, ROOM, 0.0)
    free = shapely.difference(ROOM, shapely.box(2.0, 2.0, 3.0, 3.0))
    area = measure(fusion, free, 0.5)
    assert shapely.equals(area.region, measure(network(1), free).region)


def test_an_old_scan_counts_less_the_farther_something_may_have_come() -> None:
    fusion = network(1, boundary_speed=0.5, memory=False, max_scan_age=2.0)
    fresh = measure(fusion, ROOM, 0.0)
    for age in (0.2, 1.0, 2.0):
        area = fusion.area(age)
        points = shapely.get_coordinates(area.region)
        assert fresh.clearance(points).min() >= 0.5 * age - 1e-9
        assert area.stamp == age
    assert fusion.area(2.1).is_empty


def test_a_sensor_that_went_silent_is_named_and_shows_nothing() -> None:
    fusion = network(2)
    measure(fusion, ROOM, 0.0)
    fusion.add_scan("s0", scan(ranges_in(ROOM, POSES[0]), 1.5))
    assert fusion.silent_sensors(1.5) == ["s1"]
    assert shapely.equals(fusion.area(1.5).region, measure(network(1), ROOM).region)
    assert fusion.latest_stamp("s1") == 0.0
    assert fusion.silent_sensors(9.0) == ["s0", "s1"]
    silent = fusion.area(9.0)
    assert silent.is_empty
    assert (silent.stamp, dict(silent.contradictions)) == (9.0, {})
    fusion.add_scan("s1", scan(ranges_in(ROOM, POSES[1]), 9.0))
    assert not fusion.area(9.0).is_empty, "and is taken again when it comes back"


def test_a_scan_from_the_future_shows_nothing_yet() -> None:
    fusion = network(1)
    fusion.add_scan("s0", scan(ranges_in(ROOM, POSES[0]), 5.0))
    assert fusion.area(4.0).is_empty
    assert fusion.silent_sensors(4.0) == ["s0"]
    assert not fusion.area(5.0).is_empty


@pytest.mark.parametrize("value", [np.nan, 0.0, 99.0, np.inf])
def test_no_scan_and_a_scan_that_shows_nothing_give_the_empty_area(value: float) -> None:
    fusion = network(2)
    assert fusion.area(0.0).is_empty
    assert fusion.latest_stamp("s0") is None
    assert fusion.silent_sensors(0.0) == ["s0", "s1"]
    for sensor_id in ("s0", "s1"):
        fusion.add_scan(sensor_id, scan(np.full(BEAMS, value)))
    area = fusion.area(0.0)
    assert area.is_empty
    assert area.contradictions == {"s0": 0, "s1": 0}


def test_an_unknown_sensor_an_older_scan_and_one_with_wrong_beams_are_refused_and_change_nothing() -> None:
    fusion = AreaFusion([PlanarSensor("s0", POSES[0], ScanSettings(expected_beams=BEAMS))])
    ranges = ranges_in(ROOM, POSES[0])
    fusion.add_scan("s0", scan(ranges, 1.0))
    before = fusion.area(1.0)
    with pytest.raises(InvalidInput, match=r"unknown sensor 'lms'; known: \['s0'\]"):
        fusion.add_scan("lms", scan(ranges, 1.0))
    with pytest.raises(InvalidInput, match=r"0\.900 s is older than its last \(1\.000 s\)"):
        fusion.add_scan("s0", scan(0.5 * ranges, 0.9))
    with pytest.raises(ScanError, match="expected 360"):
        fusion.add_scan("s0", scan(ranges[:100], 1.1))
    assert fusion.latest_stamp("s0") == 1.0
    assert shapely.equals(fusion.area(1.0).region, before.region)


def test_time_that_runs_backwards_is_refused_until_reset() -> None:
    fusion = network(1, boundary_speed=0.5)
    measure(fusion, ROOM, 5.0)
    with pytest.raises(InvalidInput, match="reset"):
        fusion.area(4.9)
    fusion.reset()
    assert fusion.area(1.0).is_empty
    free = shapely.difference(ROOM, shapely.box(2.0, 2.0, 3.0, 3.0))
    area = measure(fusion, free, 1.0)
    assert shapely.equals(area.region, measure(network(1), free).region), "nothing is remembered"


def test_the_same_ranges_again_cost_nothing() -> None:
    fusion = network(2)
    first = measure(fusion, ROOM, 0.0)
    again = measure(fusion, ROOM, 0.7)
    assert again.stamp == 0.7
    assert again.clearance_field is first.clearance_field
    assert again.rings is first.rings
    moved = shapely.box(0.0, 0.0, 11.5, 9.0)
    assert measure(fusion, moved, 1.0).clearance_field is not first.clearance_field


@given(seeds)
def test_a_single_sensor_agrees_with_itself(seed: int) -> None:
    """Its own returns lie on its outline; by rounding they once took up to 1.4 m2 of a scan."""
    fusion = network(1, simplification=0.0, least_part=0.0)
    area = measure(fusion, random_room(np.random.default_rng(seed)))
    assert shapely.symmetric_difference(area.region, fusion._latest["s0"][1].polygon).area < 1e-6


def test_the_order_of_arrival_does_not_matter() -> None:
    free = random_room(np.random.default_rng(5))
    scans = {f"s{index}": scan(ranges_in(free, pose)) for index, pose in enumerate(POSES)}
    areas = []
    for order in (("s0", "s1", "s2"), ("s2", "s0", "s1")):
        fusion = network(3)
        for sensor_id in order:
            fusion.add_scan(sensor_id, scans[sensor_id])
        areas.append(fusion.area(0.0))
    for first, second in zip(areas[0].rings, areas[1].rings, strict=True):
        np.testing.assert_array_equal(first, second)


def test_a_scan_is_detected_as_by_the_sensing_floor() -> None:
    one = scan(ranges_in(ROOM, POSES[1]))
    accuracy = ScanSettings(range_accuracy=0.05)
    fusion = AreaFusion([PlanarSensor("s", POSES[1], accuracy)])
    detected = fusion.add_scan("s", one)
    expected = detect_planar("s", one, POSES[1], accuracy)
    for first, second in zip(detected.rings, expected.rings, strict=True):
        np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize("sensors", [[], [PlanarSensor("a", POSES[0]), PlanarSensor("a", POSES[1])]])
def test_a_network_needs_sensors_with_different_names(sensors: Sequence[PlanarSensor]) -> None:
    with pytest.raises(InvalidInput, match="need at least one, and different ids"):
        AreaFusion(sensors)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("boundary_speed", -0.1),
        ("return_tolerance", math.nan),
        ("shorten_depth", math.inf),
        ("simplification", -1.0),
        ("least_part", -1.0),
        ("contradiction_depth", math.nan),
        ("max_scan_age", 0.0),
        ("return_radius", 0.0),
    ],
)
def test_settings_out_of_range_are_refused(name: str, value: float) -> None:
    with pytest.raises(InvalidInput, match=f"{name} is {value}"):
        FusionSettings(**{name: value})
