"""Which nodes a scene needs, by name, and when each takes part in lockstep."""

from __future__ import annotations

from collections.abc import Sequence

from snnav_core.errors import InvalidInput
from snnav_sim.scene import AnyScene, RobotScene, SpaceScene
from snnav_sim.space_types import FlyerScene

__all__ = [
    "CLOCK",
    "FUSION",
    "TRACKER",
    "device_of",
    "every_sample",
    "every_tick",
    "is_unplanned",
    "share_robots",
]

CLOCK, FUSION, TRACKER = "clock_node", "fusion_node", "tracker_node"

_PLANNER, _GLOBAL_PLANNER = "planner_node", "global_planner_node"


def share_robots(scene: AnyScene, planners: int = 1) -> dict[str, list[str]]:
    """Return names of planner nodes and the robots that each of them serves, in the order in which they join.

    Raises
    ------
    InvalidInput
        If there are fewer robots than planners, or the scene is in space or asks for the global planner, of which there
        is one.
    """
    robots = [
        robot.id for robot in sorted(planned_robots(scene), key=lambda one: scene.instant(one.joins_at))
    ]
    if isinstance(scene, SpaceScene) and planners > 1:
        raise InvalidInput(f"{planners} planners for scene {scene.name}: in space one serves all; give 1")
    if planners == 1:
        return {_GLOBAL_PLANNER if scene.plans_globally else _PLANNER: robots}
    if scene.plans_globally:
        raise InvalidInput(
            f"{planners} planners for scene {scene.name}: one global planner serves all; give 1"
        )
    if not 1 <= planners <= len(robots):
        raise InvalidInput(f"{planners} planners for {len(robots)} robots; give 1 to {max(1, len(robots))}")
    bounds = [round(index * len(robots) / planners) for index in range(planners + 1)]
    return {f"planner_{index + 1}": robots[bounds[index] : bounds[index + 1]] for index in range(planners)}


def planned_robots(scene: AnyScene) -> tuple[RobotScene | FlyerScene, ...]:
    """Return the robots that planners know of: nobody plans for one that follows a curve, or around it."""
    return scene.planned if isinstance(scene, SpaceScene) else scene.robots


def device_of(scene: AnyScene) -> str:
    """Return the module of the nodes that are the sensors of a scene, without its ending."""
    return "tof" if isinstance(scene, SpaceScene) else "lms200"


def is_unplanned(scene: AnyScene) -> bool:
    """Whether all robots follow curves: then there is nothing to see and to plan."""
    return isinstance(scene, SpaceScene) and bool(scene.robots) and not scene.planned


def every_tick(scene: AnyScene) -> tuple[str, ...]:
    """Return the names of the nodes of a scene that take part in every tick of lockstep."""
    robots = tuple(robot.id for robot in scene.robots)
    if isinstance(scene, SpaceScene):  # cameras hear where the robots are, and look at sampling instants
        return robots
    return robots + tuple(sensor.id for sensor in scene.sensors if sensor.sees_robots)


def every_sample(scene: AnyScene, planners: Sequence[str] = ()) -> tuple[str, ...]:
    """Return the names of the nodes of a scene that take part at sampling instants, in the order of the data.

    `planners` are the names of the planner nodes, by default that of the only one.
    """
    if is_unplanned(scene):
        return ()
    sensors = tuple(sensor.id for sensor in scene.sensors)
    tracker = (TRACKER,) if scene.plans_globally else ()
    return *sensors, FUSION, *tracker, *(planners or share_robots(scene))
