"""A fusion node of two depth cameras whose clouds and time are in the hands of the test."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header

from snnav_core.area.grid import Grid
from snnav_core.area.spatial import SpatialArea
from snnav_core.area.spatial_fusion import SpatialFusionSettings
from snnav_core.flight_types import FlyerState
from snnav_core.sensing.depth import DepthCamera, DepthImage, equal_angle, looking_at
from snnav_core.types import FloatArray, RobotSpec
from snnav_ros.convert import (
    flight_to_message,
    image_to_message,
    nanoseconds,
    nanoseconds_from_stamp,
    spatial_area_from_message,
    stamp_message,
)
from snnav_ros.lockstep import DONE_TOPIC
from snnav_ros.nodes.fusion import FusionNode
from snnav_ros.qos import CLOUDS, LATCHED, LOCKSTEP, VOLUMES
from support.box_world import image

SECOND = 10**9
ROOM = np.array([[0.0, 0.0, 0.0], [4.0, 3.0, 2.0]])
MIDDLE = ROOM.mean(axis=0)
PLACES = {"low": np.array([0.1, 0.1, 0.3]), "high": np.array([3.9, 2.9, 1.9])}
EYES = {
    name: DepthCamera(name, place, looking_at(place, MIDDLE), equal_angle(48, 40))
    for name, place in PLACES.items()
}
FRAMES = {"low": "low", "high": "tof"}
FUSION = SpatialFusionSettings(
    Grid.covering(ROOM[0], ROOM[1], 0.1),
    boundary_speed=0.1,
    range_accuracy=0.001,
    reach=1.5,
    clock_tolerance=0.1,  # of a node by `/clock` in real time
)
BEE = RobotSpec("bee", 0.2, 0.7, 2.0)
_DOWN = MIDDLE - PLACES["high"]
SITE: dict[str, Any] = {
    "sampling_interval": 0.5,
    "max_scan_age": 1.0,
    "boundary_speed": 0.1,
    "range_accuracy": 0.001,
    "reach": 1.5,
    "workspace": ROOM.reshape(-1).tolist(),
    "sensors": ["low", "high"],
    "low.position": PLACES["low"].tolist(),
    "low.look_at": MIDDLE.tolist(),
    "low.columns": 48,
    "low.rows": 40,
    "high.position": PLACES["high"].tolist(),
    "high.orientation_deg": [
        0.0,
        math.degrees(math.atan2(-_DOWN[2], math.hypot(_DOWN[0], _DOWN[1]))),
        math.degrees(math.atan2(_DOWN[1], _DOWN[0])),
    ],
    "high.columns": 48,
    "high.rows": 40,
    "high.frame": "tof",
    "robots": ["bee"],
    "bee.radius": 0.2,
    "bee.speed": 0.7,
    "bee.max_turn_rate": 2.0,
    "use_sim_time": True,
}


def seen(name: str, stamp: int, robot: FloatArray | None = None, noise: float = 5e-4) -> DepthImage:
    """What a camera sees of the room, and of a cube of 0.2 m where a robot is."""
    boxes = np.empty((0, 2, 3)) if robot is None else np.array([[robot - 0.1, robot + 0.1]])
    true = image(EYES[name], boxes, ROOM, stamp / SECOND)
    shorter = noise * np.random.default_rng(stamp).uniform(size=true.ranges.shape)
    return DepthImage(true.stamp, (true.ranges - shorter).astype(np.float32))


def cloud(name: str, stamp: int, robot: FloatArray | None = None, noise: float = 5e-4) -> PointCloud2:
    return image_to_message(seen(name, stamp, robot, noise), EYES[name].model, FRAMES[name], stamp)


def state(stamp: int, place: FloatArray = MIDDLE, speed: float = 0.0) -> FlyerState:
    return FlyerState("bee", place, np.array([1.0, 0.0, 0.0]), stamp / SECOND, speed)


def odometry(stamp: int, place: FloatArray = MIDDLE, speed: float = 0.0) -> Odometry:
    return flight_to_message(state(stamp, place, speed), np.zeros(3), stamp)


def inner(area: SpatialArea, place: FloatArray = MIDDLE) -> float:
    """Clearance of a place [m]."""
    return float(area.clearance_at(place[None])[0])


class Site:
    """The node in real time by a clock in the hands of the test."""

    def __init__(self, graph: Any, **changes: Any) -> None:
        self.graph = graph
        self.areas = graph.hear(PointCloud2, "unoccupied_area", LATCHED)
        self.diagnostics = graph.hear(DiagnosticArray, "/diagnostics")
        self.node = graph.add(FusionNode, lean=False, **{**SITE, **changes})
        self.eyes = {name: graph.speak(PointCloud2, f"sensors/{name}/points") for name in EYES}
        self.clock = graph.speak(Clock, "/clock", 1)
        self.odom = graph.speak(Odometry, "bee/odom")

    def at(self, stamp: int) -> None:
        self.clock.publish(Clock(clock=stamp_message(stamp)))
        self.graph.until(lambda: self.node.get_clock().now().nanoseconds == stamp, "the clock")

    def send(self, name: str, message: PointCloud2) -> None:
        """Let time go to the stamp of a cloud and send it."""
        stamp = nanoseconds_from_stamp(message.header.stamp)
        if stamp > self.node.get_clock().now().nanoseconds:
            self.at(stamp)
        self.send_now(name, message)

    def send_now(self, name: str, message: PointCloud2) -> None:
        count = self.node._received[name]
        self.eyes[name].publish(message)
        self.graph.until(lambda: self.node._received[name] > count, "the cloud")

    def look(self, stamp: int, robot: FloatArray | None = None) -> None:
        """Let both cameras look."""
        for name in EYES:
            self.send(name, cloud(name, stamp, robot))

    def tell(self, message: Odometry) -> None:
        waiting = self.node._odometry["bee"]
        count = len(waiting)
        self.odom.publish(message)
        self.graph.until(lambda: len(waiting) > count, "the odometry")

    def area(self, stamp: int) -> SpatialArea:
        """Let time go to a sampling instant and return the area of it."""
        count = len(self.areas)
        self.at(stamp)
        self.graph.until(lambda: len(self.areas) > count, "an area")
        return spatial_area_from_message(self.areas[-1])

    def status(self, name: str) -> DiagnosticStatus:
        stamp = self.areas[-1].header.stamp
        self.graph.until(
            lambda: self.diagnostics and self.diagnostics[-1].header.stamp == stamp, "diagnostics"
        )
        return next(one for one in self.diagnostics[-1].status if one.name == name)


class Steps:
    """The node in lockstep, its ticks and data in the hands of the test."""

    def __init__(self, graph: Any, **changes: Any) -> None:
        self.graph = graph
        self.areas = graph.hear(PointCloud2, "unoccupied_area", VOLUMES)
        self.done = graph.hear(Header, DONE_TOPIC, LOCKSTEP)
        self.node = graph.add(FusionNode, **{**SITE, "lockstep": True, "use_sim_time": False, **changes})
        self.eyes = {name: graph.speak(PointCloud2, f"sensors/{name}/points", CLOUDS) for name in EYES}
        self.clock = graph.speak(Clock, "/clock", LOCKSTEP)
        self.odom = graph.speak(Odometry, "bee/odom", LOCKSTEP)

    def tick(self, stamp: int) -> None:
        self.clock.publish(Clock(clock=stamp_message(stamp)))

    def is_done(self, stamp: int) -> bool:
        return any(nanoseconds_from_stamp(one.stamp) == stamp for one in self.done)

    def area(self, time: float) -> SpatialArea:
        """The area of a time [s], once it is there."""
        stamp = nanoseconds(time)
        self.graph.until(
            lambda: self.areas and nanoseconds_from_stamp(self.areas[-1].header.stamp) == stamp, "the area"
        )
        return spatial_area_from_message(self.areas[-1])
