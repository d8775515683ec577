"""A planar scan becomes exactly the area that it shows to be free, never more."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from snnav_core.errors import InvalidInput, ScanError
from snnav_core.sensing.scan import (
    LMS200_ERROR_CODES,
    DetectedArea,
    PlanarScan,
    ScanSettings,
    detect_planar,
)
from snnav_core.sensing.star import star_rings
from snnav_core.types import FloatArray, Pose2D

RANGE_MAX = 30.0
BAD_VALUES = (math.nan, 0.0, -1.0, math.inf, -math.inf, 0.01, 31.0, *LMS200_ERROR_CODES)
SETTINGS = ScanSettings(error_codes=LMS200_ERROR_CODES)
ORIGIN = Pose2D(0.0, 0.0, 0.0)


def scan_of(ranges: Any, angle_min: float, increment: float, stamp: float = 0.0) -> PlanarScan:
    return PlanarScan(stamp, np.asarray(ranges, dtype=float), angle_min, increment, 0.05, RANGE_MAX)


def full_circle(ranges: Any) -> PlanarScan:
    return scan_of(ranges, -math.pi, 2.0 * math.pi / len(ranges))


def detect(scan: PlanarScan, settings: ScanSettings = SETTINGS, pose: Pose2D = ORIGIN) -> DetectedArea:
    return detect_planar("lms", scan, pose, settings)


def chord_polygon(area: DetectedArea) -> Any:
    """The outline by chords only: with fewer beams fewer corners are known, but no chord moves outwards."""
    rings = star_rings(area.fan, area.pose, corners=False)
    return shapely.union_all([shapely.Polygon(ring) for ring in rings])


@st.composite
def scans(draw: st.DrawFn, bad: bool = True) -> PlanarScan:
    """Scans of any beam count and field: smooth stretches, jumps, and values that are no distances."""
    beams = draw(st.integers(2, 60))
    field = draw(st.sampled_from(("sector", "closed", "closed with the first beam twice", "any")))
    increment = {
        "sector": min(math.pi, 0.5 * math.pi * (beams - 1)) / (beams - 1),
        "closed": 2.0 * math.pi / beams,
        "closed with the first beam twice": 2.0 * math.pi / (beams - 1),
        "any": draw(st.floats(1e-3, 2.0 * math.pi / max(beams - 2, 1))),
    }[field]
    increment = min(increment, 0.5 * math.pi) * draw(st.sampled_from((1.0, -1.0)))
    values = st.one_of(st.floats(0.05, RANGE_MAX), st.floats(4.9, 5.1), st.just(5.0))
    if bad:
        values = st.one_of(values, st.sampled_from(BAD_VALUES))
    ranges = draw(st.lists(values, min_size=beams, max_size=beams))
    return scan_of(ranges, draw(st.floats(-4.0, 4.0)), increment)


poses = st.builds(Pose2D, st.floats(-100.0, 100.0), st.floats(-100.0, 100.0), st.floats(-4.0, 4.0))


@given(scans(), poses)
def test_rings_are_simple_counter_clockwise_and_the_polygon_is_valid(scan: PlanarScan, pose: Pose2D) -> None:
    area = detect(scan, pose=pose)
    assert area.polygon.is_valid
    for ring in area.rings:
        closed = shapely.LinearRing(ring)
        assert closed.is_simple
        assert closed.is_ccw
        assert not np.array_equal(ring[0], ring[-1]), "rings are open"
        assert (np.abs(np.diff(ring, axis=0)).max(axis=1) > 0.0).all(), "no repeated points"


@given(scans(), st.sampled_from((0.0, 0.02)), st.integers(0, 2**32 - 1))
def test_no_point_is_farther_than_the_beams_beside_it_allow(
    scan: PlanarScan, accuracy: float, seed: int
) -> None:
    settings = ScanSettings(error_codes=LMS200_ERROR_CODES, range_accuracy=accuracy)
    polygon = detect(scan, settings).polygon
    generator = np.random.default_rng(seed)
    angles, distances = generator.uniform(-math.pi, math.pi, 200), RANGE_MAX * generator.random(200)
    points = distances[:, None] * np.column_stack((np.cos(angles), np.sin(angles)))
    free = shapely.covers(polygon, shapely.points(points))
    for angle, distance in zip(angles[free].tolist(), distances[free].tolist(), strict=True):
        assert distance <= limit_at(scan, angle, accuracy) + 1e-9


def limit_at(scan: PlanarScan, angle: float, accuracy: float) -> float:
    """Return the longest free length that the wedge rule grants in a direction, written beam by beam."""
    increment = abs(scan.angle_increment)
    behind: list[tuple[float, float]] = []
    ahead: list[tuple[float, float]] = []
    for direction, distance in zip(scan.angles, scan.ranges, strict=True):
        good = scan.range_min <= distance <= scan.range_max and distance > 0.0
        good = good and all(abs(distance - code) > 0.0005 for code in LMS200_ERROR_CODES)
        free = max(distance - accuracy, 0.0) if good else 0.0
        offset = math.remainder(direction - angle, 2.0 * math.pi)
        if -1.5 * increment <= offset <= 1e-9:
            behind.append((-offset, free))
        if -1e-9 <= offset <= 1.5 * increment:
            ahead.append((offset, free))
    if not behind or not ahead:
        return 0.0
    right, left = min(behind)[1], min(ahead)[1]
    shorter = min(left, right)
    if shorter <= 0.0:
        return 0.0
    jump = abs(left - right) > 5.0 * shorter * increment + 0.03
    return shorter if jump else max(left, right)


@given(scans())
def test_returns_are_never_inside_the_own_polygon(scan: PlanarScan) -> None:
    area = detect(scan)
    returns = shapely.points(area.returns)
    inside = shapely.contains(area.polygon, returns)
    depth = shapely.distance(returns, area.polygon.boundary)
    assert (depth[inside] <= 1e-9).all()
    assert len(area.returns) == len(area.return_beam) == area.counts.returned
    assert_allclose(np.linalg.norm(area.returns, axis=1), scan.ranges[area.return_beam], rtol=1e-12)


@given(scans(), st.data())
def test_bad_values_never_add_free_space(scan: PlanarScan, data: st.DataObject) -> None:
    broken = np.array(scan.ranges)
    chosen = data.draw(st.lists(st.integers(0, broken.size - 1), min_size=1, max_size=4))
    for beam in chosen:
        broken[beam] = data.draw(st.sampled_from(BAD_VALUES))
    less = detect(scan_of(broken, scan.angle_min, scan.angle_increment)).polygon
    assert less.difference(chord_polygon(detect(scan))).area <= 1e-9
    assert detect(scan).polygon.difference(chord_polygon(detect(scan))).area <= 1e-9


@given(scans())
def test_accuracy_only_takes_free_space_away_where_no_jump_rule_changes(scan: PlanarScan) -> None:
    plain = detect(scan, ScanSettings(error_codes=LMS200_ERROR_CODES, jump_ratio=0.0, jump_distance=1e3))
    short = detect(
        scan,
        ScanSettings(error_codes=LMS200_ERROR_CODES, range_accuracy=0.1, jump_ratio=0.0, jump_distance=1e3),
    )
    assert short.polygon.difference(chord_polygon(plain)).area <= 1e-9
    assert_allclose(short.returns, plain.returns, err_msg="returns stay where they were measured")


def hits(angles: FloatArray, segments: FloatArray) -> FloatArray:
    """Return where rays from the origin hit segments (S, 2, 2): distances, shape (B, S), inf for a miss."""
    rays = np.column_stack((np.cos(angles), np.sin(angles)))[:, None]
    start, along = segments[None, :, 0], (segments[:, 1] - segments[:, 0])[None]
    scale = rays[..., 0] * along[..., 1] - rays[..., 1] * along[..., 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = (start[..., 0] * along[..., 1] - start[..., 1] * along[..., 0]) / scale
        part = (start[..., 0] * rays[..., 1] - start[..., 1] * rays[..., 0]) / scale
    return np.where((distance > 0.0) & (part >= 0.0) & (part <= 1.0), distance, np.inf)


@given(st.integers(0, 2**32 - 1), st.sampled_from((60, 180, 361)), st.integers(1, 12))
def test_free_points_are_visible_unless_an_obstacle_ends_between_two_beams(
    seed: int, beams: int, count: int
) -> None:
    """The gap bound (C3-7): what hides a free point has an end inside one wedge, so it is no wider there."""
    generator = np.random.default_rng(seed)
    walls = np.array(((-9, -9), (9, -9), (9, 9), (-9, 9)), dtype=float)
    segments = np.concatenate(
        (np.stack((walls, np.roll(walls, -1, axis=0)), axis=1), generator.uniform(-8.0, 8.0, (count, 2, 2)))
    )
    increment = 2.0 * math.pi / beams
    angles = -math.pi + increment * np.arange(beams)
    scan = scan_of(hits(angles, segments).min(axis=1), -math.pi, increment)
    bearing = generator.uniform(-math.pi, math.pi, 300)
    distance = 1.5 * generator.random(300) * hits(bearing, segments).min(axis=1)
    points = distance[:, None] * np.column_stack((np.cos(bearing), np.sin(bearing)))
    free = shapely.contains(detect(scan).polygon, shapely.points(points))
    assert free.any()
    bearing, distance = bearing[free], distance[free]
    in_front = hits(bearing, segments) < distance[:, None] - 1e-9
    wedge = np.floor((bearing + math.pi) / increment)
    ends_in = np.floor((np.arctan2(segments[..., 1], segments[..., 0]) + math.pi) / increment)
    for point, segment in np.argwhere(in_front):
        assert wedge[point] in ends_in[segment], "an obstacle that spans the wedge was missed"


@pytest.mark.parametrize(
    ("value", "name", "free"),
    [
        (2.0, "returned", True),
        (math.nan, "not_a_number", False),
        (0.0, "not_positive", False),
        (-0.5, "not_positive", False),
        (0.04, "too_close", False),
        (-math.inf, "too_close", False),
        (RANGE_MAX + 0.01, "beyond_max", False),
        (math.inf, "infinite_unknown", False),
        (16.375, "error_code", False),
        (float(np.float32(16.379)), "error_code", False),
        (16.3834, "error_code", False),
        (16.39, "returned", True),
    ],
)
def test_every_class_of_range_is_counted_and_only_distances_are_free(
    value: float, name: str, free: bool
) -> None:
    area = detect(full_circle(np.full(8, value)))
    assert getattr(area.counts, name) == 8
    assert sum(getattr(area.counts, field) for field in area.counts.__slots__) == 8
    assert area.polygon.is_empty != free
    assert len(area.returns) == (8 if name == "returned" else 0)


def test_infinity_is_free_up_to_the_maximum_only_where_told_so() -> None:
    area = detect(full_circle(np.full(360, math.inf)), ScanSettings(inf_is_free=True, range_accuracy=0.5))
    assert area.counts.infinite_free == 360
    assert len(area.returns) == 0
    assert_allclose(np.linalg.norm(area.rings[0], axis=1), RANGE_MAX - 0.5)


def test_a_cut_makes_far_readings_free_up_to_it_but_their_surfaces_stay_obstacles() -> None:
    ranges = np.array([3.0, 8.0, 8.01, 29.0, 4.0, 31.0, math.inf, 5.0])
    area = detect(full_circle(ranges), ScanSettings(range_cut=8.0, inf_is_free=True))
    assert (area.counts.returned, area.counts.cut, area.counts.infinite_free) == (4, 2, 1)
    assert area.counts.beyond_max == 1, "beyond range_max stays unknown"
    assert area.return_beam.tolist() == [0, 1, 2, 3, 4, 7]
    assert np.linalg.norm(shapely.get_coordinates(area.polygon), axis=1).max() <= 8.0 + 1e-12


@pytest.mark.parametrize("beams", [180, 360, 720, 1440])
@pytest.mark.parametrize("repeated", [False, True])
def test_a_full_circle_is_one_ring_without_the_sensor(beams: int, repeated: bool) -> None:
    increment = 2.0 * math.pi / beams
    scan = scan_of(np.full(beams + repeated, 2.0), 0.3, increment)
    (ring,) = detect(scan, pose=Pose2D(5.0, -3.0, 1.0)).rings
    assert len(ring) == beams
    assert_allclose(np.linalg.norm(ring - (5.0, -3.0), axis=1), 2.0)
    assert_allclose(shapely.Polygon(ring).area, 0.5 * beams * 4.0 * math.sin(increment))


@pytest.mark.parametrize(("beams", "degrees"), [(180, 1.0), (181, 1.0), (361, 0.5), (541, 0.5), (1081, 0.25)])
def test_a_sector_starts_at_the_sensor(beams: int, degrees: float) -> None:
    increment = math.radians(degrees)
    scan = PlanarScan(0.0, np.full(beams, math.inf), -1.0, increment, 0.05, 3.0)
    (ring,) = detect(scan, ScanSettings(inf_is_free=True), Pose2D(1.0, 2.0, 0.0)).rings
    assert ring[0].tolist() == [1.0, 2.0]
    assert len(ring) == beams + 1
    assert_allclose(shapely.Polygon(ring).area, 0.5 * (beams - 1) * 9.0 * math.sin(increment))


def test_an_increment_rounded_to_single_precision_still_closes_the_circle() -> None:
    increment = float(np.float32(2.0 * math.pi / 1439))
    for scale in (1.0, 1.0 - 1e-6, 1.0 + 1e-6):
        area = detect(scan_of(np.full(1440, 4.0), -math.pi, increment * scale))
        assert len(area.rings) == 1
        assert area.polygon.is_valid
        assert area.polygon.contains(shapely.Point(0.0, 0.0))


def test_the_repeated_first_beam_counts_with_its_shorter_value() -> None:
    ranges = np.full(361, 5.0)
    ranges[360] = 2.0
    area = detect(scan_of(ranges, 0.0, math.radians(1.0)))
    assert not area.polygon.covers(shapely.Point(2.1, 0.0))
    ranges[360] = math.nan
    area = detect(scan_of(ranges, 0.0, math.radians(1.0)))
    assert not area.polygon.covers(shapely.Point(1.0, 0.0))


def test_unknown_beams_split_the_area_into_runs_that_meet_at_the_sensor() -> None:
    ranges = np.full(360, math.inf)
    ranges[[10, 200, 201]] = math.nan
    area = detect(full_circle(ranges), ScanSettings(inf_is_free=True))
    assert [len(ring) for ring in area.rings] == [1 + 189, 1 + 168]
    assert all(ring[0].tolist() == [0.0, 0.0] for ring in area.rings)
    assert isinstance(area.polygon, shapely.MultiPolygon)


def test_a_single_beam_between_unknown_ones_encloses_nothing_but_keeps_its_return() -> None:
    area = detect(scan_of([math.nan, 5.0, math.nan], 0.0, 0.1))
    assert area.rings == ()
    assert area.polygon.is_empty
    assert_allclose(area.returns, [[5.0 * math.cos(0.1), 5.0 * math.sin(0.1)]])


def test_a_jump_ends_at_the_shorter_beam_and_a_slope_at_the_chord() -> None:
    jump = detect(scan_of([2.0, 2.0, 6.0, 6.0], 0.0, 0.01))
    (ring,) = star_rings(jump.fan, ORIGIN, corners=False)
    assert_allclose(np.linalg.norm(ring, axis=1), [0.0, 2.0, 2.0, 2.0, 6.0, 6.0])
    slope = detect(scan_of([2.0, 2.1, 2.2, 2.3], 0.0, 0.01))
    (ring,) = star_rings(slope.fan, ORIGIN, corners=False)
    assert_allclose(np.linalg.norm(ring, axis=1), [0.0, 2.0, 2.1, 2.2, 2.3])


@given(scans(), poses)
def test_a_device_that_turns_the_other_way_sees_the_same(scan: PlanarScan, pose: Pose2D) -> None:
    last = scan.angle_min + (scan.ranges.size - 1) * scan.angle_increment
    turned = scan_of(scan.ranges[::-1], last, -scan.angle_increment)
    open_field = (scan.ranges.size + 0.6) * abs(scan.angle_increment) < 2.0 * math.pi
    if open_field:  # past a full turn the first beams of either direction are kept
        first, second = detect(scan, pose=pose), detect(turned, pose=pose)
        assert first.polygon.symmetric_difference(second.polygon).area <= 1e-6
        assert first.counts == second.counts


def test_the_pose_moves_the_area() -> None:
    scan = scan_of(np.linspace(2.0, 3.0, 50), -1.0, 0.04)
    pose = Pose2D(10.0, -4.0, 2.0)
    cos, sin = math.cos(pose.heading), math.sin(pose.heading)
    for here, there in (
        (detect(scan).rings[0], detect(scan, pose=pose).rings[0]),
        (detect(scan).returns, detect(scan, pose=pose).returns),
    ):
        assert_allclose(here @ np.array(((cos, sin), (-sin, cos))) + pose.position, there, atol=1e-12)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"ranges": np.ones((3, 3))}, r"shape \(3, 3\)"),
        ({"ranges": np.ones(1)}, r"shape \(1,\)"),
        ({"stamp": math.nan}, "stamp is nan"),
        ({"angle_min": math.inf}, "angle_min is inf"),
        ({"angle_increment": 0.0}, "angle_increment is 0.0"),
        ({"angle_increment": 0.5 * 180.0 / math.pi}, "radians, not degrees"),
        ({"angle_increment": 0.02}, "401 beams at angle_increment 0.02"),
        ({"range_min": -0.1}, "range_min -0.1"),
        ({"range_max": 0.0}, "range_max 0.0"),
        ({"range_max": math.nan}, "range_max is nan"),
    ],
)
def test_unusable_scans_are_refused_with_the_value(change: dict[str, Any], message: str) -> None:
    good = {
        "stamp": 0.0,
        "ranges": np.ones(401),
        "angle_min": 0.0,
        "angle_increment": 0.01,
        "range_min": 0.0,
        "range_max": 9.0,
    }
    with pytest.raises(ScanError, match=message):
        PlanarScan(**(good | change))


def test_another_beam_count_than_expected_names_sensor_and_counts() -> None:
    with pytest.raises(ScanError, match="sensor 'lms': scan has 360 beams, expected 361"):
        detect(full_circle(np.ones(360)), ScanSettings(expected_beams=361))


def test_a_pose_that_is_not_finite_is_refused() -> None:
    with pytest.raises(InvalidInput, match="must be finite"):
        detect(full_circle(np.ones(360)), pose=Pose2D(math.nan, 0.0, 0.0))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"range_accuracy": -0.01}, "range_accuracy is -0.01"),
        ({"jump_ratio": math.nan}, "jump_ratio is nan"),
        ({"jump_distance": math.inf}, "jump_distance is inf"),
        ({"range_cut": 0.0}, "range_cut is 0.0"),
        ({"expected_beams": 1}, "expected_beams is 1"),
        ({"error_codes": (math.nan,)}, "error_codes are"),
    ],
)
def test_settings_out_of_range_are_refused(change: dict[str, Any], message: str) -> None:
    with pytest.raises(InvalidInput, match=message):
        ScanSettings(**change)


def test_a_scan_keeps_its_own_ranges() -> None:
    ranges = np.ones(10)
    scan = scan_of(ranges, 0.0, 0.1)
    ranges[:] = 7.0
    assert scan.ranges.tolist() == [1.0] * 10
    assert not scan.ranges.flags.writeable


@pytest.mark.parametrize(("range_cut", "beyond"), [(None, np.inf), (8.0, 30.0)])
def test_a_beam_that_ends_free_goes_on_behind_no_surface(range_cut: float | None, beyond: float) -> None:
    """A corner just inside the range limit: the chord from the last return to the limit would cut it off."""
    angles = np.radians(np.arange(-10.0, 10.5, 0.5))
    ranges = np.where(angles > 0.0, beyond, 7.9)
    scan = PlanarScan(
        0.0, ranges, float(angles[0]), math.radians(0.5), 0.0, 8.0 if range_cut is None else 80.0
    )
    settings = ScanSettings(inf_is_free=True, range_cut=range_cut)
    part = detect_planar("a", scan, Pose2D(0.0, 0.0, 0.0), settings)
    between = math.radians(0.45)
    point = shapely.Point(7.95 * math.cos(between), 7.95 * math.sin(between))
    assert not part.polygon.buffer(-1e-3).intersects(point)
    behind = math.radians(1.0)
    assert part.polygon.buffer(1e-3).contains(shapely.Point(7.99 * math.cos(behind), 7.99 * math.sin(behind)))
