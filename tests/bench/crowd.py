"""As many robots in a scene as are asked for."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import shapely

from snnav_core.types import FloatArray
from snnav_sim.scene_types import Point, RobotScene, Scene
from snnav_sim.world import World

SEED = 100
APART = 2.5  # [m], between two starts or two targets
CLEAR = 1.5  # [m], from walls and obstacles
WALKERS = 2.5  # [m], from the ways of walkers
FAR = 20.0  # [m], from start to target
TRIES = 100_000


def crowd(scene: Scene, count: int, kinds: Sequence[RobotScene] = ()) -> Scene:
    """Return the scene with its first `count` robots, or with all of them and more at random free places.

    New ones are like those of the scene (or `kinds`) in turn, and come last in priority.
    """
    kinds = kinds or scene.robots
    robots = list(scene.robots[:count])
    draws = np.random.default_rng(SEED)
    free = World(replace(scene, movers=())).free_region(0.0).buffer(-CLEAR)
    for walker in scene.movers:
        free = free.difference(shapely.LineString(walker.waypoints).buffer(WALKERS))
    shapely.prepare(free)
    while len(robots) < count:
        kind = kinds[len(robots) % len(kinds)]
        start = _place(draws, scene, free, [robot.start for robot in robots])
        target = _place(draws, scene, free, [robot.target for robot in robots], beyond=start)
        heading = math.atan2(target[1] - start[1], target[0] - start[0])
        heading = math.radians(round(math.degrees(heading)))
        name = f"{kind.id.rpartition('_')[0]}_{len(robots) + 1}"
        robots.append(replace(kind, id=name, start=start, heading=heading, target=target))
    return replace(scene, robots=tuple(robots))


def _place(
    draws: np.random.Generator,
    scene: Scene,
    free: shapely.Geometry,
    taken: Sequence[Point],
    beyond: Point | None = None,
) -> Point:
    """Draw a free place apart from those taken and, if given, far from another."""
    low, high = scene.workspace.min(axis=0), scene.workspace.max(axis=0)
    others: FloatArray = np.array(taken, dtype=np.float64).reshape(-1, 2)
    for _ in range(TRIES):
        x, y = np.round(draws.uniform(low, high), 1).tolist()
        if len(others) and np.hypot(*(others - (x, y)).T).min() < APART:
            continue
        if beyond is not None and math.dist((x, y), beyond) < FAR:
            continue
        if shapely.contains_xy(free, x, y):
            return x, y
    raise RuntimeError(f"{scene.name} has no room for another robot besides {len(taken)}")
