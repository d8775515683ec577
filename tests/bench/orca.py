"""ORCA (RVO2 by its Python binding pyrvo) on a scene: holonomic disks that see each other and all walls exactly."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from harness import stopwatch

from snnav_core.errors import PlanningError
from snnav_core.types import FloatArray
from snnav_sim.report.optimum import reduced, shortest_path
from snnav_sim.scene_types import Scene
from snnav_sim.world import World

NEIGHBOURS = 20
SIGHT = 15.0  # [m]
ARRIVED = 0.125  # [m], as in the scenes of 0.5 s at 1 m/s
NEAR_CORNER = 0.3  # [m]; from here on the next corner of the way is aimed at
JITTER = (
    0.1  # [m/s] of the wanted velocity; with 0.01 all robots of swap20 stop for ever in front of each other
)


@dataclass(frozen=True)
class OrcaRun:
    """What ORCA did.

    Parameters
    ----------
    arrived : int
    makespan : float
        When the last robot arrived [s]; inf when not all did.
    separation : float
        Least distance from a centre to the disk of another robot [m].
    step_seconds : ndarray
        Time of every step for all robots [s].
    """

    arrived: int
    makespan: float
    separation: float
    step_seconds: FloatArray


def orca_run(scene: Scene, seed: int) -> OrcaRun | None:
    """Run a scene with ORCA until all arrived or its time limit; None without pyrvo.

    Agents have half of margin and (largest) radius together as their radius, so that ORCA keeps centres apart as our
    margin does; walls are grown so that it keeps our margin from them. Each aims at the next corner of its exact
    shortest way.

    Parameters
    ----------
    scene : Scene
        ORCA decides every control period, and looks as far ahead as our time window.
    seed : int
        Of the jitter.
    """
    try:
        import pyrvo
    except ImportError:
        return None
    radius = max(robot.radius for robot in scene.robots)
    half = 0.5 * (scene.safety_margin + radius)
    ways, period = _ways(scene), scene.control_period
    horizon = scene.time_window * scene.sampling_interval
    agents = pyrvo.RVOSimulator(period, SIGHT, NEIGHBOURS, horizon, horizon, half, 1.0)
    for robot in scene.robots:
        agents.add_agent(list(robot.start))
        agents.set_agent_max_speed(agents.get_num_agents() - 1, robot.speed)
    for ring in _walls(scene, scene.safety_margin - half):
        agents.add_obstacle(ring.tolist())
    agents.process_obstacles()
    draws, seconds, least, ended = np.random.default_rng(seed), [], math.inf, math.inf
    for step in range(1, math.ceil(scene.time_limit / period) + 1):
        before = _positions(agents)
        for index, robot in enumerate(scene.robots):
            wanted = _velocity(before[index], ways[index], robot.speed, period)
            wanted += JITTER * draws.uniform(-1.0, 1.0, 2)
            agents.set_agent_pref_velocity(index, wanted.tolist())
        seconds.append(stopwatch(agents.do_step))
        after = _positions(agents)
        least = min(least, _closest(before, after) - radius)
        if all(
            math.dist(place, robot.target) <= ARRIVED
            for place, robot in zip(after, scene.robots, strict=True)
        ):
            ended = step * period
            break
    arrived = sum(
        math.dist(place, robot.target) <= ARRIVED
        for place, robot in zip(_positions(agents), scene.robots, strict=True)
    )
    return OrcaRun(arrived, ended, least, np.array(seconds))


def _ways(scene: Scene) -> list[list[FloatArray]]:
    """Return the corners of the exact shortest way of every robot at the margin, the target last [m, map]."""
    region = reduced(World(scene).free_region(0.0), scene.safety_margin)
    ways = []
    for robot in scene.robots:
        try:
            _, way = shortest_path(region, robot.start, robot.target)
        except PlanningError:
            way = np.array([robot.start, robot.target])
        ways.append(list(way[1:]))
    return ways


def _walls(scene: Scene, growth: float) -> list[FloatArray]:
    """Return the walls as rings that are solid to the left of their direction [m, map]."""
    free = World(scene).free_region(0.0).buffer(-growth, join_style="mitre")
    rings = []
    for part in shapely.get_parts(shapely.Polygon(scene.workspace).buffer(1.0).difference(free)):
        oriented = shapely.geometry.polygon.orient(part)
        rings += [shapely.get_coordinates(ring)[:-1] for ring in shapely.get_rings(oriented)]
    return rings


def _velocity(place: FloatArray, way: list[FloatArray], speed: float, period: float) -> FloatArray:
    """Return the wanted velocity: to the next corner; the corners that were reached are dropped."""
    while len(way) > 1 and math.dist(place, way[0]) < NEAR_CORNER:
        way.pop(0)
    ahead = way[0] - place
    return np.asarray(ahead * min(speed / max(float(np.hypot(*ahead)), 1e-9), 1.0 / period))


def _positions(agents: Any) -> FloatArray:
    places = [agents.get_agent_position(index) for index in range(agents.get_num_agents())]
    return np.array([[place.x, place.y] for place in places])


def _closest(before: FloatArray, after: FloatArray) -> float:
    """Return the least distance of two centres while all move evenly [m]."""
    first, second = np.triu_indices(len(before), 1)
    begin, change = before[first] - before[second], (after - before)[first] - (after - before)[second]
    share = np.clip(-np.sum(begin * change, axis=1) / np.maximum(np.sum(change**2, axis=1), 1e-300), 0.0, 1.0)
    return float(np.hypot(*(begin + share[:, None] * change).T).min())
