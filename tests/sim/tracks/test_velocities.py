"""Velocities of bodies from simulated LMS-200 scans with noise, and no velocity where nothing moves."""

from __future__ import annotations

import time as clock
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import shapely

from snnav_core.area.tracks import TrackedScene
from snnav_core.errors import InvalidInput
from snnav_core.obstacles import MovingObstacle

INTERVAL = 0.3
SAMPLES = 5
LEAST_HITS = 3  # a body that fewer beams meet at some time is not measured

MakeHall = Callable[..., Any]


def found(scene: TrackedScene, body: shapely.Polygon) -> MovingObstacle | None:
    """Return the moving body whose outline covers most of a true one."""
    covered = [
        (shapely.Polygon(other.outline).intersection(body).area, index)
        for index, other in enumerate(scene.obstacles)
        if other.speed > 0.0
    ]
    best = max(covered, default=(0.0, -1))
    return scene.obstacles[best[1]] if best[0] > 0.3 * body.area else None


def errors(make: MakeHall, seeds: range, **options: int) -> tuple[np.ndarray, np.ndarray]:
    """Return errors after five samples, as shares of the speed (inf: not tracked) and in deviations."""
    shares, deviations = [], []
    for seed in seeds:
        hall = make(seed, **options)
        scene = [hall.step(INTERVAL * k) for k in range(SAMPLES)][-1]
        for mover, (name, body) in zip(hall.movers, hall.bodies(scene.stamp).items(), strict=True):
            if hall.least_hits[name] < LEAST_HITS:
                continue
            track = found(scene, body)
            if track is None:
                shares.append(np.inf)
                continue
            error = float(np.hypot(*(track.velocity - np.array(mover.velocity))))
            shares.append(error / mover.top_speed)
            deviations.append(error / track.velocity_deviation)
    return np.array(shares), np.array(deviations)


def test_velocities_seen_from_two_to_four_corners(make_random_hall: MakeHall) -> None:
    shares, deviations = errors(make_random_hall, range(12))
    assert np.median(shares) < 0.01
    assert np.mean(shares < 0.05) >= 0.85  # a single face says nothing of a motion along it
    assert np.isfinite(shares).all()
    assert np.max(deviations) < 4.0


def test_velocities_seen_from_all_corners(make_random_hall: MakeHall) -> None:
    shares, _ = errors(make_random_hall, range(100, 112), scanners=4)
    assert np.mean(shares < 0.05) >= 0.95
    assert np.percentile(shares, 90) < 0.02


@pytest.mark.nightly
def test_many_velocities(make_random_hall: MakeHall) -> None:
    shares, deviations = errors(make_random_hall, range(200))
    assert np.mean(shares < 0.05) >= 0.98
    assert np.percentile(deviations, 99) < 3.0
    shares, deviations = errors(make_random_hall, range(200, 300), scanners=4)
    assert np.mean(shares < 0.05) >= 0.99
    assert np.percentile(deviations, 99) < 3.0
    shares, deviations = errors(make_random_hall, range(300, 360), scanners=2)
    assert np.mean(shares < 0.05) >= 0.94
    assert np.percentile(deviations, 99) < 3.0


def alarms(make: MakeHall, seeds: range, drop_out: float) -> list[tuple[int, str]]:
    """Return bodies that got a velocity although nothing moves."""
    told = []
    for seed in seeds:
        hall = make(seed, moving=0, standing=6, drop_out=drop_out)
        for k in range(8):
            scene = hall.step(INTERVAL * k)
            told += [(seed, body.id) for body in scene.obstacles if body.velocity.any()]
    return told


@pytest.mark.parametrize("drop_out", [0.0, 0.05])
def test_nothing_moves_where_everything_stands(make_random_hall: MakeHall, drop_out: float) -> None:
    assert alarms(make_random_hall, range(6), drop_out) == []


@pytest.mark.nightly
def test_nothing_moves_in_a_hundred_halls(make_random_hall: MakeHall) -> None:
    assert alarms(make_random_hall, range(100), 0.02) == []


def test_a_body_that_stops_has_no_velocity(make_hall: MakeHall) -> None:
    cart = {"id": "cart", "circle": [0, 0, 0.4], "waypoints": [[4, 4], [5, 4]], "speed": 0.5}
    hall = make_hall([cart], [])
    speeds = {round(INTERVAL * k, 3): hall.step(INTERVAL * k).obstacles[0].velocity for k in range(16)}
    assert np.hypot(*speeds[1.5]) == pytest.approx(0.5, rel=0.05)
    assert not speeds[4.5].any()  # it has stood for the whole window


def test_what_does_not_move_uniformly_is_less_sure(make_hall: MakeHall) -> None:
    turning = {"id": "cart", "circle": [0, 0, 0.4], "waypoints": [[4, 4], [5, 4], [5, 6]], "speed": 0.5}
    hall = make_hall([turning], [])
    deviations = {k: hall.step(INTERVAL * k).obstacles[0].velocity_deviation for k in range(10)}
    assert deviations[9] > 3.0 * deviations[6]  # it turned at 2 s


def test_somebody_hidden_goes_on_for_a_while(make_hall: MakeHall) -> None:
    walker = {"id": "walker", "circle": [0, 0, 0.3], "start": [4, 6.5], "velocity": [0.8, 0.0]}
    wall = {"polygon": [[5, 3], [7.5, 3], [7.5, 3.3], [5, 3.3]]}
    hall = make_hall([walker], [wall], 1)
    names: dict[str, list[float]] = {}
    for k in range(20):
        scene = hall.step(INTERVAL * k)
        for body in scene.obstacles:
            if body.speed > 0.0:
                names.setdefault(body.id, []).append(scene.stamp)
    assert len(names) <= 2
    assert max(len(times) for times in names.values()) >= 4


def test_time_goes_on(make_hall: MakeHall) -> None:
    hall = make_hall([], [], 1)
    hall.step(1.0)
    with pytest.raises(InvalidInput, match="reset"):
        hall.step(1.0)
    hall.tracker.reset()
    hall.step(1.0)


def test_an_update_is_quick(make_random_hall: MakeHall) -> None:
    hall = make_random_hall(5, moving=4, standing=4, scanners=4)
    for k in range(4):
        hall.step(INTERVAL * k)
    seconds = []
    for k in range(4, 8):
        for device in hall.devices:
            hall.fusion.add_scan(device.sensor.id, device.scan(INTERVAL * k))
        area, returns = hall.fusion.area(INTERVAL * k), hall.fusion.returns(INTERVAL * k)
        before = clock.process_time()
        hall.tracker.update(INTERVAL * k, returns, area)
        seconds.append(clock.process_time() - before)
    assert np.median(seconds) < 0.05  # 34 ms on a busy machine
