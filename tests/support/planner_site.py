"""A planner node of one cart in an empty hall; areas, odometry and time are in the hands of the test."""

from __future__ import annotations

from typing import Any

import shapely
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry, Path
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import PointCloud2

from snnav_core.area.planar import UnoccupiedArea
from snnav_core.types import Pose2D
from snnav_ros.convert import (
    area_to_message,
    odometry_to_message,
    stamp_message,
    verdict_from_message,
)
from snnav_ros.nodes.planner import PlannerNode
from snnav_ros.qos import LATCHED

SECOND = 10**9
SITE = {
    "sampling_interval": 1.0,
    "safety_margin": 0.5,
    "boundary_speed": 0.0,
    "robots": ["cart"],
    "cart.radius": 0.3,
    "cart.speed": 0.5,
    "cart.max_turn_rate": 1.0,
    "use_sim_time": True,
}
HALL = shapely.MultiPolygon([shapely.box(0.0, 0.0, 12.0, 6.0)])


class Site:
    """A planner of one cart in an empty hall."""

    def __init__(self, graph: Any, **changes: Any) -> None:
        self.graph = graph
        self.paths = graph.hear(Path, "cart/path")
        self.verdicts = graph.hear(DiagnosticStatus, "cart/certificate")
        self.diagnostics = graph.hear(DiagnosticArray, "/diagnostics")
        self.node = graph.add(PlannerNode, lean=False, **{**SITE, **changes})
        self.area = graph.speak(PointCloud2, "unoccupied_area", LATCHED)
        self.odometry = graph.speak(Odometry, "cart/odom")
        self.goal = graph.speak(PoseStamped, "cart/goal_pose", 1)
        self.clock = graph.speak(Clock, "/clock", 1)

    def at(self, stamp: int) -> None:
        self.clock.publish(Clock(clock=stamp_message(stamp)))
        self.graph.until(lambda: self.node.get_clock().now().nanoseconds == stamp, "the clock")

    def drive_to(self, x: float, y: float, frame: str = "map") -> None:
        message = PoseStamped()
        message.header.frame_id = frame
        message.pose.position.x, message.pose.position.y = x, y
        self.goal.publish(message)
        if frame == "map":
            self.graph.until(lambda: self.node._goals.get("cart") == (x, y), "the goal")

    def stand(self, stamp: int, pose: Pose2D, frame: str = "map") -> None:
        self.at(stamp)
        message = odometry_to_message("cart", pose, 0.0, 0.0, stamp)
        message.header.frame_id = frame
        self.odometry.publish(message)
        topic = "cart/odom"
        self.graph.until(
            lambda: self.node._states.get("cart", (-1,))[0] == stamp or topic in self.node._problems,
            "odometry",
        )

    def status(self, name: str) -> DiagnosticStatus:
        stamp = self.paths[-1].header.stamp
        self.graph.until(
            lambda: self.diagnostics and self.diagnostics[-1].header.stamp == stamp, "diagnostics"
        )
        return next(one for one in self.diagnostics[-1].status if one.name == name)

    def step(self, stamp: int, region: shapely.MultiPolygon = HALL) -> tuple[Any, Any]:
        """Publish an area; return path and verdict of the step that follows."""
        self.at(stamp)
        count = len(self.paths)
        self.area.publish(area_to_message(UnoccupiedArea(stamp / SECOND, region)))
        return self.answer(count)

    def answer(self, count: int) -> tuple[Any, Any]:
        self.graph.until(lambda: len(self.paths) > count and len(self.verdicts) > count, "a decision")
        return self.paths[-1], verdict_from_message(self.verdicts[-1])
