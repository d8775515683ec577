"""The navigator's decision step, against the time that OMPL's planners need for a path of the same length."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import shapely
from harness import Row, absent, limited, milliseconds, repeat, stopwatch

from snnav_core.area.fusion import AreaFusion
from snnav_core.area.planar import UnoccupiedArea, reduce_area
from snnav_core.navigator.ground import GroundNavigator
from snnav_core.types import FloatArray, PlannedPath, Pose2D, RobotState
from snnav_sim.configure import fusion_settings, navigator_settings, planar_sensor
from snnav_sim.devices.lms200 import Lms200
from snnav_sim.scene import find_scene, load_scene
from snnav_sim.scene_types import Scene
from snnav_sim.world import World

LIMIT_MS = 50.0
PASSES = 3
PEER_LIMIT = 5.0
PEER_SEEDS = 5


def areas_of(scene: Scene) -> Callable[[float], UnoccupiedArea]:
    """Return the unoccupied area of the scene as a function of time [s]."""
    world = World(scene)
    devices = [Lms200(sensor, world, scene.seed) for sensor in scene.sensors]
    fusion = AreaFusion([planar_sensor(sensor) for sensor in scene.sensors], fusion_settings(scene))

    def area(time: float) -> UnoccupiedArea:
        for device in devices:
            fusion.add_scan(device.sensor.id, device.scan(time))
        return fusion.area(time)

    return area


def drive(scene: Scene, times: list[float]) -> PlannedPath:
    """Let one robot follow its paths exactly to the target; append the time of every decision; return the first."""
    area_at = areas_of(scene)
    robot, delta = scene.robots[0], scene.sampling_interval
    navigator = GroundNavigator([robot.spec], navigator_settings(scene))
    pose, first, now = robot.pose, None, 0.0
    while now < scene.time_limit:
        area = area_at(now)
        state = RobotState(robot.id, pose, now)
        result: Any = None

        def decide(now: float = now, area: UnoccupiedArea = area, state: RobotState = state) -> None:
            nonlocal result
            result = navigator.step(now, area, {robot.id: state}, {robot.id: robot.target})

        times.append(stopwatch(decide))
        plan = result.decisions[robot.id]
        if not isinstance(plan, PlannedPath):
            break
        first = first or plan
        here, ahead = plan.path.positions_at(np.array([now + delta - 1e-3, now + delta]))
        heading = plan.path.turn_to
        if heading is None:
            heading = math.atan2(*(ahead - here)[::-1]) if np.any(ahead != here) else pose.heading
        pose, now = Pose2D(float(ahead[0]), float(ahead[1]), heading), now + delta
    if first is None or math.dist(pose.position, robot.target) > robot.speed * delta:
        raise RuntimeError(f"the robot stopped at {pose.position} after {now} s: {plan}")
    return first


def ompl_time(
    planner: str, region: shapely.Geometry, start: FloatArray, goal: FloatArray, length: float
) -> float:
    """Return the median time in which an OMPL planner finds a path no longer than `length` [s]; inf if it does not."""
    from ompl import base, geometric, util

    util.setLogLevel(util.LogLevel.LOG_NONE)
    west, south, east, north = region.bounds

    class InsideRegion(base.MotionValidator):  # type: ignore[misc]
        def checkMotion(self, one: Any, other: Any, *_: Any) -> bool:  # noqa: N802
            return bool(region.covers(shapely.linestrings([[one[0], one[1]], [other[0], other[1]]])))

    def solve(seed: int) -> float:
        util.RNG.setSeed(seed)
        space = base.RealVectorStateSpace(2)
        bounds = base.RealVectorBounds(2)
        for axis, (low, high) in enumerate(((west, east), (south, north))):
            bounds.setLow(axis, low)
            bounds.setHigh(axis, high)
        space.setBounds(bounds)
        setup = geometric.SimpleSetup(space)
        information = setup.getSpaceInformation()
        setup.setStateValidityChecker(lambda state: bool(shapely.contains_xy(region, state[0], state[1])))
        validator = InsideRegion(information)
        information.setMotionValidator(validator)
        states = []
        for point in (start, goal):
            state = space.allocState()
            state[0], state[1] = float(point[0]), float(point[1])
            states.append(state)
        setup.setStartAndGoalStates(*states)
        objective = base.PathLengthOptimizationObjective(information)
        objective.setCostThreshold(base.Cost(length))
        setup.setOptimizationObjective(objective)
        setup.setPlanner(getattr(geometric, planner)(information))
        setup.setup()
        taken = stopwatch(lambda: setup.solve(PEER_LIMIT))
        found = setup.haveExactSolutionPath() and setup.getSolutionPath().length() <= length
        return taken if found else math.inf

    return float(np.median([solve(seed) for seed in range(1, PEER_SEEDS + 1)]))


def ompl_rows(scene: Scene, first: PlannedPath) -> list[Row]:
    """Measure RRT* and BIT* where the first path ran: at the least distance that it kept from the boundary."""
    try:
        import ompl  # noqa: F401
    except ImportError:
        return [absent("OMPL")]
    robot = scene.robots[0]
    area = areas_of(scene)(0.0).region
    chain = np.vstack([first.path.points, robot.target])
    region = reduce_area(area, float(shapely.distance(area.boundary, shapely.linestrings(chain))))
    shapely.prepare(region)
    length = float(np.linalg.norm(np.diff(chain, axis=0), axis=1).sum())
    rows = []
    for planner, name in (("RRTstar", "RRT*"), ("BITstar", "BIT*")):
        for share, words in ((1.0, "the same length"), (1.01, "1 % more")):
            seconds = ompl_time(planner, region, chain[0], chain[-1], share * length)
            result = f"{seconds * 1e3:,.0f} ms" if math.isfinite(seconds) else f"not in {PEER_LIMIT:g} s"
            what = f"OMPL {name} to {words}, {share * length:.1f} m, any turn ({PEER_SEEDS} seeds)"
            rows.append(Row(what, result, seconds, peer=True))
    return rows


def rows() -> list[Row]:
    """Measure all decisions of whole drives, then the first one alone, then the peers."""
    scene = load_scene(find_scene("thesis_ch3_scene1"))
    first = drive(scene, [])  # compiles
    times: list[float] = []
    for _ in range(PASSES):
        first = drive(scene, times)
    robot, area = scene.robots[0], areas_of(scene)(0.0)
    state = RobotState(robot.id, robot.pose, 0.0)

    def first_decision() -> object:
        navigator = GroundNavigator([robot.spec], navigator_settings(scene))
        return navigator.step(0.0, area, {robot.id: state}, {robot.id: robot.target})

    cold = repeat(first_decision, 20)
    return [
        Row(
            "snnav, first decision: search, adjust, certify",
            milliseconds(cold),
            float(np.median(cold)),
        ),
        limited(f"snnav, all {len(times)} decisions of {PASSES} drives", np.array(times), LIMIT_MS),
        *ompl_rows(scene, first),
    ]
