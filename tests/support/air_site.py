"""A flying robot's node, and a planner in an empty room; orders, areas, odometry and time are in a test's hands."""

from __future__ import annotations

from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped, Twist
from nav_msgs.msg import Odometry, Path
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import PointCloud2

from snnav_core.area.grid import Grid
from snnav_core.area.spatial import SpatialArea
from snnav_core.flight_types import FlyerState
from snnav_core.types import Certificate, FloatArray, PathSource, PlannedPath, TimedPath
from snnav_ros.convert import (
    flight_to_message,
    flyer_state_from_message,
    nanoseconds,
    path_to_message,
    stamp_message,
    verdict_from_message,
    verdict_to_message,
)
from snnav_ros.convert.spatial_area import spatial_area_to_message
from snnav_ros.nodes.planner import PlannerNode
from snnav_ros.nodes.robot import RobotNode
from snnav_ros.qos import LATCHED

TICK = 50_000_000
SAMPLE = 4 * TICK
BEE = {
    "robot_id": "bee",
    "base": "flyer",
    "start": [1.0, 2.0, 1.5],
    "speed": 0.7,
    "max_turn_rate": 2.0,
    "radius": 0.2,
    "sampling_interval": 0.2,
    "use_sim_time": True,
}
PLANNER = {
    "sampling_interval": 0.2,
    "safety_margin": 0.4,
    "boundary_speed": 0.0,
    "time_window": 6,
    "robots": ["bee"],
    "bee.radius": 0.2,
    "bee.speed": 0.7,
    "bee.max_turn_rate": 2.0,
    "use_sim_time": True,
}
ROOM = np.array([[0.0, 0.0, 0.0], [6.0, 4.0, 3.0]])


def room(stamp: int) -> SpatialArea:
    """Return the area of an empty room whose walls are known."""
    grid = Grid.covering(ROOM[0], ROOM[1], 0.1)
    centres = grid.centres()
    walls = np.minimum(centres - ROOM[0], ROOM[1] - centres).min(axis=-1).reshape(grid.shape)
    moving = np.full(grid.shape, 2.0, dtype=np.float32)
    return SpatialArea(stamp / 1e9, grid, moving, walls.astype(np.float32))


class Bee:
    """A robot node with a flying base by itself."""

    def __init__(self, graph: Any, **changes: Any) -> None:
        self.graph = graph
        self.odometry = graph.hear(Odometry, "bee/odom")
        self.commands = graph.hear(Twist, "bee/cmd_vel")
        self.diagnostics = graph.hear(DiagnosticArray, "/diagnostics")
        self.node = graph.add(RobotNode, **{**BEE, **changes})
        self.paths = graph.speak(Path, "bee/path", 1)
        self.verdicts = graph.speak(DiagnosticStatus, "bee/certificate", 1)
        self.clock = graph.speak(Clock, "/clock", 1)
        self.tick = 0

    @property
    def now(self) -> float:
        return self.tick * TICK / 1e9

    @property
    def state(self) -> FlyerState:
        return flyer_state_from_message(self.odometry[-1], "bee")

    def run(self, ticks: int) -> None:
        """Let time go on, tick by tick."""
        for _ in range(ticks):
            self.tick += 1
            count = len(self.commands), len(self.odometry)
            self.clock.publish(Clock(clock=stamp_message(self.tick * TICK)))
            self.graph.until(
                lambda count=count: len(self.commands) > count[0] and len(self.odometry) > count[1],
                "a control period",
            )

    def order(self, points: FloatArray, until: float = 100.0) -> TimedPath:
        """Send a path from now on with its certificate."""
        path = TimedPath(self.now, 0.1, points)
        held = Certificate("bee", True, until, 1.0, np.inf, np.inf, 0.0, path.digest())
        message, stamp = path_to_message(path), nanoseconds(self.now)
        self.paths.publish(message)
        plan = PlannedPath("bee", path, held, PathSource.ROADMAP, 1.0)
        self.verdicts.publish(verdict_to_message(plan, stamp, message))
        self.graph.until(lambda: self.node._gate.complete(stamp), "path and certificate")
        return path


class AirSite:
    """A planner node of one flying robot."""

    def __init__(self, graph: Any, **changes: Any) -> None:
        self.graph = graph
        self.paths = graph.hear(Path, "bee/path")
        self.verdicts = graph.hear(DiagnosticStatus, "bee/certificate")
        self.node = graph.add(PlannerNode, lean=False, **{**PLANNER, **changes})
        self.area = graph.speak(PointCloud2, "unoccupied_area", LATCHED)
        self.odometry = graph.speak(Odometry, "bee/odom")
        self.goal = graph.speak(PoseStamped, "bee/goal_pose", 1)
        self.clock = graph.speak(Clock, "/clock", 1)

    def at(self, stamp: int) -> None:
        self.clock.publish(Clock(clock=stamp_message(stamp)))
        self.graph.until(lambda: self.node.get_clock().now().nanoseconds == stamp, "the clock")

    def fly_to(self, x: float, y: float, z: float) -> None:
        message = PoseStamped()
        message.header.frame_id = "map"
        place = message.pose.position
        place.x, place.y, place.z = x, y, z
        self.goal.publish(message)
        self.graph.until(lambda: "bee" in self.node._goals and self.node._goals["bee"][0] == x, "the goal")

    def hover(self, stamp: int, *place: float) -> None:
        """Say that the robot hovers at a place."""
        self.at(stamp)
        state = FlyerState("bee", np.array(place), np.array([1.0, 0.0, 0.0]), stamp / 1e9)
        self.odometry.publish(flight_to_message(state, np.zeros(3), stamp))
        self.graph.until(lambda: self.node._states.get("bee", (-1,))[0] == stamp, "odometry")

    def step(self, stamp: int) -> tuple[Any, Any]:
        """Publish the area; return path and verdict of the decision that follows."""
        self.at(stamp)
        count = len(self.paths)
        self.area.publish(spatial_area_to_message(room(stamp)))
        self.graph.until(lambda: len(self.paths) > count and len(self.verdicts) > count, "a decision")
        return self.paths[-1], verdict_from_message(self.verdicts[-1])
