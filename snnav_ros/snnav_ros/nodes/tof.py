"""The node of one simulated depth camera of a scene in space: time-of-flight, or spinning."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

from nav_msgs.msg import Odometry
from sensor_msgs.msg import PointCloud2

from snnav_core.area.robots import RobotTrack
from snnav_core.sensing.depth import DepthImage
from snnav_ros.convert import flyer_state_from_message, image_to_message, no_cloud_to_message
from snnav_ros.nodes.range_finder import RangeFinderNode
from snnav_ros.parameters import ParameterReader
from snnav_ros.qos import CLOUDS, SENSOR
from snnav_ros.scenes import read_scene
from snnav_sim.devices.tof import DepthDevice
from snnav_sim.space_types import DepthSensor, FlyerScene, SpaceScene
from snnav_sim.space_world import SpaceWorld

__all__ = ["TofNode"]

_world = lru_cache(maxsize=2)(SpaceWorld)  # the cameras of one process look at the same world


class TofNode(RangeFinderNode):
    """Publishes `sensors/<id>/points`, organized clouds; hears `<robot>/odom` of all robots of the scene."""

    usual_name = "tof_node"
    ticks = "sampling"

    def read_scene(self, reader: ParameterReader) -> SpaceScene:
        """Return the scene, one in space."""
        scene = read_scene(reader, required=True)
        if not isinstance(scene, SpaceScene):
            reader.fail("scene", "names a scene in the plane; this node serves scenes in space")
        return scene

    def seen_robots(self, scene: SpaceScene, sensor: DepthSensor) -> Sequence[FlyerScene]:
        """Return all robots of the scene."""
        return scene.robots

    def make_device(
        self, scene: SpaceScene, sensor: DepthSensor, seed: int, tracks: list[RobotTrack]
    ) -> DepthDevice:
        """Return the camera."""
        return DepthDevice(sensor, _world(scene), seed, tracks)

    def make_publisher(self, sensor_id: str, lockstep: bool) -> Any:
        """Return the publisher of clouds."""
        return self.create_publisher(
            PointCloud2, f"sensors/{sensor_id}/points", CLOUDS if lockstep else SENSOR
        )

    def to_message(self, measurement: DepthImage, sensor: DepthSensor, stamp_ns: int) -> Any:
        """Return the cloud of an image."""
        return image_to_message(measurement, sensor.model, sensor.id, stamp_ns)

    def nothing(self, sensor_id: str, stamp_ns: int) -> Any:
        """Return the cloud that says "nothing more"."""
        return no_cloud_to_message(sensor_id, stamp_ns)

    def take_state(self, track: RobotTrack, message: Odometry, topic: str, origin: float) -> None:
        """Add a state in space."""
        state = flyer_state_from_message(message, track.robot.id, topic)
        track.add_flyer(replace(state, stamp=state.stamp - origin))
