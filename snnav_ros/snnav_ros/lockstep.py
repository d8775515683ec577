"""One participant of a lockstep run (docs/interfaces.md, "Lockstep").

The clock publishes a tick and waits until every participant that is due has said that it consumed all data of it.
Every topic is reliable and transient local, so a participant that is discovered late gets what it waits for: the clock
cannot have gone on without it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Header

from snnav_ros.convert import nanoseconds_from_stamp, stamp_message
from snnav_ros.qos import LOCKSTEP

__all__ = ["DONE_TOPIC", "Participant"]

DONE_TOPIC = "lockstep/done"


class Participant:
    """Hears the ticks and says when their data are consumed.

    Parameters
    ----------
    node : Node
        Its name is the name of the participant.
    period_ns : int
        It is due at multiples of this [ns].
    on_tick : callable
        Called once for every tick that is due, with its time [ns].
    on_reset : callable
        Called before `on_tick` when time has jumped back.
    """

    def __init__(
        self, node: Node, period_ns: int, on_tick: Callable[[int], None], on_reset: Callable[[], None]
    ) -> None:
        self._node, self._name, self._period_ns = node, node.get_name(), period_ns
        self._on_tick, self._on_reset = on_tick, on_reset
        self._now = -1
        self.due: int | None = None
        """The tick whose data are not yet consumed [ns]."""
        self._done = node.create_publisher(Header, DONE_TOPIC, LOCKSTEP)
        self._subscription = node.create_subscription(Clock, "/clock", self._hear, LOCKSTEP)

    @property
    def now(self) -> int:
        """The last tick that was heard [ns]; -1 before the first."""
        return self._now

    def done(self) -> None:
        """Say that all data of the tick that is due are consumed."""
        if self.due is None:
            return
        tick, self.due = self.due, None
        self._done.publish(Header(stamp=stamp_message(tick), frame_id=self._name))

    def destroy(self) -> None:
        """Take no part any more."""
        self._node.destroy_subscription(self._subscription)
        self._node.destroy_publisher(self._done)

    def _hear(self, message: Any) -> None:
        now = nanoseconds_from_stamp(message.clock)
        if now < self._now:
            self._on_reset()
            self.due = None
        elif now == self._now:
            return
        self._now = now
        if now % self._period_ns == 0:
            self.due = now
            self._on_tick(now)
