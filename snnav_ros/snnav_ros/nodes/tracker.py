"""The node that tells bodies and their velocities from what the sensors measured one after the other."""

from __future__ import annotations

import time as clock
from dataclasses import dataclass, fields
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import PointCloud2
from visualization_msgs.msg import MarkerArray

from snnav_core.area.planar import UnoccupiedArea
from snnav_core.area.returns import FusedReturns
from snnav_core.area.tracks import ObstacleTracker, TrackedScene, TrackerSettings
from snnav_core.errors import InvalidInput
from snnav_ros.convert import (
    area_from_message,
    nanoseconds,
    nanoseconds_from_stamp,
    obstacles_to_markers,
    obstacles_to_message,
    returns_from_message,
    rings_to_message,
    seconds,
)
from snnav_ros.lockstep import Participant
from snnav_ros.nodes.base import ManagedNode, NodeOptions, diagnostics, serve, status
from snnav_ros.nodes.node_time import has_time, now_of, watch_time
from snnav_ros.qos import DIAGNOSTICS, LATCHED, for_mode
from snnav_ros.scenes import read_planar_scene
from snnav_sim.configure import tracker_settings

__all__ = ["OBSTACLES", "WORKSPACE", "TrackerNode", "TrackerParameters"]

OBSTACLES, WORKSPACE = "obstacles", "obstacles/workspace"

_AREA, _RETURNS = "unoccupied_area", "unoccupied_area/returns"
_LATE = 2  # sampling intervals without an area after which something is wrong
_ARROW_TIME = 1.0  # [s] that a body needs for the length of its arrow


@dataclass(frozen=True)
class TrackerParameters:
    """Parameters of the node besides those of the tracker.

    Parameters
    ----------
    sampling_interval : float
        From one unoccupied area to the next [s].
    clock_tolerance : float
        How far stamps may lie ahead of the clock of the node [s]; what lies farther ahead is not used. Not in lockstep,
        where time waits.
    """

    sampling_interval: float = 0.3
    clock_tolerance: float = 0.05


class TrackerNode(ManagedNode):
    """Hears what fusion publishes; publishes `obstacles` and the workspace in which they are.

    One update for every area and the returns of the same stamp. Robots are no bodies: fusion leaves out what returned
    from them.
    """

    def __init__(self, options: NodeOptions | None = None) -> None:
        super().__init__("tracker_node", options or NodeOptions())
        scene = read_planar_scene(self.reader)
        base: dict[str, Any] = {}
        interval = {} if scene is None else {"sampling_interval": scene.sampling_interval}
        self.settings = self.reader.settings(TrackerParameters, **interval)
        if scene is not None:
            held = tracker_settings(scene)
            base = {field.name: getattr(held, field.name) for field in fields(held)}
        self.tracker_settings = self.reader.settings(TrackerSettings, **base)
        self.reader.finish()
        if not self.lockstep:
            self._jump = watch_time(self, self.reset)
        serve(self, self.options, self.reset, {})
        self.autostart()

    def configure(self) -> None:
        """Make the tracker and the publishers."""
        self._tracker = ObstacleTracker(self.tracker_settings)
        self._problems: dict[str, str] = {}
        self._misses = 0
        self._tracked = -1
        self._forget()
        latched = for_mode(self.lockstep, LATCHED)
        self._obstacles = self.publisher(PointCloud2, OBSTACLES, latched)
        self._workspace = self.publisher(PointCloud2, WORKSPACE, latched)
        self._markers = self.publisher(MarkerArray, "obstacles/markers", latched)
        self._diagnostics = self.publisher(
            DiagnosticArray, "/diagnostics", for_mode(self.lockstep, DIAGNOSTICS)
        )

    def start(self) -> None:
        """Listen; in lockstep take part."""
        latched = for_mode(self.lockstep, LATCHED)
        self.listen(PointCloud2, _RETURNS, self._on_returns, latched)
        self.listen(PointCloud2, _AREA, self._on_area, latched)
        self._participant: Participant | None = None
        if self.lockstep:
            period = nanoseconds(self.settings.sampling_interval)
            self._participant = self.participate(period, lambda _: self._go_on(), self.reset)
        else:
            self.every(self.settings.sampling_interval, self._watch)
        self._waiting = self.report_waiting(lambda: [_AREA, _RETURNS])

    def reset(self) -> None:
        """Forget all bodies."""
        self._tracker.reset()
        self._tracked = -1
        if not self.lockstep:  # in lockstep data of the new time may be here before their tick
            self._forget()

    def _forget(self) -> None:
        self._area: tuple[int, UnoccupiedArea] | None = None
        self._returns: tuple[int, FusedReturns] | None = None

    def _on_area(self, message: PointCloud2) -> None:
        if self._may_use(_AREA, message, self._area):
            try:
                self._area = nanoseconds_from_stamp(message.header.stamp), area_from_message(message, _AREA)
            except InvalidInput as error:
                self._complain(_AREA, str(error))
            self._go_on()

    def _on_returns(self, message: PointCloud2) -> None:
        if self._may_use(_RETURNS, message, self._returns):
            try:
                stamp = nanoseconds_from_stamp(message.header.stamp)
                self._returns = stamp, returns_from_message(message, _RETURNS)
            except InvalidInput as error:
                self._complain(_RETURNS, str(error))
            self._go_on()

    def _may_use(self, topic: str, message: PointCloud2, last: tuple[int, object] | None) -> bool:
        """Whether the stamp of a message can be true; what is wrong with it is said."""
        self._waiting.heard(topic)
        if self.lockstep:
            return True
        if not has_time(self):
            return False
        stamp = nanoseconds_from_stamp(message.header.stamp)
        ahead = seconds(stamp - now_of(self))
        if ahead > self.settings.clock_tolerance:
            self._complain(
                topic,
                f"{topic}: stamped {ahead:.3f} s ahead of the clock, more than clock_tolerance "
                f"{self.settings.clock_tolerance:g} s; synchronise the clocks",
            )
            return False
        if last is not None and stamp < last[0]:
            text = f"stamped {seconds(stamp):.3f} s, after one stamped {seconds(last[0]):.3f} s"
            self._complain(topic, f"{topic}: {text}; is there another fusion node?")
            return False
        self._problems.pop(topic, None)
        return True

    def _complain(self, topic: str, problem: str) -> None:
        if topic not in self._problems:
            self.get_logger().warning(f"message not used: {problem}")
        self._problems[topic] = problem

    def _go_on(self) -> None:
        """Track once area and returns of one stamp are there, in lockstep those of the present tick."""
        if self._area is None or self._returns is None or self._area[0] != self._returns[0]:
            return
        stamp, area = self._area
        if self._participant is not None and self._participant.due != stamp:
            return
        if stamp > self._tracked:  # the same messages may come twice
            self._track(stamp, self._returns[1], area)
        if self._participant is not None:
            self._participant.done()

    def _watch(self) -> None:
        """Say when nothing comes to track in, or nothing that can be used."""
        now = now_of(self)
        if self._tracked < 0 or now - self._tracked <= _LATE * nanoseconds(self.settings.sampling_interval):
            return
        self._problems["age"] = (
            f"the last usable area with returns is {seconds(now - self._tracked):.1f} s old; check the fusion node"
        )
        self._publish_status(now, None, 0.0)

    def _track(self, stamp: int, returns: FusedReturns, area: UnoccupiedArea) -> None:
        begin = clock.perf_counter()
        scene = self._tracker.update(seconds(stamp), returns, area)
        duration = clock.perf_counter() - begin
        self._tracked = stamp
        self._problems.pop("age", None)
        self._misses += duration > self.settings.sampling_interval
        self._workspace.publish(rings_to_message(scene.workspace, stamp))
        self._obstacles.publish(obstacles_to_message(scene.obstacles, stamp))
        if self._markers.get_subscription_count() > 0:
            self._markers.publish(obstacles_to_markers(scene.obstacles, stamp, _ARROW_TIME))
        self._publish_status(stamp, scene, duration)

    def _publish_status(self, stamp: int, scene: TrackedScene | None, duration: float) -> None:
        bodies = () if scene is None else scene.obstacles
        values = {
            "step_ms": f"{1e3 * duration:.4f}",
            "deadline_misses": self._misses,
            "bodies": len(bodies),
            "moving": sum(body.speed > 0.0 for body in bodies),
            "fastest": f"{max((body.speed for body in bodies), default=0.0):.3f}",
        }
        problem = "; ".join(self._problems.values())
        if not problem and scene is not None and not scene.workspace:
            problem = "nothing is free"
        own = status("obstacles", self.get_name(), problem, values)
        self._diagnostics.publish(diagnostics(stamp, [own]))
