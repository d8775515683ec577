"""A depth camera measures what is there, and says in the words of REP 117 when it does not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from snnav_core.area.robots import RobotTrack
from snnav_core.flight_types import FlyerState
from snnav_core.types import FloatArray, RobotSpec
from snnav_sim.devices.tof import TOF_ACCURACY, DepthDevice
from snnav_sim.scene_types import Circle
from snnav_sim.space_types import DepthSensor, Prism, SpaceMover, SpaceScene
from snnav_sim.space_world import SpaceWorld

EYE = DepthSensor("eye", "tof", (0.1, 2.0, 1.5), look_at=(4.0, 2.0, 1.5), columns=32, rows=32, range_max=6.0)
PERSON = SpaceMover("person", Prism(Circle(0.0, 0.0, 0.3), 0.0, 1.8), ((3.0, 1.0, 0.0), (3.0, 3.0, 0.0)), 0.5)
SCENE = SpaceScene("room", 0.2, (0.0, 0.0, 0.0), (8.0, 4.0, 3.0), 0.5, (EYE,), boundary_speed=0.5)


def device(sensor: DepthSensor, scene: SpaceScene = SCENE, seed: int = 1) -> DepthDevice:
    return DepthDevice(sensor, SpaceWorld(replace(scene, sensors=(sensor,))), seed)


def ranges_of(sensor: DepthSensor, time: float = 0.0, seed: int = 1) -> FloatArray:
    return device(sensor, seed=seed).scan(time).ranges


def test_points_lie_on_walls_and_bodies() -> None:
    scene = replace(SCENE, movers=(PERSON,))
    one = device(replace(EYE, range_max=20.0), scene)
    for time in (0.0, 2.0, 9.0):
        points = one.sensor.camera.cloud(one.scan(time)).reshape(-1, 3)
        seen = points[np.isfinite(points).all(axis=1)]
        assert len(seen) > 900
        np.testing.assert_allclose(SpaceWorld(scene).clearance(seen, time), 0.0, atol=1e-6)


def test_too_far_too_near_and_lost_have_their_values() -> None:
    exact = ranges_of(replace(EYE, range_max=50.0))
    assert exact.max() > 7.0
    read = ranges_of(replace(EYE, range_min=2.0, drop_out=0.2))
    lost = np.isnan(read)
    assert 0.1 < lost.mean() < 0.3
    assert np.isposinf(read[(exact > 6.0) & ~lost]).all()
    assert np.isneginf(read[(exact < 2.0) & ~lost]).all()
    within = (exact >= 2.0) & (exact <= 6.0) & ~lost
    np.testing.assert_array_equal(read[within], exact[within])


def test_noise_stays_within_its_accuracy_and_comes_by_seed() -> None:
    sensor = replace(EYE, range_max=50.0, noise="tof")
    exact = ranges_of(replace(sensor, noise="none"))
    off = ranges_of(sensor) - exact
    assert 0.004 < off.std() < 0.006
    assert np.abs(off).max() <= TOF_ACCURACY + 1e-6
    np.testing.assert_array_equal(ranges_of(sensor, 0.4), ranges_of(sensor, 0.4))
    assert (ranges_of(sensor, 0.4) != ranges_of(sensor, 0.6)).any()
    assert (ranges_of(sensor) != ranges_of(sensor, seed=2)).any()


def test_a_range_that_wraps_is_never_too_far() -> None:
    exact = ranges_of(replace(EYE, range_max=50.0))
    read = ranges_of(replace(EYE, range_max=50.0, wrap=5.0))
    far = exact > 5.05
    assert far.any()
    np.testing.assert_allclose(read[far], exact[far] - 5.0, rtol=0.0, atol=1e-6)
    np.testing.assert_array_equal(read[exact < 5.0], exact[exact < 5.0])


def test_a_body_round_the_camera_leaves_it_blind() -> None:
    scene = replace(SCENE, movers=(replace(PERSON, waypoints=((0.1, 2.0, 0.0), (3.0, 2.0, 0.0))),))
    assert np.isneginf(device(EYE, scene).scan(0.0).ranges).all()


def test_robots_are_seen_where_they_are() -> None:
    world = SpaceWorld(SCENE)
    track = RobotTrack(RobotSpec("bee", 0.2, 1.0, 2.0))
    for stamp in (0.0, 1.0, 2.0):
        track.add_flyer(
            FlyerState("bee", np.array([1.0 + stamp, 2.0, 1.5]), np.array([1.0, 0.0, 0.0]), stamp, 1.0)
        )
    one = DepthDevice(EYE, world, 1, [track])
    for stamp, seen in ((1.0, 1.7), (1.5, 2.2), (2.1, 2.8)):
        assert one.scan(stamp).ranges[15:17, 15:17].min() == pytest.approx(seen, abs=0.1)
    for stamp in (0.0, 3.0):  # before it is put into the room; where nobody knows where it is
        np.testing.assert_array_equal(one.scan(stamp).ranges, ranges_of(EYE))


def test_ranges_are_exact_in_single_precision() -> None:
    ranges = ranges_of(replace(EYE, noise="tof", drop_out=0.1))
    np.testing.assert_array_equal(ranges, ranges.astype(np.float32))


def test_a_spinning_device_sees_all_round() -> None:
    sensor = DepthSensor(
        "spin", "spinning", (4.0, 2.0, 1.5), columns=64, rows=16, width=2 * np.pi, height=1.5, range_max=30.0
    )
    points = sensor.camera.cloud(device(sensor).scan(0.0)).reshape(-1, 3)
    assert points[:, 0].max() == pytest.approx(8.0)
    assert points[:, 0].min() == pytest.approx(0.0, abs=1e-6)
