"""The node that hears everything of a scene; the bring-up makes it in its own process."""

from __future__ import annotations

from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import Twist
from nav_msgs.msg import OccupancyGrid, Odometry, Path
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import LaserScan, PointCloud2
from visualization_msgs.msg import MarkerArray

from snnav_ros.casting import is_unplanned
from snnav_ros.convert import nanoseconds, nanoseconds_from_stamp, stamp_message
from snnav_ros.lockstep import Participant
from snnav_ros.nodes.base import NodeOptions
from snnav_ros.nodes.fellows import PLANNERS_TOPIC
from snnav_ros.nodes.operator import Operator
from snnav_ros.nodes.roster import ROBOTS_TOPIC
from snnav_ros.nodes.tracker import OBSTACLES, WORKSPACE
from snnav_ros.qos import CLOCK_INPUT, INBOX, LATCHED, RECORDED, SENSOR, for_mode
from snnav_ros.recorder import RunCollector
from snnav_sim.scene import AnyScene, SpaceScene

__all__ = ["RECORDER", "RecorderNode"]

RECORDER = "recorder"


class RecorderNode(Node):
    """Gives every message to a RunCollector; in lockstep nothing goes on before it has all of a tick.

    It is also the operator who says the goals of the scene.
    """

    def __init__(
        self,
        options: NodeOptions,
        scene: AnyScene,
        collector: RunCollector,
        lockstep: bool,
        several: bool = False,
    ) -> None:
        super().__init__(options.name or RECORDER, **options.keywords())
        self._collector = collector
        self._sample_ns = nanoseconds(scene.sampling_interval)
        self._participant: Participant | None = None
        recorded, latched = for_mode(lockstep, RECORDED), for_mode(lockstep, LATCHED)
        scans = for_mode(lockstep, SENSOR)
        in_space = isinstance(scene, SpaceScene)
        kind, topic = (PointCloud2, "points") if in_space else (LaserScan, "scan")
        for sensor in () if is_unplanned(scene) else scene.sensors:
            take = partial(collector.take_data, sensor.id)
            self._hear(kind, f"sensors/{sensor.id}/{topic}", take, scans)
        if not is_unplanned(scene):
            self._hear(PointCloud2, "unoccupied_area", collector.take_area, latched)
            self._hear(OccupancyGrid, "unoccupied_area/grid", partial(collector.take_data, "grid"), latched)
        if scene.plans_globally:
            self._hear(PointCloud2, OBSTACLES, partial(collector.take_data, "obstacles"), latched)
            self._hear(PointCloud2, WORKSPACE, partial(collector.take_data, "workspace"), latched)
            self._hear(MarkerArray, "candidates", collector.take_plans, latched)
        self._hear(
            DiagnosticArray, "/diagnostics", collector.take_diagnostics, INBOX if lockstep else RECORDED
        )
        for robot in scene.robots:
            name = robot.id
            self._hear(Odometry, f"{name}/odom", partial(collector.take_odometry, name), recorded)
            self._hear(Twist, f"{name}/cmd_vel", partial(collector.take_command, name), recorded)
            self._hear(Path, f"{name}/path", partial(collector.take_path, name), recorded)
            self._hear(
                DiagnosticStatus, f"{name}/certificate", partial(collector.take_verdict, name), recorded
            )
        self._hear(DiagnosticStatus, ROBOTS_TOPIC, collector.take_announcement, INBOX)
        if several:
            self._hear(DiagnosticStatus, PLANNERS_TOPIC, collector.take_word, INBOX)
        self._operator = Operator(self, scene, lockstep, collector.write)
        if not lockstep:
            self._hear(Clock, "/clock", self._take_clock, CLOCK_INPUT)
        else:
            self._participant = Participant(
                self, nanoseconds(scene.control_period), self._on_tick, lambda: None
            )

    def _hear(self, kind: Any, topic: str, take: Any, qos: QoSProfile) -> None:
        def on_message(message: Any) -> None:
            take(topic, message)
            self._go_on_when_complete()

        self.create_subscription(kind, topic, on_message, qos)

    def missing(self) -> str:
        """Return what the recorder waits for, for a message."""
        tick = None if self._participant is None else self._participant.due
        if tick is None:
            return "/clock"
        return ", ".join(self._collector.missing(tick, tick % self._sample_ns == 0))

    def _take_clock(self, topic: str, message: Clock) -> None:
        now = nanoseconds_from_stamp(message.clock)
        self._collector.write(topic, message, now)
        self._operator.tell(now)

    def _on_tick(self, tick: int) -> None:
        self._collector.write("/clock", Clock(clock=stamp_message(tick)), tick)
        self._operator.tell(tick)
        self._go_on_when_complete()

    def _go_on_when_complete(self) -> None:
        """In lockstep: let time go on when all of the present tick is recorded, but not past the end of the run."""
        if self._participant is None or self._participant.due is None or self._collector.ended:
            return
        tick = self._participant.due
        if self._collector.complete(tick, tick % self._sample_ns == 0):
            self._participant.done()
