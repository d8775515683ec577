"""Says the goals of a scene on `<robot>/goal_pose` when they are due, as a person would."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from typing import Any

from geometry_msgs.msg import PoseStamped
from rclpy.node import Node
from rosgraph_msgs.msg import Clock

from snnav_ros.casting import planned_robots
from snnav_ros.convert import MAP_FRAME, nanoseconds, nanoseconds_from_stamp
from snnav_ros.convert.frames import header
from snnav_ros.nodes.base import LOCKSTEP_TEXT, NodeOptions
from snnav_ros.parameters import ParameterReader
from snnav_ros.qos import CLOCK_INPUT, COMMAND, LOCKSTEP, for_mode
from snnav_ros.scenes import read_scene
from snnav_sim.scene import AnyScene, RobotScene
from snnav_sim.space_types import FlyerScene

__all__ = ["GoalScript", "Operator", "OperatorNode", "needs_operator"]


def _goal_times(scene: AnyScene, robot: RobotScene | FlyerScene) -> list[tuple[int, tuple[float, ...]]]:
    """Return when a robot is sent where: instants [ns] and targets [m, map], in order of time."""
    orders = [(robot.joins_at, robot.target), *((one.time, one.target) for one in robot.retargets)]
    return [(nanoseconds(scene.instant(when)), target) for when, target in orders]


def needs_operator(scene: AnyScene) -> bool:
    """Whether any robot is sent somewhere after the start."""
    return any(_goal_times(scene, robot)[-1][0] > 0 for robot in scene.robots)


class GoalScript:
    """Which goals a planner must have heard in lockstep, so that it does not depend on chance when they count."""

    def __init__(self, scene: AnyScene | None) -> None:
        times: dict[str, list[int]] = {}
        if scene is not None:
            times = {r.id: [when for when, _ in _goal_times(scene, r)] for r in planned_robots(scene)}
        self._times = {name: due for name, due in times.items() if due[-1] > 0}

    @property
    def robots(self) -> list[str]:
        """Ids of robots that are sent somewhere after the start, also of those still to join."""
        return list(self._times)

    def is_complete(self, tick: int, present: Collection[str], stamps: Mapping[str, int]) -> bool:
        """Whether the goals of all robots that are there are as new [ns] as a tick [ns] demands."""
        for name, times in self._times.items():
            due = max((when for when in times if 0 < when <= tick), default=-1)
            if name in present and stamps.get(name, -1) < due:
                return False
        return True


class Operator:
    """Publishes each goal once its instant has come; those of time zero at once.

    Parameters
    ----------
    node : Node
        Its publishers are used.
    scene : Scene or SpaceScene
    lockstep : bool
    said : callable
        Told about every message: topic, message, instant [ns].
    """

    def __init__(
        self, node: Node, scene: AnyScene, lockstep: bool, said: Callable[[str, Any, int], None]
    ) -> None:
        self._said = said
        self._orders = sorted(
            (when, index, target)
            for index, robot in enumerate(planned_robots(scene))
            for when, target in _goal_times(scene, robot)
        )
        self._topics = [f"{robot.id}/goal_pose" for robot in planned_robots(scene)]
        quality = for_mode(lockstep, COMMAND)
        self._mouths = [node.create_publisher(PoseStamped, topic, quality) for topic in self._topics]
        self.reset()

    def reset(self) -> None:
        """Begin anew at time zero."""
        self._next = 0
        self.tell(0)

    def tell(self, now: int) -> None:
        """Say all that is due at a time [ns]."""
        while self._next < len(self._orders) and self._orders[self._next][0] <= now:
            when, index, target = self._orders[self._next]
            goal = PoseStamped(header=header(when, MAP_FRAME))
            goal.pose.position.x, goal.pose.position.y, goal.pose.position.z = (*target, 0.0)[:3]
            goal.pose.orientation.w = 1.0
            self._mouths[index].publish(goal)
            self._said(self._topics[index], goal, when)
            self._next += 1


class OperatorNode(Node):
    """The operator as a node, for launch files; it goes by `/clock`."""

    def __init__(self, options: NodeOptions | None = None) -> None:
        options = options or NodeOptions()
        super().__init__(options.name or "operator_node", **options.keywords())
        reader = ParameterReader(self)
        scene = read_scene(reader, required=True)
        assert scene is not None
        lockstep = reader.value("lockstep", bool, LOCKSTEP_TEXT, False)
        reader.finish()
        self._now = -1
        self._operator = Operator(self, scene, lockstep, lambda topic, goal, when: None)
        self.create_subscription(Clock, "/clock", self._on_clock, LOCKSTEP if lockstep else CLOCK_INPUT)

    def _on_clock(self, message: Clock) -> None:
        now = nanoseconds_from_stamp(message.clock)
        if now < self._now:
            self._operator.reset()
        self._now = now
        self._operator.tell(now)
