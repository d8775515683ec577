"""What arrives from a sensor: at its own instants, and changed, delayed, dropped or repeated by its faults."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from snnav_core.sensing.scan import PlanarScan
from snnav_sim.devices import SensorFeed, make_device
from snnav_sim.devices.feed import MOST_ARRIVALS
from snnav_sim.scene import Fault, Scene, SensorScene, find_scene, load_scene
from snnav_sim.world import World

SCENE = load_scene(find_scene("hello"))
PERIOD, END = 0.25, 10.0
KINDS = {
    "drop_out": Fault("drop_out"),
    "delay": Fault("delay", seconds=0.6),
    "jitter": Fault("delay", seconds=0.1, jitter=0.9),
    "duplicate": Fault("duplicate"),
    "reorder": Fault("reorder"),
    "nan": Fault("nan", share=0.3),
    "zero": Fault("zero", share=0.3),
    "beam_count": Fault("beam_count", change=-4),
    "frozen": Fault("frozen"),
    "clock_offset": Fault("clock_offset", seconds=0.4),
}


def sensor(*faults: Fault, period: float | None = PERIOD, offset: float = 0.0) -> SensorScene:
    return replace(SCENE.sensors[0], scan_period=period, scan_offset=offset, faults=faults)


def feed(*faults: Fault, seed: int = 1, period: float | None = PERIOD, offset: float = 0.0) -> SensorFeed:
    entry = sensor(*faults, period=period, offset=offset)
    return SensorFeed(make_device(entry, World(SCENE), seed), SCENE.scan_period(entry), seed)


def heard(source: SensorFeed, step: float = 0.1, end: float = END) -> list[tuple[float, PlanarScan]]:
    """Return the time of every arrival, and the scan."""
    times = [round(step * number, 9) for number in range(round(end / step) + 1)]
    return [(time, scan) for time in times for scan in source.arrivals(time)]


def same(one: PlanarScan, other: PlanarScan) -> bool:
    return one.stamp == other.stamp and np.array_equal(one.ranges, other.ranges, equal_nan=True)


TRUE = [scan for _, scan in heard(feed())]
"""The scans of the healthy sensor, number by number."""


def test_without_faults_every_scan_arrives_once_when_it_is_measured() -> None:
    assert [scan.stamp for scan in TRUE] == [PERIOD * number for number in range(41)]
    device = make_device(sensor(), World(SCENE), 1)
    for time, scan in heard(feed(), step=PERIOD):
        assert time == scan.stamp
        assert same(scan, device.scan(time))
    assert len({scan.ranges.tobytes() for scan in TRUE}) == len(TRUE), "the noise of every scan is its own"


def test_a_sensor_without_a_period_measures_at_every_sampling_instant() -> None:
    device = make_device(SCENE.sensors[0], World(SCENE), 1)
    source = feed(period=None)
    for number in range(12):
        time = number * SCENE.sampling_interval
        (scan,) = source.arrivals(time)
        assert same(scan, device.scan(time))


@given(st.integers(50, 3000), st.floats(0.0, 0.99), st.integers(50, 2000))
def test_instants_are_offset_plus_multiples_of_the_period(period: int, share: float, step: int) -> None:
    offset = int(share * period)  # [ms], as all three
    source = feed(period=1e-3 * period, offset=1e-3 * offset)
    arrived = 0
    for number in range(6):
        time = number * step
        stamps = [scan.stamp for scan in source.arrivals(1e-3 * time)]
        due = (time - offset) // period + 1
        expected = [1e-3 * (offset + count * period) for count in range(arrived, due)]
        assert stamps == pytest.approx(expected[-MOST_ARRIVALS:], abs=1e-8)
        arrived = due


def test_who_was_asleep_gets_the_newest_scans_only() -> None:
    source = feed()
    source.arrivals(1.0)
    stamps = [scan.stamp for scan in source.arrivals(1e6)]
    assert stamps == [1e6 - PERIOD * number for number in reversed(range(MOST_ARRIVALS))]
    assert [scan.stamp for scan in source.arrivals(1e6 + PERIOD)] == [1e6 + PERIOD]


def test_after_a_reset_it_begins_again() -> None:
    source = feed(*KINDS.values())
    first = heard(source)
    assert heard(source) == []
    source.reset()
    again = heard(source)
    assert [time for time, _ in again] == [time for time, _ in first]
    assert all(same(one, other) for (_, one), (_, other) in zip(again, first, strict=True))


@pytest.mark.parametrize("kind", KINDS)
def test_a_fault_meets_the_scans_of_its_window_only(kind: str) -> None:
    """Before 2 s, and from 4 s on, every scan is as it was measured; between, no scan is."""
    got = heard(feed(replace(KINDS[kind], begin=2.0, end=4.0)))
    intact = [(time, scan) for time, scan in got if any(same(scan, true) for true in TRUE)]
    outside = [scan.stamp for scan in TRUE if not 2.0 <= scan.stamp < 4.0]
    late = {scan.stamp for time, scan in got if time > scan.stamp + 0.1 or scan.stamp > time}
    if kind in ("delay", "jitter"):
        assert late == {scan.stamp for scan in TRUE} - set(outside)
        assert len(got) == len(TRUE)
    elif kind == "duplicate":
        counts = [sum(scan.stamp == true.stamp for _, scan in intact) for true in TRUE]
        assert counts == [1 if true.stamp in outside else 2 for true in TRUE]
    elif kind == "reorder":
        stamps = [scan.stamp for _, scan in got]
        assert stamps != sorted(stamps)
        assert sorted(stamps) == [scan.stamp for scan in TRUE]
        assert stamps[:8] == outside[:8]
        assert stamps[16:] == outside[8:]
    else:
        assert [scan.stamp for _, scan in intact if not 2.0 <= scan.stamp < 4.0] == outside
        changed = [scan for _, scan in got if not any(same(scan, true) for true in TRUE)]
        assert len(changed) == (0 if kind == "drop_out" else len(TRUE) - len(outside))


@pytest.mark.parametrize("kind", KINDS)
def test_its_seed_decides_and_nothing_else(kind: str) -> None:
    fault = replace(KINDS[kind], probability=0.5)
    first, again, coarse = heard(feed(fault)), heard(feed(fault)), heard(feed(fault), step=0.5)
    assert all(one[0] == other[0] and same(one[1], other[1]) for one, other in zip(first, again, strict=True))
    if kind not in ("delay", "jitter"):  # the last ones of these are still under way
        assert all(same(one, other) for (_, one), (_, other) in zip(first, coarse, strict=True))
    others = [heard(feed(fault, seed=seed)) for seed in (2, 3)]

    def met(arrivals: list[tuple[float, PlanarScan]]) -> list[tuple[float, float, int, bool]]:
        return [
            (
                time,
                scan.stamp,
                scan.ranges.size,
                bool(np.isnan(scan.ranges).any() or (scan.ranges == 0).any()),
            )
            for time, scan in arrivals
        ]

    if kind != "frozen":
        assert any(met(other) != met(first) for other in others)


def test_probability_is_the_share_of_the_scans_that_are_met() -> None:
    got = heard(feed(Fault("drop_out", probability=0.3)), step=1.0, end=400.0)
    assert len(got) / 1601 == pytest.approx(0.7, abs=0.04)


def test_faults_of_one_sensor_meet_different_scans() -> None:
    """Two independent drop-outs of one half leave a quarter, not a half."""
    one = Fault("drop_out", probability=0.5)
    assert len(heard(feed(one, one), step=1.0, end=400.0)) / 1601 == pytest.approx(0.25, abs=0.04)


def test_a_delay_with_jitter_stays_in_its_bounds_and_may_change_the_order() -> None:
    got = heard(feed(KINDS["jitter"]), step=0.05, end=60.0)
    late = np.array([time - scan.stamp for time, scan in got])
    assert late.min() >= 0.1 - 1e-9
    assert late.max() <= 1.0 + 0.05
    assert late.mean() == pytest.approx(0.55 + 0.025, abs=0.06)
    stamps = [scan.stamp for _, scan in got]
    assert stamps != sorted(stamps)
    assert len(set(stamps)) == len(stamps)


def test_reordered_scans_change_places_in_pairs() -> None:
    stamps = [scan.stamp for _, scan in heard(feed(KINDS["reorder"]))]
    numbers = [round(stamp / PERIOD) for stamp in stamps]
    assert numbers[:6] == [1, 0, 3, 2, 5, 4]
    times = [time for time, _ in heard(feed(KINDS["reorder"]), step=PERIOD)]
    assert times[:4] == [PERIOD, 2 * PERIOD, 3 * PERIOD, 4 * PERIOD], "just after the next one"


@pytest.mark.parametrize(("kind", "reads"), [("nan", np.isnan), ("zero", lambda ranges: ranges == 0.0)])
@pytest.mark.parametrize("share", [0.001, 0.3, 1.0])
def test_a_share_of_the_beams_reads_nothing(kind: str, reads: object, share: float) -> None:
    places = set()
    for (_, scan), true in zip(heard(feed(Fault(kind, share=share))), TRUE, strict=True):
        lost = reads(scan.ranges)  # type: ignore[operator]
        assert lost.sum() == math.ceil(share * scan.ranges.size)
        assert np.array_equal(scan.ranges[~lost], true.ranges[~lost])
        places.add(lost.tobytes())
    assert len(places) > 20 or share == 1.0, "other beams in every scan"


@pytest.mark.parametrize("change", [-359, -1, 1, 40])
def test_other_numbers_of_beams(change: int) -> None:
    for (_, scan), true in zip(heard(feed(Fault("beam_count", change=change))), TRUE, strict=True):
        kept = min(scan.ranges.size, true.ranges.size)
        assert scan.ranges.size == true.ranges.size + change
        assert np.array_equal(scan.ranges[:kept], true.ranges[:kept])
        assert (scan.ranges[kept:] == true.ranges[-1]).all()


def test_frozen_scans_repeat_the_last_one_before_under_new_stamps() -> None:
    got = [scan for _, scan in heard(feed(replace(KINDS["frozen"], begin=2.0, end=4.0)))]
    assert [scan.stamp for scan in got] == [scan.stamp for scan in TRUE]
    last = TRUE[7]  # stamped 1.75 s
    for number, scan in enumerate(got):
        expected = last if 2.0 <= scan.stamp < 4.0 else TRUE[number]
        assert np.array_equal(scan.ranges, expected.ranges)


def test_a_device_that_is_frozen_from_the_first_scan_repeats_that() -> None:
    assert {scan.ranges.tobytes() for _, scan in heard(feed(KINDS["frozen"]))} == {TRUE[0].ranges.tobytes()}


@pytest.mark.parametrize("seconds", [0.4, -0.4])
def test_the_clock_of_the_device_is_ahead_or_behind(seconds: float) -> None:
    fault = Fault("clock_offset", seconds=seconds)
    for (time, scan), true in zip(heard(feed(fault), step=PERIOD), TRUE, strict=True):
        assert scan.stamp == pytest.approx(time + seconds, abs=1e-9)
        assert np.array_equal(scan.ranges, true.ranges)


def test_faults_apply_in_the_order_given() -> None:
    """A window goes by the true instant of measurement, and each fault meets what the one before it left."""
    nan, frozen = Fault("nan", begin=0.0, end=2.0, share=1.0), Fault("frozen", begin=2.0)
    after = [scan for _, scan in heard(feed(nan, frozen))]
    assert np.isnan([scan.ranges for scan in after]).all(), "what froze was already lost"
    before = [scan for _, scan in heard(feed(frozen, nan))]
    assert np.isfinite([scan.ranges for scan in before[8:]]).all()
    ahead = Fault("clock_offset", seconds=5.0)
    late = [scan.stamp for _, scan in heard(feed(ahead, Fault("drop_out", end=5.0)), step=PERIOD)]
    assert late[0] == 10.0
    doubled = heard(feed(Fault("duplicate"), Fault("reorder", end=9.0, probability=0.5)))
    assert len(doubled) == 2 * len(TRUE)


@given(
    st.lists(st.sampled_from(sorted(KINDS)), max_size=4, unique=True),
    st.integers(0, 1000),
    st.sampled_from([0.01, 0.1, 0.2]),
)
def test_how_often_somebody_asks_changes_nothing(kinds: list[str], seed: int, step: float) -> None:
    """Any faults together: nothing arrives before it is measured, and after their window all is well again."""
    faults = [replace(KINDS[kind], begin=1.0, end=5.0, probability=0.7) for kind in kinds]
    got, often = heard(feed(*faults, seed=seed), step=step), heard(feed(*faults, seed=seed), step=0.05)
    assert all(same(one, other) for (_, one), (_, other) in zip(got, often, strict=True))
    ahead = 0.4 if "clock_offset" in kinds else 0.0
    assert all(scan.stamp <= time + ahead + 1e-9 for time, scan in got)
    healthy = [scan for _, scan in heard(feed(seed=seed)) if scan.stamp > 7.0]
    assert all(same(*pair) for pair in zip([s for _, s in got if s.stamp > 7.0], healthy, strict=True))


def test_a_scene_keeps_what_its_sensors_are_given() -> None:
    scene = replace(SCENE, sensors=(sensor(*KINDS.values()), replace(SCENE.sensors[1], sees_robots=True)))
    assert isinstance(scene, Scene)
    assert scene.sees_robots
    assert scene.scan_period(scene.sensors[0]) == PERIOD
