"""The simulated LMS-200: exact without noise, reproducible with it, honest about what it does not know."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from snnav_core.area.robots import RobotTrack
from snnav_core.sensing.scan import LMS200_ERROR_CODES, detect_planar
from snnav_core.types import Pose2D, RobotSpec
from snnav_sim.configure import planar_sensor, scan_settings
from snnav_sim.devices import make_device
from snnav_sim.devices.lms200 import RANGE_RESOLUTION, Lms200
from snnav_sim.scene import Circle, Mover, Scene
from snnav_sim.world import World


def device(scene: Scene, seed: int = 1, **changes: object) -> Lms200:
    sensor = replace(scene.sensors[0], **changes)  # type: ignore[arg-type]
    made = make_device(sensor, World(scene), seed)
    assert isinstance(made, Lms200)
    return made


def test_exact_ranges_rounded_down_to_single_precision(room: Scene) -> None:
    lms = device(room)
    scan, true = lms.scan(0.0), lms.true_ranges(0.0)
    assert scan.ranges.size == 360
    assert np.array_equal(scan.ranges, scan.ranges.astype(np.float32).astype(np.float64))
    assert (scan.ranges <= true).all()
    assert (true - scan.ranges).max() < 1e-6
    assert scan.ranges[180] == 3.0  # straight ahead at the block


@pytest.mark.parametrize(
    ("view", "step", "beams"),
    [(180, 1, 181), (179, 1, 180), (180, 0.5, 361), (179.5, 0.5, 360), (100, 0.25, 401)],
)
def test_beam_counts(room: Scene, view: float, step: float, beams: int) -> None:
    changes = {
        "field_of_view": math.radians(view),
        "resolution": math.radians(step),
        "angle_min": -math.radians(view) / 2,
    }
    scan = device(room, **changes).scan(0.0)
    assert scan.ranges.size == beams
    assert scan.angles[-1] == pytest.approx(math.radians(view) / 2, abs=1e-5)


def test_nothing_in_range_reads_infinity(room: Scene) -> None:
    scan = device(room, range_max=2.0).scan(0.0)
    assert np.isinf(scan.ranges).any()
    assert scan.ranges[np.isfinite(scan.ranges)].max() <= scan.range_max


def test_noise_statistics(room: Scene) -> None:
    lms = device(room, noise="lms200")
    true = lms.true_ranges(0.0)
    scans = np.array([lms.scan(0.5 * number).ranges for number in range(400)])
    error = scans - true
    # white 3.03856 mm, flicker 1.77023 mm, rounding to 10 mm: uniform, 2.887 mm
    expected = math.hypot(3.03856e-3, 1.77023e-3, RANGE_RESOLUTION / math.sqrt(12.0))
    assert error.std() == pytest.approx(expected, rel=0.05)
    assert abs(error.mean()) < 3e-4
    steps = scans / RANGE_RESOLUTION
    assert np.abs(steps - np.round(steps)).max() < 1e-3
    assert np.array_equal(scans, scans.astype(np.float32).astype(np.float64))


def test_a_scan_depends_on_seed_sensor_and_number_only(room: Scene) -> None:
    whole = device(room, noise="lms200", drop_out=0.1)
    alone = device(room, noise="lms200", drop_out=0.1)
    history = [whole.scan(0.5 * number).ranges for number in range(8)]
    assert np.array_equal(alone.scan(3.5).ranges, history[7], equal_nan=True)
    assert not np.array_equal(history[6], history[7], equal_nan=True)
    other_seed = device(room, seed=2, noise="lms200", drop_out=0.1)
    assert not np.array_equal(other_seed.scan(3.5).ranges, history[7], equal_nan=True)
    other_name = device(room, id="c", noise="lms200", drop_out=0.1)
    assert not np.array_equal(other_name.scan(3.5).ranges, history[7], equal_nan=True)


def test_drop_outs_by_probability(room: Scene) -> None:
    lms = device(room, drop_out=0.2)
    lost = np.isnan([lms.scan(0.5 * number).ranges for number in range(50)])
    assert lost.mean() == pytest.approx(0.2, abs=0.01)
    assert np.isnan(device(room, drop_out=1.0).scan(0.0).ranges).all()


def test_error_codes_show_nothing(room: Scene) -> None:
    changes = {"range_max": 2.0, "drop_out": 0.1, "error_codes": True, "no_return": "unknown"}
    lms = device(room, **changes)
    scan = lms.scan(0.0)
    assert np.isfinite(scan.ranges).all()
    beyond = scan.ranges > scan.range_max
    nearest = np.abs(scan.ranges[beyond, None] - np.array(LMS200_ERROR_CODES)).min(axis=1)
    assert beyond.any()
    assert nearest.max() < 1e-5
    area = detect_planar("a", scan, lms.sensor.pose, scan_settings(lms.sensor))
    assert area.counts.error_code == beyond.sum()
    assert area.counts.infinite_free == 0


def test_a_surface_too_near_and_a_body_on_the_device_read_zero(room: Scene) -> None:
    scan = device(room, range_min=3.5).scan(0.0)
    assert scan.ranges[180] == 0.0
    assert scan.ranges.max() > 3.5
    body = Mover("m", Circle(0.0, 0.0, 0.4), start=(1.0, 4.0), velocity=(0.1, 0.0))
    covered = device(replace(room, movers=(body,), boundary_speed=0.2))
    assert (covered.scan(0.0).ranges == 0.0).all()
    assert covered.scan(10.0).ranges[180] == pytest.approx(0.6, abs=1e-6)
    assert covered.scan(20.0).ranges[180] == pytest.approx(1.6, abs=1e-6)


def track(*states: tuple[float, float, float]) -> RobotTrack:
    """The track of a robot of 0.3 m radius by (time, x, y)."""
    made = RobotTrack(RobotSpec("r", 0.3, 1.0, 1.0))
    for time, x, y in states:
        made.add(time, Pose2D(x, y, 0.0), 1.0)
    return made


def test_a_device_on_the_floor_sees_robots_where_they_were(room: Scene) -> None:
    """Sensor a stands at (1, 4), the block begins 3 m ahead of it; a robot crosses before it from 0 to 4 s."""
    robot, elsewhere = track((0.0, 2.5, 2.0), (2.0, 2.5, 4.0), (4.0, 2.5, 6.0)), track((0.0, 9.0, 7.0))
    sensor = replace(room.sensors[0], sees_robots=True)
    low = make_device(sensor, World(room), 1, [elsewhere, robot])
    high = make_device(room.sensors[0], World(room), 1, [elsewhere, robot])
    assert low.scan(2.0).ranges[180] == pytest.approx(1.2, abs=1e-6)
    assert high.scan(2.0).ranges[180] == 3.0
    for time in np.linspace(0.0, 4.0, 9).tolist():
        distance = math.hypot(1.5, 2.0 - time)
        bearing = math.atan2(time - 2.0, 1.5)
        ranges = low.scan(time).ranges
        nearest = int(np.argmin(np.abs(np.deg2rad(np.arange(360) - 180.0) - bearing)))
        assert ranges[nearest] == pytest.approx(distance - 0.3, abs=0.01)
        assert (ranges <= high.scan(time).ranges).all()
    assert np.array_equal(low.scan(30.0).ranges, high.scan(30.0).ranges), "where a robot is then is not known"


def test_a_robot_on_the_device_blinds_it(room: Scene) -> None:
    sensor = replace(room.sensors[0], sees_robots=True)
    low = make_device(sensor, World(room), 1, [track((0.0, 1.1, 4.1))])
    assert (low.scan(0.0).ranges == 0.0).all()


def test_range_accuracy_covers_the_noise(room: Scene) -> None:
    """What counts as free ends before the true surface, for nearly every beam of 200 noisy scans."""
    lms = device(room, noise="lms200")
    settings = scan_settings(lms.sensor)
    true = lms.true_ranges(0.0)
    beyond = np.array(
        [lms.scan(0.5 * number).ranges - settings.range_accuracy > true for number in range(200)]
    )
    assert beyond.mean() < 1e-4
    assert scan_settings(room.sensors[0]).range_accuracy == 0.0


def test_the_sensor_of_the_fusion(room: Scene) -> None:
    sensor = planar_sensor(room.sensors[0])
    assert (sensor.id, sensor.pose, sensor.settings.expected_beams) == ("a", room.sensors[0].pose, 360)
    assert sensor.settings.inf_is_free
    assert not planar_sensor(replace(room.sensors[0], no_return="unknown")).settings.inf_is_free


def test_recorded_ranges_come_back(recorded: Scene) -> None:
    sensor = recorded.sensors[1]
    lms = make_device(sensor, World(recorded), 1)
    first, second = lms.scan(0.0), lms.scan(7.5)
    assert second.stamp == 7.5
    assert np.array_equal(first.ranges, second.ranges, equal_nan=True)
    assert np.array_equal(first.ranges, first.ranges.astype(np.float32).astype(np.float64), equal_nan=True)
    assert first.ranges[0] == pytest.approx(4.1)
    assert first.ranges[0] <= 4.1
    assert math.isnan(first.ranges[1])
    assert first.angle_increment == pytest.approx(math.radians(45.0))
