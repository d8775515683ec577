"""A robot node by itself; its paths, certificates and ticks are in the hands of the test."""

from __future__ import annotations

from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry, Path
from rosgraph_msgs.msg import Clock

from snnav_core.types import Certificate, PathSource, PlannedPath, TimedPath
from snnav_ros.convert import (
    nanoseconds,
    path_to_message,
    stamp_message,
    state_from_message,
    verdict_to_message,
)
from snnav_ros.nodes.robot import RobotNode

TICK = 50_000_000
CART = {"robot_id": "cart", "speed": 0.5, "max_turn_rate": 1.0, "start": [1.0, 2.0], "sampling_interval": 0.5}


def certified(start: float, window: float = 2.0, x: float = 1.0) -> tuple[Path, DiagnosticStatus]:
    """Return a long straight path along y = 2 m, and its certificate."""
    points = np.column_stack((np.arange(x, x + 20.0, 0.1), np.full(200, 2.0)))
    path = TimedPath(start, 0.2, points)
    held = Certificate("cart", True, start + window, 0.73125, 2.5, 1.4375, start, path.digest())
    message = path_to_message(path)
    plan = PlannedPath("cart", path, held, PathSource.TANGENT_GRAPH, 0.7)
    return message, verdict_to_message(plan, nanoseconds(start), message)


class Cart:
    """A robot node by itself, whose odometry, commands and diagnostics are heard."""

    def __init__(self, graph: Any, **changes: Any) -> None:
        self.graph = graph
        self.odometry = graph.hear(Odometry, "cart/odom")
        self.commands = graph.hear(Twist, "cart/cmd_vel")
        self.diagnostics = graph.hear(DiagnosticArray, "/diagnostics")
        self.node = graph.add(RobotNode, **{**CART, **changes})
        self.paths = graph.speak(Path, "cart/path", 1)
        self.verdicts = graph.speak(DiagnosticStatus, "cart/certificate", 1)

    def send(self, path: Path | None, certificate: DiagnosticStatus | None) -> None:
        if path is not None:
            self.paths.publish(path)
        if certificate is not None:
            self.verdicts.publish(certificate)

    @property
    def speed(self) -> float:
        return float(self.commands[-1].linear.x)

    @property
    def x(self) -> float:
        return float(state_from_message(self.odometry[-1], "cart").pose.x)

    def said(self) -> list[str]:
        """Return the messages of its status so far."""
        return [one.message for array in self.diagnostics for one in array.status]


class CartOfTicks(Cart):
    """Its clock is in the hands of the test."""

    def __init__(self, graph: Any, **changes: Any) -> None:
        super().__init__(graph, use_sim_time=True, **changes)
        self.clock = graph.speak(Clock, "/clock", 1)
        self.tick = 0

    @property
    def now(self) -> float:
        return self.tick * TICK / 1e9

    def run(self, ticks: int = 1, stride: int = 1) -> None:
        for _ in range(ticks):
            self.tick += stride
            count = len(self.commands)
            self.clock.publish(Clock(clock=stamp_message(self.tick * TICK)))
            self.graph.until(lambda count=count: len(self.commands) > count, "a command")

    def drive(self) -> None:
        """Send a good pair and see that it is followed."""
        self.send(*certified(self.now))
        stamp = nanoseconds(self.now)
        self.graph.until(lambda: self.node._gate.complete(stamp), "path and certificate")
        self.run(2)
        assert self.speed == 0.5
