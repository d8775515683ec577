"""The nodes of a scene as processes over DDS, and a node of the test that hears and speaks beside them."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path as FilePath
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from rclpy.node import Node

from snnav_ros.available import make_executor
from snnav_ros.bringup import plan_nodes
from snnav_ros.convert import MAP_FRAME
from snnav_ros.processes import ChildProcesses
from snnav_sim.scene import parse_any_scene
from snnav_sim.warm_up import warm_up


class ProcessSite:
    """What tests of processes share; close it at the end."""

    def __init__(self, children: ChildProcesses, context: rclpy.Context, longest: float) -> None:
        self.children = children
        self.texts: list[str] = []  # what nodes say of themselves
        self.node = Node("site", context=context, enable_rosout=False, start_parameter_services=False)
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 100)
        self.executor = make_executor(context)
        self.executor.add_node(self.node)
        self._longest = longest

    def start(
        self,
        scene: str,
        folder: FilePath,
        changes: Mapping[str, dict[str, Any]] | None = None,
        planners: int = 1,
    ) -> None:
        """Start all nodes of a scene; `changes` are further parameters of nodes by their names."""
        file = folder / "scene.yaml"
        file.write_text(scene, encoding="utf-8")
        plans = plan_nodes(
            parse_any_scene(scene, file.name), file, realtime=True, processes=True, seed=1, planners=planners
        )
        for plan in plans:
            parameters = {**plan.parameters, **(changes or {}).get(plan.name, {})}
            self.children.start(plan.name, f"snnav_ros.nodes.{plan.module}_node", parameters)

    def until(self, condition: Callable[[], bool], what: str) -> None:
        """Work until something holds; a process that ended, or too long a time, fails the test."""
        end = time.monotonic() + self._longest
        while not condition():
            assert not (ended := self.children.ended()), ended
            assert time.monotonic() < end, f"waited {self._longest} s for {what}; last said {self.texts[-4:]}"
            self.executor.spin_once(timeout_sec=0.02)

    def until_under_way(
        self, place: Callable[[], Sequence[float]], goal: Callable[[], Sequence[float]], away: float
    ) -> None:
        """Work until a robot has moved half a metre towards a goal that is farther away than a distance [m]."""
        begin, aim = place(), goal()

        def moves() -> bool:
            nonlocal begin, aim
            here = place()
            if aim != goal():  # it has just arrived, and stays anyway
                begin, aim = here, goal()
            return math.dist(begin, here) > 0.5 and math.dist(aim, here) > away

        self.until(moves, "a robot that moves and is not about to arrive")

    def until_said(self, text: str) -> None:
        """Work until a node said something of itself."""
        self.until(lambda: any(text in said for said in self.texts), f"somebody to say {text!r}")

    def close(self) -> None:
        self.executor.shutdown()
        self.node.destroy_node()

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        self.texts += [f"{status.name}: {status.message}" for status in message.status]


def goal_at(x: float, y: float, z: float = 0.0) -> PoseStamped:
    goal = PoseStamped()
    goal.header.frame_id = MAP_FRAME
    goal.pose.position.x, goal.pose.position.y, goal.pose.position.z = x, y, z
    return goal


@contextmanager
def processes(folder: FilePath, domain: int) -> Iterator[tuple[ChildProcesses, rclpy.Context]]:
    """Processes that end with the test and log into a folder, and a ROS of their domain."""
    warm_up()
    with ExitStack() as stack:
        context = rclpy.Context()
        rclpy.init(args=[], context=context, domain_id=domain)
        stack.callback(rclpy.try_shutdown, context=context)
        yield stack.enter_context(ChildProcesses(folder, domain)), context
