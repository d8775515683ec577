"""The time of a node, and whether it goes as it should: a clock can be set back, a steady clock cannot."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from rclpy.clock import Clock, ClockType, JumpThreshold
from rclpy.duration import Duration
from rclpy.node import Node

from snnav_ros.convert import seconds

__all__ = ["ClockWatch", "has_time", "is_simulated", "now_of", "steady_clock", "watch_time"]

_TOLERANCE = 0.1  # [s] that the clock of ROS may differ from the steady one from one look to the next
_LOOK = 0.1  # [s] from one look to the next


def steady_clock() -> Clock:
    """Return a clock for timers that go on whatever happens to the clock of ROS."""
    return Clock(clock_type=ClockType.STEADY_TIME)


def now_of(node: Node) -> int:
    """Return the time of a node's clock [ns]."""
    return int(node.get_clock().now().nanoseconds)


def is_simulated(node: Node) -> bool:
    """Whether the time of a node comes from `/clock`."""
    return bool(node.get_parameter("use_sim_time").value)


def has_time(node: Node) -> bool:
    """Whether a node knows the time; one that lives by `/clock` has none before it hears the first tick."""
    return not is_simulated(node) or now_of(node) > 0


class ClockWatch:
    """Compares the clock of ROS with a steady one, as long as it does not come from `/clock`.

    Parameters
    ----------
    now : callable
        Time of ROS [ns].
    steady : callable
        Time of a clock that nobody can set [ns].
    """

    def __init__(self, now: Callable[[], int], steady: Callable[[], int] = time.monotonic_ns) -> None:
        self._now, self._steady = now, steady
        self._offset = self._look()

    def jump(self) -> float:
        """Return how far the clock jumped since the last look [s], zero within the tolerance of 0.1 s."""
        (low, high), (lower, higher) = self._look(), self._offset
        self._offset = (low, high)
        jump = seconds(max(low - higher, 0) + min(high - lower, 0))
        return jump if abs(jump) > _TOLERANCE else 0.0

    def _look(self) -> tuple[int, int]:
        """Return the least and the largest that clock minus steady clock may be: the process may sleep in between."""
        before, now, after = self._steady(), self._now(), self._steady()
        return now - after, now - before


def watch_time(node: Node, reset: Callable[[], None]) -> Any:
    """Call `reset` whenever the clock of a node jumps back; the returned handle must be kept.

    Simulated time is watched by rclpy; the clock of the machine, which may be set by hand or by NTP, by comparing it
    with a steady one.
    """

    def tell(jump: float) -> None:
        node.get_logger().warning(f"time jumped back by {-jump:.3f} s: starting afresh")
        reset()

    if is_simulated(node):
        back = JumpThreshold(min_forward=None, min_backward=Duration(nanoseconds=-1), on_clock_change=False)
        return node.get_clock().create_jump_callback(
            back, post_callback=lambda jump: tell(seconds(jump.delta.nanoseconds))
        )
    watch = ClockWatch(lambda: now_of(node))

    def look() -> None:
        jump = watch.jump()
        if jump < 0.0:
            tell(jump)

    return node.create_timer(_LOOK, look, clock=steady_clock())
