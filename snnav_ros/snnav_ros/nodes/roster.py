"""Who is in the workspace: robots known from the start, and those that announce themselves on `robots`."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus

from snnav_core.errors import InvalidInput
from snnav_core.types import RobotSpec
from snnav_ros.casting import planned_robots
from snnav_ros.convert import (
    Announcement,
    announcement_from_message,
    announcement_to_message,
    nanoseconds,
    seconds,
)
from snnav_ros.nodes.base import ManagedNode
from snnav_ros.nodes.node_time import has_time, now_of
from snnav_ros.qos import INBOX, LATCHED, for_mode
from snnav_sim.scene import AnyScene

__all__ = ["ROBOTS_TOPIC", "Roster"]

ROBOTS_TOPIC = "robots"

_AHEAD = 10**9  # [ns] by which clocks of robots may differ


class Roster:
    """Hears `robots` and says who joins and who leaves.

    In real time that happens as soon as it is heard. In lockstep it happens at the tick of its stamp, those who leave
    first, in the order of the scene; a tick is complete when all were heard that the scene says are due.

    Parameters
    ----------
    node : ManagedNode
    scene : Scene or SpaceScene or None
    known : iterable of RobotSpec
        The robots that are there from the start.
    accepts : bool
        Whether robots may join.
    join : callable
        Called with the spec of a robot; InvalidInput says why it cannot join.
    leave : callable
        Called with the id of a robot that was there.
    """

    def __init__(
        self,
        node: ManagedNode,
        scene: AnyScene | None,
        known: Iterable[RobotSpec],
        accepts: bool,
        join: Callable[[RobotSpec], None],
        leave: Callable[[str], None],
    ) -> None:
        self._node, self._scene, self._accepts = node, scene, accepts
        self._known = {spec.id: spec for spec in known}
        planned = () if scene is None else planned_robots(scene)
        everybody = () if scene is None else scene.robots
        self._strangers = {robot.id for robot in everybody if robot not in planned}
        self._join, self._leave = join, leave
        self._waiting: list[Announcement] = []
        self._stamps: dict[str, int] = {}  # of the last word about each robot [ns]
        self._heard: set[tuple[str, bool]] = set()  # who has said that it joins (True) or leaves
        self.present = dict(self._known)
        """Robots in the workspace by id."""

    def configure(self) -> None:
        """Make the publisher for robots that are taken out by hand."""
        self._mouth = self._node.publisher(
            DiagnosticStatus, ROBOTS_TOPIC, for_mode(self._node.lockstep, LATCHED)
        )

    def start(self, heard: Callable[[], None]) -> None:
        """Listen until the node is deactivated; `heard` is called after every announcement in lockstep."""

        def hear(message: Any) -> None:
            self._hear(message)
            if self._node.lockstep:
                heard()

        self._node.listen(DiagnosticStatus, ROBOTS_TOPIC, hear, INBOX)

    def reset(self) -> None:
        """With a scene: begin it anew, with the robots that are there from the start."""
        self._waiting.clear()
        self._heard.clear()
        self._stamps.clear()
        if self._scene is None:
            return
        for name in [name for name in self.present if name not in self._known]:
            self._remove(name)
        for name, spec in self._known.items():
            if name not in self.present:
                self._add(spec)

    def is_complete(self, tick: int) -> bool:
        """In lockstep: whether all who join or leave by a tick [ns] by the scene were heard."""
        return not self._due(tick)

    def _due(self, tick: int) -> list[str]:
        """Ids of robots of the scene whose announcements are missing at a tick [ns]."""
        if self._scene is None:
            return []
        missing = []
        for robot in planned_robots(self._scene):
            joins, leaves = (self._scene.instant(when) for when in (robot.joins_at, robot.leaves_at))
            gone = math.isfinite(leaves) and nanoseconds(leaves) <= tick
            came = nanoseconds(joins) <= tick
            if (gone and (robot.id, False) not in self._heard) or (
                came and robot.id not in self._known and (robot.id, True) not in self._heard
            ):
                missing.append(robot.id)
        return missing

    def settle(self, tick: int) -> None:
        """In lockstep: let those join and leave that said so up to a tick [ns]."""
        due = [one for one in self._waiting if one.stamp <= tick]
        if not due:
            return
        self._waiting = [one for one in self._waiting if one.stamp > tick]
        order = {} if self._scene is None else {robot.id: i for i, robot in enumerate(self._scene.robots)}
        due.sort(key=lambda one: (one.stamp, one.spec is not None, order.get(one.id, len(order)), one.id))
        for announcement in due:
            self._apply(announcement)

    def take_out(self, name: str, now: int) -> bool:
        """Take a robot out by hand at a time [ns], and tell all others; return whether it was there."""
        if name not in self.present:
            return False
        self._remove(name)
        self._stamps[name] = now
        self._mouth.publish(announcement_to_message(Announcement(name, now, None)))
        return True

    def _hear(self, message: Any) -> None:
        try:
            announcement = announcement_from_message(message, ROBOTS_TOPIC)
        except InvalidInput as error:
            self._node.get_logger().warning(f"announcement not used: {error}")
            return
        if announcement.id in self._strangers:
            return
        self._heard.add((announcement.id, announcement.spec is not None))
        if self._node.lockstep:
            self._waiting.append(announcement)
        else:
            self._apply(announcement)

    def _apply(self, announcement: Announcement) -> None:
        name, spec, log = announcement.id, announcement.spec, self._node.get_logger()
        if announcement.stamp < self._stamps.get(name, -1):
            return  # kept for those who come late, and overtaken by now
        latest = math.inf
        if not self._node.lockstep and has_time(self._node):
            latest = now_of(self._node) + _AHEAD
        if spec is None and announcement.stamp > latest:
            ahead = seconds(announcement.stamp - now_of(self._node))
            log.warning(
                f"robot {name} says that it leaves in {ahead:.1f} s; it counts as there, synchronise the clocks"
            )
            return
        # Whoever joins is there, whatever its clock says; but what it says later must not seem older.
        self._stamps[name] = int(min(announcement.stamp, latest))
        if spec is None:
            if name in self.present:
                self._remove(name)
                log.info(f"robot {name} left")
        elif name in self.present:
            if self.present[name] != spec:
                log.warning(
                    f"announcement not used: robot {name} is there as {_body(self.present[name])}, not as "
                    f"{_body(spec)}; give every robot a name of its own, or let it leave first"
                )
        elif not self._accepts:
            log.warning(f"robot {name} announces itself, accept_robots is false; it is not planned around")
        else:
            self._add(spec)

    def _add(self, spec: RobotSpec) -> None:
        try:
            self._join(spec)
        except InvalidInput as error:
            self._node.get_logger().warning(
                f"robot {spec.id} cannot join: {error}; take it out of the workspace"
            )
            return
        self.present[spec.id] = spec

    def _remove(self, name: str) -> None:
        del self.present[name]
        self._leave(name)


def _body(spec: RobotSpec) -> str:
    return f"radius {spec.radius:g} m, speed {spec.speed:g} m/s, turn rate {spec.max_turn_rate:g} rad/s"
