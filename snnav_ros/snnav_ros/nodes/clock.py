"""The node that makes simulated time: in lockstep with all other nodes, or at a rate of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rclpy.clock import Clock as RosClock
from rclpy.clock import ClockType
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Header

from snnav_ros.casting import every_sample, every_tick
from snnav_ros.convert import nanoseconds, nanoseconds_from_stamp, seconds, stamp_message
from snnav_ros.lockstep import DONE_TOPIC
from snnav_ros.nodes.base import NodeOptions, serve
from snnav_ros.parameters import ParameterReader
from snnav_ros.qos import CLOCK, DONE_INBOX, LOCKSTEP
from snnav_ros.scenes import read_scene
from snnav_ros.waiting import WaitingReport

__all__ = ["ClockNode", "ClockParameters"]


@dataclass(frozen=True)
class ClockParameters:
    """Parameters of the node besides `scene`.

    Parameters
    ----------
    control_period : float
        One tick [s].
    sampling_interval : float
        From one decision to the next; a whole number of ticks [s].
    lockstep : bool
        Go on only when all participants that are due have consumed the data of the tick.
    rate : float
        Simulated seconds in a second, without lockstep.
    every_tick : tuple of str
        Participants due at every tick: names of the robot nodes, and of sensors that see robots. Those of the scene
        when left out.
    every_sample : tuple of str
        Participants due at every sampling instant: sensors, fusion, tracker and planner. Those of the scene when left
        out.
    """

    control_period: float = 0.05
    sampling_interval: float = 1.0
    lockstep: bool = False
    rate: float = 1.0
    every_tick: tuple[str, ...] = ()
    every_sample: tuple[str, ...] = ()


class ClockNode(Node):
    """Publishes `/clock`; in lockstep hears `lockstep/done`."""

    def __init__(self, options: NodeOptions | None = None) -> None:
        options = options or NodeOptions()
        super().__init__(options.name or "clock_node", **options.keywords())
        self.settings = self._read(ParameterReader(self))
        self._period_ns = nanoseconds(self.settings.control_period)
        self._sample_ns = nanoseconds(self.settings.sampling_interval)
        self._now = 0
        self._missing: set[str] = set()
        self._paused = self._halted = False
        lockstep = self.settings.lockstep
        self._clock = self.create_publisher(Clock, "/clock", LOCKSTEP if lockstep else CLOCK)
        serve(self, options, self.reset, {"pause": self._pause})
        if lockstep:
            self.create_subscription(Header, DONE_TOPIC, self._on_done, DONE_INBOX)
            self._tick()
            self._waiting = WaitingReport(self, lambda: sorted(self._missing))
        else:
            wall = RosClock(clock_type=ClockType.STEADY_TIME)
            self.create_timer(self.settings.control_period / self.settings.rate, self._on_timer, clock=wall)

    def _read(self, reader: ParameterReader) -> ClockParameters:
        scene = read_scene(reader)
        defaults: dict[str, object] = {}
        if scene is not None:
            defaults = {
                "control_period": scene.control_period,
                "sampling_interval": scene.sampling_interval,
                "every_tick": every_tick(scene),
                "every_sample": every_sample(scene),
            }
        settings = reader.settings(ClockParameters, **defaults)
        reader.finish()
        ratio = settings.sampling_interval / settings.control_period
        if abs(ratio - round(ratio)) > 1e-6 or ratio < 0.5:
            remark = f"value {settings.control_period} does not divide sampling_interval {settings.sampling_interval}"
            reader.fail("control_period", f"{remark}; make one a multiple of the other")
        if settings.lockstep and not (settings.every_tick or settings.every_sample):
            reader.fail("every_tick", "is empty, as every_sample is; name the participants, or give `scene`")
        return settings

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return seconds(self._now)

    def reset(self) -> None:
        """Begin at time zero again; all nodes start afresh."""
        self._now = 0
        if self.settings.lockstep:
            self._tick()

    def _pause(self, paused: bool) -> None:
        self._paused = paused
        if not paused and self._halted:
            self._halted = False
            self._advance()

    def _on_timer(self) -> None:
        if not self._paused:
            self._publish()
            self._now += self._period_ns

    def _publish(self) -> None:
        self._clock.publish(Clock(clock=stamp_message(self._now)))

    def _tick(self) -> None:
        """Publish a tick of lockstep and wait for all that are due."""
        self._missing = set(self._due())
        self._publish()

    def _due(self) -> Sequence[str]:
        if self._now % self._sample_ns == 0:
            return self.settings.every_tick + self.settings.every_sample
        return self.settings.every_tick

    def _on_done(self, message: Header) -> None:
        if nanoseconds_from_stamp(message.stamp) != self._now:
            return
        self._missing.discard(message.frame_id)
        if not self._missing:
            if self._paused:
                self._halted = True
            else:
                self._advance()

    def _advance(self) -> None:
        self._now += self._period_ns
        while not self._due():  # nobody is interested in this tick
            self._now += self._period_ns
        self._tick()
