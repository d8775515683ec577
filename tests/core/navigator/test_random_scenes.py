"""In random rooms every published path keeps its margin, and so does the robot that follows it, up to the target."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import shapely
from shapely.geometry import MultiPolygon

from snnav_core.area.planar import UnoccupiedArea, as_multipolygon
from snnav_core.navigator.ground import GroundNavigator
from snnav_core.navigator.settings import NavigatorSettings, RobotDistances
from snnav_core.types import PlannedPath, Pose2D, RobotSpec, RobotState, Stop, StopReason

WIDTH, HEIGHT = 18.0, 12.0


def random_room(seed: int) -> MultiPolygon:
    """Return a room without three to seven star polygons."""
    generator = np.random.default_rng(seed)
    obstacles = []
    for _ in range(int(generator.integers(3, 8))):
        count = int(generator.integers(3, 8))
        angle = 2.0 * math.pi * (np.arange(count) + generator.uniform(0.0, 0.8, count)) / count
        radius = generator.uniform(0.3, 2.2) * generator.uniform(0.5, 1.0, count)
        centre = generator.uniform((1.0, 1.0), (WIDTH - 1.0, HEIGHT - 1.0))
        obstacles.append(
            shapely.Polygon(centre + radius[:, None] * np.column_stack((np.cos(angle), np.sin(angle))))
        )
    room = shapely.box(0.0, 0.0, WIDTH, HEIGHT)
    return as_multipolygon(shapely.difference(room, shapely.union_all(shapely.make_valid(obstacles))))


def start_and_goal(region: MultiPolygon, distance: float, seed: int) -> tuple[Pose2D, tuple[float, float]]:
    """Return a pose and a far target in the largest component of the area reduced by a distance."""
    generator = np.random.default_rng(seed)
    component = max(shapely.get_parts(region.buffer(-distance)), key=shapely.area)
    points = generator.uniform((0.0, 0.0), (WIDTH, HEIGHT), (400, 2))
    points = points[shapely.contains_xy(component, points[:, 0], points[:, 1])]
    far = points[np.argmax(np.linalg.norm(points - points[0], axis=1))]
    start = Pose2D(float(points[0, 0]), float(points[0, 1]), float(generator.uniform(-math.pi, math.pi)))
    return start, (float(far[0]), float(far[1]))


def run(closed_loop: Callable[..., Any], seed: int, robot: RobotSpec, settings: NavigatorSettings) -> None:
    distances = RobotDistances(robot, settings)
    needed = (
        settings.safety_margin + settings.boundary_speed * settings.time_window * settings.sampling_interval
    )
    region = random_room(seed)
    pose, goal = start_and_goal(region, 1.03 * (needed + distances.tolerance + distances.reserve), seed)
    area = UnoccupiedArea(0.0, region)
    log = closed_loop(
        GroundNavigator([robot], settings), area.restamped, {robot.id: pose}, {robot.id: goal}, 150.0
    )
    last = log.last(robot.id)
    assert isinstance(last, Stop), "still on its way"
    assert last.reason is StopReason.ARRIVED, last.message
    assert math.dist(log.positions(robot.id)[-1], goal) <= distances.arrival
    points = shapely.points(log.positions(robot.id))
    assert shapely.covers(region, points).all()
    assert shapely.distance(points, region.boundary).min() >= settings.safety_margin, "no tolerance"


@pytest.mark.parametrize("seed", range(14))
def test_the_robot_arrives_and_keeps_the_margin_at_every_sample(
    closed_loop: Callable[..., Any], seed: int
) -> None:
    run(closed_loop, seed, RobotSpec("robot", 0.3, 1.0, 2.0), NavigatorSettings(0.5, 0.45, 4))


@pytest.mark.parametrize("seed", range(100, 104))
def test_also_where_corners_are_tighter_than_the_turning_circle(
    closed_loop: Callable[..., Any], seed: int
) -> None:
    """d_s is half of R_min: what cannot be driven in a curve is driven in legs with turns between them."""
    run(closed_loop, seed, RobotSpec("robot", 0.3, 1.0, 1.0), NavigatorSettings(0.5, 0.5, 4))


@pytest.mark.parametrize("seed", range(200, 204))
def test_also_when_the_boundary_may_move(closed_loop: Callable[..., Any], seed: int) -> None:
    run(
        closed_loop,
        seed,
        RobotSpec("robot", 0.3, 1.0, 2.0),
        NavigatorSettings(0.5, 0.45, 4, boundary_speed=0.2),
    )


def test_the_same_inputs_give_the_same_paths(closed_loop: Callable[..., Any]) -> None:
    region = random_room(3)
    settings = NavigatorSettings(0.5, 0.45, 4)
    pose, goal = start_and_goal(region, 0.6, 3)
    logs = []
    for _ in range(2):
        navigator = GroundNavigator([RobotSpec("robot", 0.3, 1.0, 2.0)], settings)
        area = UnoccupiedArea(0.0, region)
        logs.append(closed_loop(navigator, area.restamped, {"robot": pose}, {"robot": goal}, 60.0))
    assert logs[0].digests() == logs[1].digests()
    assert sum(isinstance(result.decisions["robot"], PlannedPath) for result in logs[0].results) > 5


def test_the_path_does_not_depend_on_where_the_rings_of_the_area_start() -> None:
    """A message may begin each ring elsewhere; the way stays the same but for rounding."""
    region = random_room(3)
    pose, goal = start_and_goal(region, 0.6, 3)
    area = UnoccupiedArea(0.0, region)
    rolled = UnoccupiedArea.from_rings(0.0, [np.roll(ring, 2, axis=0) for ring in area.rings])
    lengths = []
    for one in (area, rolled):
        navigator = GroundNavigator([RobotSpec("robot", 0.3, 1.0, 2.0)], NavigatorSettings(0.5, 0.45, 4))
        lengths.append(first_length(navigator, one, pose, goal))
    assert lengths[0] == pytest.approx(lengths[1], rel=0.01)


def first_length(
    navigator: GroundNavigator, area: UnoccupiedArea, pose: Pose2D, goal: tuple[float, float]
) -> float:
    """Return the length of the first path, after turns on the spot."""
    for step in range(12):
        time = 0.5 * step
        plan = navigator.step(
            time, area.restamped(time), {"robot": RobotState("robot", pose, time)}, {"robot": goal}
        )
        decision = plan.decisions["robot"]
        assert isinstance(decision, PlannedPath)
        if decision.path.turn_to is None:
            return decision.path.length
        pose = Pose2D(pose.x, pose.y, decision.path.turn_to)
    raise AssertionError("only turns")
