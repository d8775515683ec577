"""A fusion node of two sensors whose scans and time are in the hands of the test."""

from __future__ import annotations

from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import LaserScan, PointCloud2
from std_msgs.msg import Header

from snnav_core.sensing.scan import PlanarScan
from snnav_ros.convert import (
    area_from_message,
    nanoseconds_from_stamp,
    scan_to_message,
    stamp_message,
)
from snnav_ros.lockstep import DONE_TOPIC
from snnav_ros.nodes.fusion import FusionNode
from snnav_ros.qos import LATCHED, LOCKSTEP

SECOND = 10**9
SITE = {
    "sampling_interval": 0.5,
    "max_scan_age": 1.0,
    "boundary_speed": 0.0,
    "sensors": ["north", "south"],
    "north.position": [0.0, 9.0],
    "north.heading_deg": -90.0,
    "south.position": [0.0, 1.0],
    "south.heading_deg": 90.0,
    "south.frame": "laser",
    "use_sim_time": True,
}


def scan(frame: str, stamp: int, length: float = 3.0, beams: int = 181, noise: float = 1e-4) -> LaserScan:
    ranges = length + noise * np.random.default_rng(stamp).uniform(size=beams)
    values = PlanarScan(stamp / SECOND, ranges, -np.pi / 2, np.pi / (beams - 1), 0.0, 8.0)
    return scan_to_message(values, frame, stamp)


class Site:
    """A fusion node of two sensors, its scans and time in the hands of the test."""

    def __init__(self, graph: Any, **changes: Any) -> None:
        self.graph = graph
        self.areas = graph.hear(PointCloud2, "unoccupied_area", LATCHED)
        self.diagnostics = graph.hear(DiagnosticArray, "/diagnostics")
        self.node = graph.add(FusionNode, lean=False, **{**SITE, **changes})
        self.north = graph.speak(LaserScan, "sensors/north/scan")
        self.south = graph.speak(LaserScan, "sensors/south/scan")
        self.clock = graph.speak(Clock, "/clock", 1)

    def at(self, stamp: int) -> None:
        self.clock.publish(Clock(clock=stamp_message(stamp)))
        self.graph.until(lambda: self.node.get_clock().now().nanoseconds == stamp, "the clock")

    def send(self, publisher: Any, message: LaserScan) -> None:
        """Let time go to the stamp of a scan and send it."""
        stamp = nanoseconds_from_stamp(message.header.stamp)
        if stamp > self.node.get_clock().now().nanoseconds:
            self.at(stamp)
        count = sum(self.node._received.values()) + sum(self.node._rejected.values())
        publisher.publish(message)
        self.graph.until(
            lambda: sum(self.node._received.values()) + sum(self.node._rejected.values()) > count, "the scan"
        )

    def area(self, stamp: int) -> Any:
        """Let time go to a sampling instant and return the area of it."""
        count = len(self.areas)
        self.at(stamp)
        self.graph.until(lambda: len(self.areas) > count, "an area")
        return area_from_message(self.areas[-1])

    def status(self, name: str) -> DiagnosticStatus:
        stamp = self.areas[-1].header.stamp
        self.graph.until(
            lambda: self.diagnostics and self.diagnostics[-1].header.stamp == stamp, "diagnostics"
        )
        return next(one for one in self.diagnostics[-1].status if one.name == name)


FLOOR = {
    "north.sees_robots": True,
    "robots": ["cart"],
    "cart.radius": 0.3,
    "cart.speed": 0.5,
    "cart.max_turn_rate": 1.0,
}


def in_front_of_north(stamp: int, distance: float) -> LaserScan:
    """A scan with something round of 0.3 m in front of the wall, `distance` from the scanner to its middle."""
    message = scan("north", stamp)
    bearing = np.linspace(-np.pi / 2, np.pi / 2, 181)
    across = distance * np.sin(bearing)
    hit = np.abs(across) < 0.3
    ranges = np.array(message.ranges)
    ranges[hit] = distance * np.cos(bearing[hit]) - np.sqrt(0.09 - across[hit] ** 2)
    message.ranges = ranges.astype(np.float32).tolist()
    return message


class Steps:
    """A fusion node in lockstep, its ticks and data in the hands of the test."""

    def __init__(self, graph: Any, **changes: Any) -> None:
        self.graph = graph
        self.areas = graph.hear(PointCloud2, "unoccupied_area", LOCKSTEP)
        self.done = graph.hear(Header, DONE_TOPIC, LOCKSTEP)
        self.node = graph.add(FusionNode, **{**SITE, "lockstep": True, "use_sim_time": False, **changes})
        self.north = graph.speak(LaserScan, "sensors/north/scan", LOCKSTEP)
        self.south = graph.speak(LaserScan, "sensors/south/scan", LOCKSTEP)
        self.clock = graph.speak(Clock, "/clock", LOCKSTEP)

    def tick(self, stamp: int) -> None:
        self.clock.publish(Clock(clock=stamp_message(stamp)))

    def is_done(self, stamp: int) -> bool:
        return any(nanoseconds_from_stamp(one.stamp) == stamp for one in self.done)
