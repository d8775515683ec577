"""The node of one planar range finder of a scene: simulated, or repeating a recorded scan."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from nav_msgs.msg import Odometry
from sensor_msgs.msg import LaserScan

from snnav_core.area.robots import RobotTrack
from snnav_core.sensing.scan import PlanarScan
from snnav_ros.convert import nothing_to_message, scan_to_message, state_from_message
from snnav_ros.nodes.range_finder import RangeFinderNode
from snnav_ros.parameters import ParameterReader
from snnav_ros.qos import SENSOR, for_mode
from snnav_ros.scenes import read_planar_scene
from snnav_sim.devices import make_device
from snnav_sim.devices.factory import RangeFinder
from snnav_sim.scene_types import RobotScene, Scene, SensorScene
from snnav_sim.world import World

__all__ = ["Lms200Node"]


class Lms200Node(RangeFinderNode):
    """Publishes `sensors/<id>/scan`; a scanner that sees robots hears `<robot>/odom` of all robots of the scene."""

    usual_name = "lms200_node"
    ticks = "control"

    def read_scene(self, reader: ParameterReader) -> Scene:
        """Return the scene, one in the plane."""
        scene = read_planar_scene(reader, required=True)
        assert scene is not None
        return scene

    def seen_robots(self, scene: Scene, sensor: SensorScene) -> Sequence[RobotScene]:
        """Return all robots of the scene if the scanner sees any."""
        return scene.robots if sensor.sees_robots else ()

    def make_device(
        self, scene: Scene, sensor: SensorScene, seed: int, tracks: list[RobotTrack]
    ) -> RangeFinder:
        """Return the scanner."""
        return make_device(sensor, World(scene), seed, tracks)

    def make_publisher(self, sensor_id: str, lockstep: bool) -> Any:
        """Return the publisher of scans."""
        return self.create_publisher(LaserScan, f"sensors/{sensor_id}/scan", for_mode(lockstep, SENSOR))

    def to_message(self, measurement: PlanarScan, sensor: SensorScene, stamp_ns: int) -> Any:
        """Return the LaserScan of a scan."""
        return scan_to_message(measurement, sensor.id, stamp_ns)

    def nothing(self, sensor_id: str, stamp_ns: int) -> Any:
        """Return the LaserScan that says "nothing more"."""
        return nothing_to_message(sensor_id, stamp_ns)

    def take_state(self, track: RobotTrack, message: Odometry, topic: str, origin: float) -> None:
        """Add a state in the plane."""
        state = state_from_message(message, track.robot.id, topic)
        track.add(state.stamp - origin, state.pose, state.speed)
