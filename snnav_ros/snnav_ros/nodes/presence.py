"""When a robot is in the workspace, and its words about that on `robots`."""

from __future__ import annotations

import math
import time

from diagnostic_msgs.msg import DiagnosticStatus

from snnav_core.types import RobotSpec
from snnav_ros.convert import Announcement, announcement_to_message, nanoseconds
from snnav_ros.nodes.base import ManagedNode
from snnav_ros.nodes.roster import ROBOTS_TOPIC
from snnav_ros.qos import LATCHED, for_mode

__all__ = ["Presence"]


class Presence:
    """Announces a robot when it joins and when it leaves.

    Parameters
    ----------
    node : ManagedNode
    spec : RobotSpec
    joins_at, leaves_at : float
        In simulated time, or since the node went active by the wall [s].
    by_wall : bool
    """

    def __init__(
        self, node: ManagedNode, spec: RobotSpec, joins_at: float, leaves_at: float | None, by_wall: bool
    ) -> None:
        self._node, self._spec, self._by_wall = node, spec, by_wall
        self._joins = nanoseconds(joins_at)
        self._leaves = math.inf if leaves_at is None else nanoseconds(leaves_at)
        self._wanted = True
        self.is_there = False

    def configure(self) -> None:
        """Make the publisher."""
        self._mouth = self._node.publisher(
            DiagnosticStatus, ROBOTS_TOPIC, for_mode(self._node.lockstep, LATCHED)
        )

    def begin(self) -> None:
        """Be nowhere until the next `update`; by the wall, time begins now."""
        self._begin = time.monotonic_ns()
        self.is_there = False

    def want(self, wanted: bool) -> None:
        """Join or leave at the next `update`, as a person says; before `joins_at` and after `leaves_at` it is away."""
        self._wanted = wanted

    def update(self, now: int) -> bool:
        """Say at a time [ns] whether the robot is there, if that changed; return whether it changed."""
        elapsed = time.monotonic_ns() - self._begin if self._by_wall else now
        there = self._wanted and self._joins <= elapsed < self._leaves
        if there == self.is_there:
            return False
        self.is_there = there
        spec = self._spec if there else None
        self._mouth.publish(announcement_to_message(Announcement(self._spec.id, now, spec)))
        return True
