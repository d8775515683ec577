"""Robots that floor-level scanners see are no obstacles; everything else is, also beside and behind them."""

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
from snnav_core.errors import InvalidInput
from snnav_core.sensing.scan import PlanarScan, ScanSettings
from snnav_core.types import FloatArray, Pose2D, RobotSpec, RobotState

ROOM = (10.0, 8.0)
BEAMS = 361
ROBOT = RobotSpec("r1", 0.3, 0.5, 1.0)
OTHER = RobotSpec("r2", 0.25, 0.5, 1.0)
FLOOR = ScanSettings(sees_robots=True)
POSES = (Pose2D(0.0, 4.0, 0.0), Pose2D(10.0, 4.0, math.pi))

AREA = shapely.box(0.0, 0.0, *ROOM)

Disk = tuple[float, float, float]  # x, y, radius


def scan(pose: Pose2D, stamp: float, *disks: Disk) -> PlanarScan:
    """Half a turn in an empty room with some disks."""
    angle = pose.heading + np.linspace(-math.pi / 2, math.pi / 2, BEAMS)
    ray = np.column_stack((np.cos(angle), np.sin(angle)))
    with np.errstate(divide="ignore"):
        walls = np.where(ray > 0.0, (np.array(ROOM) - pose.position) / ray, -pose.position / ray)
    ranges = np.where(walls > 1e-9, walls, np.inf).min(axis=1)
    for x, y, radius in disks:
        centre = np.array([x, y]) - pose.position
        aside = radius**2 - (ray[:, 0] * centre[1] - ray[:, 1] * centre[0]) ** 2
        hit = (aside >= 0.0) & (ray @ centre > 0.0)
        ranges[hit] = np.minimum(ranges[hit], (ray @ centre)[hit] - np.sqrt(aside[hit]))
    return PlanarScan(stamp, ranges, -math.pi / 2, math.pi / (BEAMS - 1), 0.0, 30.0)


def fusion(*settings_: ScanSettings, **changes: Any) -> AreaFusion:
    sensors = [
        PlanarSensor(f"s{index}", pose, one)
        for index, (pose, one) in enumerate(zip(POSES, settings_, strict=False))
    ]
    return AreaFusion(sensors, FusionSettings(**changes), [ROBOT, OTHER])


def at(robot: RobotSpec, x: float, y: float, stamp: float, speed: float = 0.0) -> RobotState:
    return RobotState(robot.id, Pose2D(x, y, 0.0), stamp, speed)


def clearance(area: UnoccupiedArea, *points: tuple[float, float]) -> FloatArray:
    return area.clearance(np.array(points))


def step(one: AreaFusion, time: float, *disks: Disk, **robots: tuple[float, float]) -> UnoccupiedArea:
    """Measure with all sensors what stands there, robots included, tell where the robots are, and fuse."""
    specs = {"r1": ROBOT, "r2": OTHER}
    bodies = [(*place, specs[name].radius) for name, place in robots.items()]
    for name in specs:
        one.add_state(at(specs[name], *robots.get(name, (-50.0, -50.0)), time))
    for sensor in one.sensors.values():
        seen = (*disks, *bodies) if sensor.settings.sees_robots else disks
        one.add_scan(sensor.id, scan(sensor.pose, time, *seen), time)
    return one.area(time)


@pytest.mark.parametrize("speed", [0.0, 0.3])
def test_a_robot_in_sight_leaves_no_hole_and_its_shadow_comes_from_memory(speed: float) -> None:
    one = fusion(FLOOR, boundary_speed=speed)
    whole = step(one, 0.0)
    for index in range(1, 10):
        time, x = 0.5 * index, 2.0 + 0.25 * index
        area = step(one, time, r1=(x, 4.0))
        # Whole but for what memory loses along the far wall, behind the robot.
        lost = shapely.difference(shapely.intersection(whole.region, AREA), area.region)
        parts = [part for part in shapely.get_parts(lost) if part.area > 1e-4]
        assert all(part.bounds[0] > 10.0 - 1.02 * speed * time - 1e-6 for part in parts)
        assert bool(parts) == (speed > 0.0)
        assert clearance(area, (x, 4.0), (x + 0.5, 4.0), (x + 1.0, 4.0)).min() > 1.0
        assert sum(area.contradictions.values()) == 0


def test_without_having_seen_it_before_the_shadow_is_not_free_but_the_robot_is() -> None:
    for speed in (0.0, 0.3):
        one = fusion(FLOOR, boundary_speed=speed)
        area = step(one, 0.0, r1=(4.0, 4.0))
        assert clearance(area, (4.0, 4.0))[0] == pytest.approx(0.4, abs=0.01)
        assert clearance(area, (5.0, 4.0))[0] < 0.0
        area = step(one, 0.5, r1=(4.0, 4.0), r2=(4.0, 6.0))
        assert clearance(area, (5.0, 4.0))[0] < 0.0, "standing still it hides the same"
        assert clearance(area, (4.0, 6.0))[0] > 0.4


@settings(max_examples=20)
@given(st.floats(1.0, 9.0), st.floats(0.6, 7.4), st.sampled_from((0.0, 0.3)))
def test_nothing_unknown_remains_between_what_beams_saw_and_the_disk(
    x: float, y: float, speed: float
) -> None:
    """From the scanner to the far side of the robot all is free, to within the gap between two beams."""
    one = fusion(FLOOR, boundary_speed=speed)
    area = step(one, 0.0, r1=(x, y))
    centre, sensor = np.array([x, y]), POSES[0].position
    distance = float(np.linalg.norm(centre - sensor))
    ahead = (centre - sensor) / distance
    side = np.array([-ahead[1], ahead[0]])
    along, across = np.meshgrid(np.linspace(0.05, distance + 0.35, 60), np.linspace(-0.25, 0.25, 21))
    points = sensor + along.reshape(-1, 1) * ahead + across.reshape(-1, 1) * side
    cone = ((points > 0.02) & (points < np.array(ROOM) - 0.02)).all(axis=1)
    near = np.linalg.norm(points - centre, axis=1)
    cone &= (near < 0.39) | ((points - centre) @ ahead < 0.0)
    assert clearance(area, *points[cone]).min() >= 0.0


@pytest.mark.parametrize("speed", [0.0, 0.3])
def test_a_person_beside_a_robot_is_an_obstacle(speed: float) -> None:
    for person in ((4.0, 4.8, 0.2), (4.56, 4.0, 0.2), (4.45, 4.45, 0.2)):
        one = fusion(FLOOR, FLOOR, boundary_speed=speed)
        step(one, 0.0, person)
        area = step(one, 0.5, person, r1=(4.0, 4.0))
        assert clearance(area, person[:2])[0] <= -0.1
        assert clearance(area, (4.0, 4.0))[0] > 0.25


def test_a_sensor_above_the_robots_never_takes_what_it_sees_for_one() -> None:
    one = fusion(ScanSettings(), FLOOR)
    step(one, 0.0)
    area = step(one, 0.5, (4.0, 4.0, 0.3), r1=(4.0, 4.0))  # stands where the robot says it is
    assert clearance(area, (3.7, 4.0))[0] <= 0.01
    above = one._latest["s0"][1]
    kept = above.returns[np.linalg.norm(above.returns - [4.0, 4.0], axis=1) < 0.31]
    assert len(kept) > 5
    assert clearance(area, *kept).max() <= 0.002


def test_where_a_robot_is_unknown_its_returns_are_obstacles() -> None:
    one = fusion(FLOOR)
    one.add_scan("s0", scan(POSES[0], 0.0), 0.0)
    one.area(0.0)
    one.add_scan("s0", scan(POSES[0], 1.0, (4.0, 4.0, 0.3)), 1.0)
    assert clearance(one.area(1.0), (4.0, 4.0))[0] < 0.0
    one.add_state(at(ROBOT, 4.0, 4.0, 0.5))
    one.add_state(at(OTHER, 9.0, 4.0, 0.5))
    assert clearance(one.area(1.0), (4.0, 4.0))[0] < 0.0, "half a second ago is no answer"
    one.add_state(at(ROBOT, 4.0, 4.0, 1.5))
    one.add_scan("s0", scan(POSES[0], 1.2, (4.0, 4.0, 0.3)), 1.5)
    assert clearance(one.area(1.5), (4.0, 4.0))[0] >= 0.39


def test_a_robot_that_drives_on_after_its_last_state_is_still_found() -> None:
    one = fusion(FLOOR)
    one.add_state(at(ROBOT, 4.0, 4.0, 0.0, 0.5))
    one.add_state(at(OTHER, -50.0, 0.0, 0.0))
    for driven in (0.0, 0.05, 0.1):
        later = fusion(FLOOR)
        later.add_state(at(ROBOT, 4.0, 4.0, 0.0, 0.5))
        later.add_state(at(OTHER, -50.0, 0.0, 0.0))
        later.add_scan("s0", scan(POSES[0], 0.2, (4.0 + driven, 4.0, 0.3)), 0.2)
        # Free is only what the robot covers whatever it did: 0.4 m less the 0.1 m that it may be off.
        assert clearance(later.area(0.2), (4.1, 4.0))[0] >= 0.29


def test_between_sampling_instants_the_disk_goes_with_the_robot() -> None:
    one = fusion(FLOOR, boundary_speed=0.3)
    step(one, 0.0, r1=(2.0, 4.0))
    one.add_scan("s0", scan(POSES[0], 0.7, (2.35, 4.0, 0.3)), 0.7)
    for robot, x in ((ROBOT, 2.5), (OTHER, -50.0)):
        one.add_state(at(robot, x, 4.0, 1.0))
    area = one.area(1.0)
    assert clearance(area, (2.5, 4.0))[0] >= 0.3
    assert clearance(area, (2.2, 4.0))[0] > 0.4, "and what lies between scanner and robot stays free"


def test_states_that_lie_are_refused_and_change_nothing() -> None:
    one = fusion(FLOOR, clock_tolerance=0.1)
    one.add_state(at(ROBOT, 4.0, 4.0, 1.0), 1.0)
    for state, now, text in (
        (
            at(RobotSpec("r9", 0.3, 0.5, 1.0), 0.0, 0.0, 1.0),
            1.0,
            r"unknown robot 'r9'; known: \['r1', 'r2'\]",
        ),
        (
            at(ROBOT, 5.0, 4.0, 1.3),
            1.1,
            r"state of robot 'r1' stamped 1\.300 s is 0\.200 s ahead of the clock",
        ),
        (at(ROBOT, 5.0, 4.0, 0.9), 1.1, "older than its last"),
        (at(ROBOT, math.nan, 4.0, 1.1), 1.1, "not finite"),
    ):
        with pytest.raises(InvalidInput, match=text):
            one.add_state(state, now)
    one.add_state(at(OTHER, -50.0, 0.0, 1.1), 1.1)
    one.add_scan("s0", scan(POSES[0], 1.1, (4.0, 4.0, 0.3)), 1.1)
    assert clearance(one.area(1.1), (4.0, 4.0))[0] >= 0.3


def test_robots_need_different_names_and_a_reset_forgets_where_they_are() -> None:
    with pytest.raises(InvalidInput, match="need different ids"):
        AreaFusion([PlanarSensor("s0", POSES[0], FLOOR)], robots=[ROBOT, ROBOT])
    one = fusion(FLOOR)
    step(one, 5.0, r1=(4.0, 4.0))
    one.reset()
    one.add_scan("s0", scan(POSES[0], 1.0, (4.0, 4.0, 0.3)), 1.0)
    assert clearance(one.area(1.0), (4.0, 4.0), (5.0, 4.0)).max() < 0.0


def test_lengths_are_not_kept_for_a_fan_of_other_beams() -> None:
    one = fusion(FLOOR)
    step(one, 0.0)
    whole = scan(POSES[0], 0.5, (4.0, 4.0, 0.3))
    half = PlanarScan(0.5, whole.ranges[::2], whole.angle_min, 2 * whole.angle_increment, 0.0, 30.0)
    for robot, x in ((ROBOT, 4.0), (OTHER, -50.0)):
        one.add_state(at(robot, x, 4.0, 0.5))
    one.add_scan("s0", half, 0.5)
    assert clearance(one.area(0.5), (5.0, 4.0))[0] < 0.0


def test_without_memory_nothing_behind_a_robot_is_free_where_things_move() -> None:
    one = fusion(FLOOR, boundary_speed=0.3, memory=False)
    assert clearance(step(one, 0.0), (5.0, 4.0))[0] > 1.0
    area = step(one, 0.5, r1=(4.0, 4.0))
    assert clearance(area, (5.0, 4.0))[0] < 0.0
    assert clearance(area, (4.0, 4.0))[0] >= 0.39
