"""A sensor falls silent for good: the area shrinks at once, the robot stands inside its window or does without."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pytest

from snnav_core.area.planar import UnoccupiedArea
from snnav_core.types import FloatArray, PlannedPath, StopReason
from snnav_sim.report.truth import GroundTruth
from snnav_sim.scene import Scene, parse_scene
from snnav_sim.simulation import Simulation

HALL = """
name: cut
description: Two scanners watch one half of a hall each, one of them falls silent
sampling_interval: 0.5
control_period: 0.05
time_window: 4
boundary_speed: 0.4
safety_margin: 0.5
time_limit: 90.0
seed: {seed}
workspace: {{polygon: [[0, 0], [24, 0], [24, 10], [0, 10]]}}
obstacles:
  - {{polygon: [[11.5, 0], [12.5, 0], [12.5, 3], [11.5, 3]]}}
sensors:
  - {{id: west, device: lms200, position: [0.1, 5], heading_deg: 0, field_of_view_deg: 180, resolution_deg: 0.5,
     range_max: 15.0, noise: lms200, scan_period: {west[0]}, scan_offset: {west[1]}, faults: {west[2]}}}
  - {{id: east, device: lms200, position: [23.9, 5], heading_deg: 180, field_of_view_deg: 180, resolution_deg: 0.5,
     range_max: 15.0, noise: lms200, scan_period: {east[0]}, scan_offset: {east[1]}, faults: {east[2]}}}
robots:
  - {{id: cart, start: [3, 6], heading_deg: 0, target: [21, 6], speed: 0.8, max_turn_rate: 1.5, radius: 0.3}}
"""
PROBES = {"west": np.array([[5.0, 5.0]]), "east": np.array([[19.0, 5.0]])}  # seen by one of them only


@dataclass(frozen=True)
class Cut:
    """What happened after the last scan of a sensor; times from that scan on [s]."""

    seed: int
    to_smaller_area: float
    to_standstill: float | None  # None: the robot arrived without what the sensor saw
    promised: float  # latest end of a window that was certified
    reason: str
    message: str
    least_clearance: float


@dataclass(frozen=True)
class Silence:
    """The sensor that falls silent, its period and offset, and the instant of its last scan [s]."""

    sensor: str
    period: float
    offset: float
    last: float

    def age(self, time: float) -> float:
        """Age of its newest scan at a time up to the last one [s]."""
        return float((time - self.offset) % self.period)


def cut_scene(seed: int) -> tuple[Scene, Silence]:
    """Return a scene, and what falls silent in it."""
    generator = np.random.default_rng(seed)
    silent = ("west", "east")[int(generator.integers(2))]
    rates = {}
    for name in ("west", "east"):
        period = round(float(generator.uniform(0.1, 0.5)), 3)
        rates[name] = (period, round(float(generator.uniform(0.0, 0.99)) * period, 3))
    begin = float(generator.uniform(1.0, 20.0))
    period, offset = rates[silent]
    last = offset + period * np.floor((begin - offset) / period)
    faults = {
        name: f"[{{kind: drop_out, from: {last + 1e-3}}}]" if name == silent else "[]" for name in rates
    }
    text = HALL.format(seed=seed, **{name: (*rates[name], faults[name]) for name in rates})
    return parse_scene(text, f"cut {seed}"), Silence(silent, period, offset, float(last))


def run_cut(seed: int) -> Cut:
    scene, silence = cut_scene(seed)
    last, speed = silence.last, scene.boundary_speed
    simulation = Simulation(scene)
    full = 0.0  # clearance at the probe at the instant of a scan
    smaller, promised, moved = None, 0.0, 0.0
    while not simulation.record.reason:
        time = simulation.time
        decision = simulation.decide().decisions["cart"]
        probed = clearance_of(simulation, PROBES[silence.sensor])
        if time <= last:
            full = max(full, probed + speed * silence.age(time))
        elif smaller is None and probed <= full - 0.9 * speed * (time - last):
            smaller = time
        if isinstance(decision, PlannedPath):
            promised = max(promised, decision.certificate.valid_until)
        elif decision.reason is StopReason.ARRIVED or time > last + 60.0:
            break
        for _ in range(scene.ticks_per_sample):
            simulation.move()
            if simulation.record.samples["cart"][-1][4] > 0.0:
                moved = simulation.time
    rows = simulation.record.trajectory("cart")
    final = simulation.record.decisions[-1]
    assert smaller is not None
    arrived = final.reason == StopReason.ARRIVED.value
    return Cut(
        seed,
        smaller - last,
        None if arrived else moved - last,
        promised - last,
        final.reason,
        final.message,
        float(GroundTruth(scene).clearance(rows[:, 1:3], rows[:, 0]).min()),
    )


def clearance_of(simulation: Simulation, point: FloatArray) -> float:
    region = simulation.record.areas[-1][1]
    return float(UnoccupiedArea(0.0, region).clearance(point)[0])


def check(cuts: Sequence[Cut]) -> None:
    stops = [cut for cut in cuts if cut.to_standstill is not None]
    assert stops, "some cut has to end in a stop"
    for cut in cuts:
        scene = cut_scene(cut.seed)[0]
        assert 0.0 < cut.to_smaller_area <= scene.sampling_interval + 1e-6, cut
        assert cut.least_clearance >= scene.safety_margin, cut
    for cut in stops:
        assert cut.to_standstill is not None
        assert cut.to_standstill <= cut.promised + 1e-6, cut
        silent = cut_scene(cut.seed)[1].sensor
        assert f"sensor {silent} is silent since" in cut.message, cut


def test_the_area_shrinks_with_the_next_decision_and_the_robot_stands_inside_its_window() -> None:
    check([run_cut(seed) for seed in range(6)])


@pytest.mark.nightly
def test_a_hundred_cuts(capsys: pytest.CaptureFixture[str]) -> None:
    cuts = [run_cut(seed) for seed in range(100)]
    stops = [cut for cut in cuts if cut.to_standstill is not None]
    rows = {
        "last scan to smaller area": [cut.to_smaller_area for cut in cuts],
        "last scan to standstill": [cut.to_standstill for cut in stops],
        "end of the last certified window": [cut.promised for cut in stops],
    }
    with capsys.disabled():
        print(f"\n100 cuts: {len(stops)} stops, {len(cuts) - len(stops)} arrivals")
        for name, values in rows.items():
            p50, p99 = np.percentile(np.asarray(values, dtype=np.float64), (50, 99))
            print(f"  {name}: p50 {p50:.2f} s, p99 {p99:.2f} s")
    check(cuts)
