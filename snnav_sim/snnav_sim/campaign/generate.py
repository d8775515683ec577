"""Random scenes of a campaign: each depends on its kind and seed only."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from snnav_core.errors import InvalidInput, PlanningError
from snnav_sim.campaign.flights import draw_flight_scene
from snnav_sim.campaign.halls import Draws, Hall, between, draw_hall, draw_sensors
from snnav_sim.campaign.places import draw_place, without_locked_in
from snnav_sim.campaign.reference import planned_distance, window_distance
from snnav_sim.campaign.walkers import draw_walkers, swept
from snnav_sim.random_scenes import faulty_scene
from snnav_sim.report.optimum import reduced, shortest_path
from snnav_sim.scene import AnyScene
from snnav_sim.scene_faults import FAULT_KINDS
from snnav_sim.scene_types import RobotScene, Scene
from snnav_sim.space_types import SpaceScene
from snnav_sim.world import World

__all__ = ["KINDS", "campaign_scene"]

_STREAM = 0xCA39A  # keeps these random numbers apart from those of the devices and of other scenes
_TRIES = 300
_RESERVE = 0.05  # [m] that starts are farther from everything than they must be: scans are noisy
_WAY = 0.5  # from start to target at least, as a share of the root of the area of the hall
_ANYWHERE = 0.05  # share of targets of single robots that may lie anywhere, in an obstacle too
_WITH_PEOPLE = 0.9  # share of the dynamic scenes
_FASTER = 0.5  # V_max is at most so much of the speed of a robot


def campaign_scene(kind: str, seed: int) -> AnyScene:
    """Return the random scene of one run.

    Parameters
    ----------
    kind : str
        ``static``: one robot, and nothing ever moves (V_max = 0). ``dynamic``: one robot among up to five people who
        walk to and fro. ``multi``: two to twenty robots. ``faults``: `snnav_sim.random_scenes.faulty_scene` with one
        kind of fault, or all of them. ``flight``: one to eight flying robots, see `snnav_sim.campaign.flights`.
    seed : int
        From 0; the seed of the scene too.

    Returns
    -------
    Scene or SpaceScene
        A legal one; starts keep the safety margin of everything.

    Raises
    ------
    InvalidInput
        If the kind is not known.

    Notes
    -----
    Whether targets can be reached is left to chance, and judged afterwards: walls may have no door that is wide enough,
    some targets lie in obstacles or where no sensor looks. What the scenes leave out, because no navigator can answer
    for it:

    - *Walkers do not see the robot*, and nothing is promised to a robot that stands longer than its window. Starts and
      targets are off the lanes: a robot may stand there for a whole window whatever the walkers do. And lanes leave
      a robot room to get out of the way, see `snnav_sim.campaign.walkers.draw_walkers`.
    - *Starts and targets of many robots* are so far apart that all may stand there at once, and every robot has a way
      from its start to its target while all others stand at their targets, or all at their starts, if it has one
      without them. Otherwise one who has arrived could lock others in for ever.
    """
    if kind not in KINDS:
        raise InvalidInput(f"kind {kind!r} of a campaign is not known: give one of {', '.join(KINDS)}")
    if kind == "faults":
        return _faulty(seed)
    draws = np.random.default_rng([_STREAM, KINDS.index(kind), seed])
    if kind == "flight":
        return _flight(draws, seed)
    make, description = _MAKERS[kind]
    for _ in range(_TRIES):
        scene = make(draws)
        if scene is not None:
            return replace(scene, name=f"{kind}_{seed}", description=description, seed=seed)
    raise RuntimeError(f"no scene of kind {kind} with seed {seed} in {_TRIES} tries")


def _flight(draws: Draws, seed: int) -> SpaceScene:
    for _ in range(_TRIES):
        scene = draw_flight_scene(draws)
        if scene is not None:
            description = "Random room, flying robots"
            return replace(scene, name=f"flight_{seed}", description=description, seed=seed)
    raise RuntimeError(f"no scene of kind flight with seed {seed} in {_TRIES} tries")


def _faulty(seed: int) -> Scene:
    """Each kind of fault in turn, then all together."""
    groups: list[Sequence[str]] = [*([kind] for kind in FAULT_KINDS), tuple(FAULT_KINDS)]
    return replace(faulty_scene(seed, groups[seed % len(groups)]), name=f"faults_{seed}")


def _static(draws: Draws) -> Scene | None:
    robot = _robot(draws, "robot_1")
    scene = _empty_scene(draws, draw_hall(draws, 10.0, 26.0, 6, 2), 0.0, robot.radius)
    return _with_robot(draws, scene, robot, _area(scene))


def _dynamic(draws: Draws) -> Scene | None:
    """In every tenth hall somebody could come at any time, but nobody does."""
    robot = _robot(draws, "robot_1")
    hall = draw_hall(draws, 12.0, 22.0, 6, 2)
    speed = between(draws, 0.1, min(0.5, _FASTER * robot.speed))
    scene = _empty_scene(draws, hall, speed, robot.radius, moving=True)
    area, somebody = _area(scene), draws.random() < _WITH_PEOPLE
    if somebody:
        walkers = draw_walkers(draws, area, speed, 5, window_distance(scene, robot))
        scene = replace(scene, movers=walkers)
    return None if somebody and not scene.movers else _with_robot(draws, scene, robot, area)


def _multi(draws: Draws) -> Scene | None:
    robots = [_robot(draws, f"robot_{number}") for number in range(1, int(draws.integers(2, 21)) + 1)]
    slowest, largest = min(robot.speed for robot in robots), max(robot.radius for robot in robots)
    speed = 0.0 if draws.random() < 0.8 else between(draws, 0.05, _FASTER * slowest)
    scene = _empty_scene(draws, draw_hall(draws, 14.0, 25.0, 5, 1), speed, largest)
    area = _area(scene)
    for robot in robots:
        scene = _with_robot(draws, scene, robot, area) or scene
    scene = without_locked_in(scene, area)
    return scene if len(scene.robots) >= 2 else None


def _robot(draws: Draws, name: str) -> RobotScene:
    """A robot of random size and speed that is nowhere yet."""
    speed = between(draws, 0.4, 1.2)
    turn_radius = between(draws, 0.25, 0.8)
    return RobotScene(
        id=name,
        start=(0.0, 0.0),
        heading=0.0,
        target=(0.0, 0.0),
        speed=speed,
        max_turn_rate=round(speed / turn_radius, 2),
        radius=between(draws, 0.15, 0.35),
    )


def _empty_scene(draws: Draws, hall: Hall, speed: float, largest: float, moving: bool = False) -> Scene:
    """A scene without robots and walkers; `speed` is V_max [m/s], `largest` the greatest radius of a robot [m]."""
    return Scene(
        name="hall",
        sampling_interval=float(draws.choice([0.25, 0.5]))
        if speed
        else float(draws.choice([0.25, 0.5, 1.0])),
        border=hall.border,
        obstacles=hall.obstacles,
        safety_margin=round(largest + between(draws, 0.1, 0.3), 2),
        boundary_speed=speed,
        sensors=draw_sensors(draws, hall, 3, 8, rates=moving),
        time_limit=300.0,
    )


def _area(scene: Scene) -> BaseGeometry:
    return World(scene).true_unoccupied_area()


def _with_robot(draws: Draws, scene: Scene, robot: RobotScene, area: BaseGeometry) -> Scene | None:
    """Add a robot apart from those that are there; None where there is no room."""
    starts, targets = _room(scene, robot, area, _RESERVE), _room(scene, robot, area, 0.0)
    if not scene.robots and draws.random() < _ANYWHERE:
        targets = shapely.Polygon(scene.workspace)
    apart = [max(robot.radius, other.radius) + scene.safety_margin + 2.0 * _RESERVE for other in scene.robots]
    start = draw_place(draws, starts, [other.start for other in scene.robots], apart)
    if start is None:
        return None
    way = _WAY * math.sqrt(shapely.Polygon(scene.workspace).area)
    places = [start, *(other.target for other in scene.robots)]
    target = draw_place(draws, targets, places, [way, *apart])
    if target is None:
        return None
    robot = replace(robot, start=start, target=target)
    robot = replace(robot, heading=_headed(draws, robot, reduced(area, planned_distance(scene, robot))))
    return replace(scene, robots=(*scene.robots, robot))


def _room(scene: Scene, robot: RobotScene, area: BaseGeometry, reserve: float) -> BaseGeometry:
    """Where a robot may be while nobody comes, and stand for a whole window by the lanes of the walkers [m, map]."""
    room = reduced(area, planned_distance(scene, robot) + reserve)
    return room.difference(swept(scene.movers).buffer(window_distance(scene, robot) + reserve))


def _headed(draws: Draws, robot: RobotScene, region: BaseGeometry) -> float:
    """A heading, more often than not along the shortest way or near it [rad]."""
    try:
        corner = shortest_path(region, robot.start, robot.target)[1][1]
    except PlanningError:
        corner = np.array(robot.target)
    heading = math.atan2(corner[1] - robot.start[1], corner[0] - robot.start[0])
    heading += float(draws.choice([draws.normal(0.0, 0.5), draws.uniform(-math.pi, math.pi)], p=(0.75, 0.25)))
    return math.radians(round(math.degrees(heading)) % 360)


_MAKERS: dict[str, tuple[Callable[[Draws], Scene | None], str]] = {
    "static": (_static, "Random hall, one robot"),
    "dynamic": (_dynamic, "Random hall, one robot among people who walk to and fro"),
    "multi": (_multi, "Random hall, several robots"),
}
KINDS = (*_MAKERS, "faults", "flight")
"""Kinds of campaigns."""
