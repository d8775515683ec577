"""A planner node in space-time for one cart in a hall, and what trackers and base would say."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry, Path
from nav_msgs.srv import GetPlan
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import PointCloud2
from visualization_msgs.msg import MarkerArray

from snnav_core.obstacles import MovingObstacle
from snnav_core.types import Pose2D
from snnav_ros.convert import (
    obstacles_to_message,
    odometry_to_message,
    rings_to_message,
    stamp_message,
    verdict_from_message,
)
from snnav_ros.nodes.global_planner import GlobalPlannerNode
from snnav_ros.qos import LATCHED

SECOND = 10**9
INTERVAL = 3 * SECOND // 10
SITE = {
    "sampling_interval": 0.3,
    "safety_margin": 0.6,
    "robots": ["cart"],
    "cart.radius": 0.3,
    "cart.speed": 0.5,
    "cart.max_turn_rate": 2.0,
    "lead": 0,
    "use_sim_time": True,
}
HALL = np.array([[0.0, 0.0], [12.0, 0.0], [12.0, 8.0], [0.0, 8.0]])
PILLAR = np.array([[5.5, 3.0], [6.5, 3.0], [6.5, 4.5], [5.5, 4.5]])


def bodies(stamp: int, walker: float = 0.0) -> list[MovingObstacle]:
    """Return a pillar, and a walker far from the way with a speed along x [m/s]."""
    time = stamp / SECOND
    place = [3.0 + walker * time, 7.0]
    walks = MovingObstacle("body_2", [place], 0.3, [walker, 0.0], time, 0.005, 0.01)
    return [MovingObstacle("body_1", PILLAR, 0.0, [0.0, 0.0], time), walks]


class Site:
    """A planner of one cart in a hall with a pillar."""

    def __init__(self, graph: Any, **changes: Any) -> None:
        self.graph = graph
        self.paths = graph.hear(Path, "cart/path")
        self.verdicts = graph.hear(DiagnosticStatus, "cart/certificate")
        self.candidates = graph.hear(MarkerArray, "candidates", LATCHED)
        self.diagnostics = graph.hear(DiagnosticArray, "/diagnostics")
        self.node = graph.add(GlobalPlannerNode, lean=False, **{**SITE, **changes})
        self.obstacles = graph.speak(PointCloud2, "obstacles", LATCHED)
        self.workspace = graph.speak(PointCloud2, "obstacles/workspace", LATCHED)
        self.odometry = graph.speak(Odometry, "cart/odom")
        self.goal = graph.speak(PoseStamped, "cart/goal_pose", 1)
        self.clock = graph.speak(Clock, "/clock", 1)

    def at(self, stamp: int) -> None:
        self.clock.publish(Clock(clock=stamp_message(stamp)))
        self.graph.until(lambda: self.node.get_clock().now().nanoseconds == stamp, "the clock")

    def drive_to(self, x: float, y: float) -> None:
        self.goal.publish(posed(x, y))
        self.graph.until(lambda: self.node._goals.get("cart") == (x, y), "the goal")

    def stand(self, stamp: int, pose: Pose2D) -> None:
        self.at(stamp)
        self.odometry.publish(odometry_to_message("cart", pose, 0.0, 0.0, stamp))
        self.graph.until(lambda: self.node._states.get("cart", (-1,))[0] == stamp, "odometry")

    def step(
        self, stamp: int, there: Sequence[MovingObstacle] | None = None, rings: Any = (HALL,)
    ) -> tuple[Any, Any]:
        """Publish bodies and workspace; return path and verdict of the step that follows."""
        self.at(stamp)
        count = len(self.paths)
        there = bodies(stamp) if there is None else there
        self.workspace.publish(rings_to_message(rings, stamp))
        self.obstacles.publish(obstacles_to_message(there, stamp))
        return self.answer(count)

    def answer(self, count: int) -> tuple[Any, Any]:
        self.graph.until(lambda: len(self.paths) > count and len(self.verdicts) > count, "a decision")
        return self.paths[-1], verdict_from_message(self.verdicts[-1])

    def status(self, name: str) -> DiagnosticStatus:
        def found() -> list[DiagnosticStatus]:
            return [one for array_ in self.diagnostics for one in array_.status if one.name == name]

        self.graph.until(lambda: bool(found()), f"status {name}")
        return found()[-1]

    def ask(self, goal: PoseStamped, start: PoseStamped | None = None, tolerance: float = 0.0) -> Path:
        request = GetPlan.Request(start=start or PoseStamped(), goal=goal, tolerance=tolerance)
        return self.graph.call(GetPlan, "plan", request).plan


def posed(x: float, y: float, frame: str = "map") -> PoseStamped:
    message = PoseStamped()
    message.header.frame_id = frame
    message.pose.position.x, message.pose.position.y = x, y
    return message


def started(graph: Any, y: float = 2.0, **changes: Any) -> Site:
    """Return a site whose robot goes straight along the hall: below the pillar, unless `y` says otherwise."""
    site = Site(graph, **changes)
    site.drive_to(10.0, y)
    site.stand(SECOND, Pose2D(2.0, y, 0.0))
    return site
