"""Scans count at their own stamps; one that lies about its time, or repeats itself, changes nothing."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from snnav_core.area.fusion import AreaFusion, FusionSettings, PlanarSensor
from snnav_core.area.planar import UnoccupiedArea
from snnav_core.errors import InvalidInput, ScanError
from snnav_core.sensing.scan import PlanarScan, ScanSettings
from snnav_core.types import FloatArray, Pose2D

BEAMS = 181
SPEED = 0.5
seeds = st.integers(0, 2**32 - 1)


def scan(stamp: float, length: float | FloatArray = 3.0, beams: int = BEAMS) -> PlanarScan:
    """Half a turn to the front, to a wall all round at one distance."""
    ranges = np.broadcast_to(np.asarray(length, dtype=np.float64), (beams,))
    return PlanarScan(stamp, ranges, -math.pi / 2, math.pi / (beams - 1), 0.0, 8.0)


def open_scan(stamp: float, length: float = 3.0) -> PlanarScan:
    """Half a turn to the front, with nothing up to the range."""
    return PlanarScan(stamp, np.full(BEAMS, np.inf), -math.pi / 2, math.pi / (BEAMS - 1), 0.0, length)


def fusion(count: int = 1, scans: ScanSettings | None = None, **changes: Any) -> AreaFusion:
    """Return scanners in a row 2 m apart that look the same way."""
    sensors = [
        PlanarSensor(
            f"s{index}", Pose2D(2.0 * index, 0.0, math.pi / 2), scans or ScanSettings(inf_is_free=True)
        )
        for index in range(count)
    ]
    return AreaFusion(sensors, FusionSettings(**{"boundary_speed": SPEED, "simplification": 0.0} | changes))


def seen_by(index: int, length: float = 3.0) -> shapely.Polygon:
    one = fusion(index + 1)
    return one.add_scan(f"s{index}", open_scan(0.0, length)).polygon


def reference(events: list[tuple[float, shapely.Geometry]], time: float) -> shapely.Geometry:
    """Return R[A united B] by plain buffers, events in the order of their stamps."""
    known, at = shapely.Polygon(), events[0][0]
    for stamp, seen in events:
        known, at = shapely.union(known.buffer(-SPEED * (stamp - at), quad_segs=64), seen), stamp
    return known.buffer(-SPEED * (time - at), quad_segs=64)


def assert_same(area: UnoccupiedArea, expected: shapely.Geometry, reach: float) -> None:
    """Never more than expected, but for 1 % that plain buffers are off; less only by what arcs lose to chords."""
    assert shapely.difference(area.region, expected.buffer(0.01 * reach + 1e-6)).area < 1e-6
    lost = shapely.difference(expected.buffer(-0.02 * reach - 1e-6), area.region)
    # what is left of a needle between two arcs is no part of the area that a robot could use
    assert shapely.buffer(lost, -1e-3).is_empty


@settings(max_examples=25)
@given(st.permutations((0, 1, 2)), st.lists(st.floats(0.01, 0.4), min_size=4, max_size=4))
def test_every_part_shrinks_for_its_own_age(order: list[int], gaps: list[float]) -> None:
    """Uniting parts before they shrink would trust that a stamp is not older than its measurement."""
    stamps = np.cumsum(gaps)
    one = fusion(3, max_scan_age=3.0)
    for stamp, index in zip(stamps, order, strict=False):
        one.add_scan(f"s{index}", open_scan(float(stamp)))
    time = float(stamps[-1])
    parts = [
        seen_by(index).buffer(-SPEED * (time - float(stamp)), quad_segs=64)
        for stamp, index in zip(stamps, order, strict=False)
    ]
    assert_same(one.area(time), shapely.union_all(parts), SPEED * (time - float(stamps[0])))


def test_a_scan_that_comes_late_counts_for_what_it_is_worth() -> None:
    one = fusion(2)
    one.add_scan("s0", open_scan(1.0), 1.0)
    before = one.area(1.0)
    one.add_scan("s1", open_scan(0.6), 1.2)
    area = one.area(1.3)
    late = seen_by(1).buffer(-SPEED * 0.7, quad_segs=64)
    expected = shapely.union(before.region.buffer(-SPEED * 0.3, quad_segs=64), late)
    assert_same(area, expected, 1.0)
    assert area.region.area > before.region.buffer(-SPEED * 0.3).area + 0.5


@pytest.mark.parametrize("count", [5, 9])
def test_many_stamps_are_put_together_on_the_safe_side(count: int) -> None:
    """Every part must have shrunk for its own age, whatever is put together."""
    one = fusion(count, max_scan_age=5.0)
    stamps = np.linspace(0.1, 1.3, count)
    for index, stamp in enumerate(stamps):
        one.add_scan(f"s{index}", open_scan(float(stamp)))
    area = one.area(1.5)
    events = [(float(stamp), seen_by(index)) for index, stamp in enumerate(stamps)]
    assert shapely.difference(area.region, reference(events, 1.5).buffer(1e-6)).area < 1e-6
    alone = shapely.union_all(
        [seen.buffer(-1.02 * SPEED * (1.5 - stamp) - 1e-6, quad_segs=64) for stamp, seen in events]
    )
    assert shapely.difference(alone, area.region).area < 1e-6


@pytest.mark.parametrize("memory", [True, False])
def test_a_sensor_that_stops_loses_its_part_at_the_speed_of_things_and_others_do_not(memory: bool) -> None:
    one = fusion(1, memory=memory, max_scan_age=1.0)
    one.add_scan("s0", scan(0.0))
    first = one.area(0.0)
    for time in (0.5, 1.0, 2.0, 2.9, 3.5):
        area = one.area(time)
        if not area.is_empty:
            assert first.clearance(shapely.get_coordinates(area.region)).min() >= SPEED * time - 1e-6
        gone = time > (2.99 if memory else 1.0)
        assert area.is_empty == gone, f"at {time} s"


def test_the_last_usable_scan_of_every_silent_sensor_is_told() -> None:
    for speed in (0.0, SPEED):
        one = fusion(3, boundary_speed=speed, max_scan_age=1.0)
        seen = one.add_scan("s0", scan(0.0)).polygon
        one.add_scan("s1", scan(1.0))
        part, never = one.area(1.5).lost[0], one.area(1.5).lost[1]
        assert [lost.sensor_id for lost in one.area(1.5).lost] == ["s0", "s2"]
        assert (part.stamp, never.stamp) == (0.0, None)
        assert shapely.equals(part.region, seen)
        assert never.region.is_empty
        assert one.area(1.6).lost[0].stamp == 0.0
        one.add_scan("s0", scan(1.6))
        one.add_scan("s2", scan(1.6))
        assert one.area(1.6).lost == ()


def state_of(one: AreaFusion, time: float) -> tuple[Any, ...]:
    area = one.area(time)
    stamps = [one.latest_stamp(sensor_id) for sensor_id in sorted(one.sensors)]
    return stamps, [ring.tolist() for ring in area.rings], dict(area.contradictions), len(area.lost)


NOISY = 3.0 + 0.01 * np.random.default_rng(0).normal(size=BEAMS)


@pytest.mark.parametrize("memory", [True, False])
@pytest.mark.parametrize(
    ("bad", "now", "error", "text"),
    [
        (scan(1.25, NOISY + 1.0), 1.1, InvalidInput, r"1\.250 s is 0\.150 s ahead of the clock \(1\.100 s\)"),
        (scan(1e12, NOISY + 1.0), 1.1, InvalidInput, "ahead of the clock"),
        (scan(0.9, NOISY + 1.0), 1.1, InvalidInput, r"0\.900 s is older than its last \(1\.000 s\)"),
        (scan(1.0, NOISY + 1.0), 1.1, InvalidInput, "differs from its last, which has the same stamp"),
        (
            scan(1.1, NOISY),
            1.1,
            InvalidInput,
            r"1\.100 s is frozen: all ranges are those of 1\.000 s, 181 returns",
        ),
        (
            scan(1.1, np.where(np.arange(BEAMS) % 4 == 0, math.nan, NOISY)),
            1.1,
            InvalidInput,
            r"1\.100 s is frozen: all ranges are those of 1\.000 s, 135 returns",
        ),
        (scan(1.1, 2.0, beams=91), 1.1, ScanError, "has 91 beams, expected 181"),
    ],
)
def test_a_refused_scan_leaves_everything_as_it_was(
    memory: bool, bad: PlanarScan, now: float, error: type[Exception], text: str
) -> None:
    def made() -> AreaFusion:
        one = fusion(2, ScanSettings(expected_beams=BEAMS, never_repeats=True), memory=memory)
        one.add_scan("s0", scan(1.0, NOISY), 1.0)
        one.add_scan("s1", scan(1.0, NOISY + 0.1), 1.0)
        one.area(1.0)
        return one

    one, twin = made(), made()
    with pytest.raises(error, match=text):
        one.add_scan("s0", bad, now)
    for time in (1.2, 1.9, 5.0):
        assert state_of(one, time) == state_of(twin, time)
    np.testing.assert_array_equal(one.last_seen(np.array([[0.0, 1.0]]), 5.0), ([0], [1.0]))
    one.add_scan("s0", scan(5.1, NOISY + 0.2), 5.1)
    assert one.latest_stamp("s0") == 5.1, "and the next good one is taken"


def test_a_scan_that_comes_twice_is_taken_once() -> None:
    one = fusion()
    first = one.add_scan("s0", scan(1.0, NOISY), 1.0)
    assert one.add_scan("s0", scan(1.0, NOISY), 1.3) is first
    assert one.latest_stamp("s0") == 1.0


@pytest.mark.parametrize(
    ("settings_", "ranges"),
    [
        (ScanSettings(), NOISY),  # a device without noise
        (ScanSettings(never_repeats=True), np.where(np.arange(BEAMS) < 99, NOISY, np.nan)),  # too few to tell
        (ScanSettings(never_repeats=True, inf_is_free=True), np.full(BEAMS, np.inf)),
    ],
)
def test_the_same_ranges_later_are_a_new_scan_unless_they_cannot_be(
    settings_: ScanSettings, ranges: FloatArray
) -> None:
    one = fusion(1, settings_)
    one.add_scan("s0", scan(1.0, ranges), 1.0)
    one.add_scan("s0", scan(1.5, ranges), 1.5)
    assert one.latest_stamp("s0") == 1.5


def test_what_the_clock_tolerance_admits_counts_as_age() -> None:
    one = fusion(1, clock_tolerance=0.2)
    with pytest.raises(InvalidInput, match=r"0\.300 s ahead of the clock"):
        one.add_scan("s0", scan(1.3), 1.0)
    one.add_scan("s0", open_scan(1.2), 1.0)
    area = one.area(1.0)
    assert_same(area, seen_by(0), 0.1)
    one.add_scan("s0", open_scan(1.5), 1.5)
    area = one.area(1.6)
    assert_same(area, seen_by(0).buffer(-SPEED * 0.3, quad_segs=64), 0.2)


@given(seeds)
def test_who_saw_a_point_last_is_the_newest_scan_that_covers_it(seed: int) -> None:
    generator = np.random.default_rng(seed)
    one = fusion(3, max_scan_age=0.5)
    events = []
    for stamp in np.sort(generator.uniform(0.0, 5.0, 12)):
        index, length = int(generator.integers(3)), float(generator.uniform(1.0, 6.0))
        one.add_scan(f"s{index}", open_scan(float(stamp), length))
        events.append((float(stamp), index, seen_by(index, length)))
    points = generator.uniform((-6.0, -1.0), (10.0, 6.0), (100, 2))
    points[0] = np.nan
    time = float(generator.uniform(0.0, 6.0))
    sensor, stamps = one.last_seen(points, time)
    for point, which, when in zip(points[1:], sensor[1:], stamps[1:], strict=True):
        covering = [
            (stamp, index)
            for stamp, index, seen in events
            if stamp <= time and seen.covers(shapely.Point(point))
        ]
        assert (when, which) == max(covering) if covering else (which == -1 and math.isnan(when))
    assert sensor[0] == -1


def test_only_the_last_twenty_different_scans_are_known_and_a_reset_forgets_them() -> None:
    one = fusion()
    for step in range(21):
        one.add_scan("s0", open_scan(float(step), 5.0 if step == 0 else 2.0 + 0.01 * step))
    point = np.array([[0.0, 4.0]])
    assert one.last_seen(point, 30.0)[0].tolist() == [-1]
    one.add_scan("s0", open_scan(21.0, 5.0))
    for step in range(22, 60):
        one.add_scan("s0", open_scan(float(step), 2.0))  # the same again and again
    assert one.last_seen(point, 99.0)[1].tolist() == [21.0]
    one.reset()
    assert one.last_seen(point, 99.0)[0].tolist() == [-1]
