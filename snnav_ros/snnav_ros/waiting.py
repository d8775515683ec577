"""A node that gets nothing says what it waits for, at once and then every five seconds of wall time."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from rclpy.clock import Clock, ClockType
from rclpy.node import Node

__all__ = ["WaitingReport"]

_PERIOD = 5.0  # [s]


class WaitingReport:
    """Reports inputs of which nothing came since the last report.

    Parameters
    ----------
    node : Node
    expected : callable
        Returns the names of the topics (or whatever else) that should bring something now.
    """

    def __init__(self, node: Node, expected: Callable[[], Iterable[str]]) -> None:
        self._node, self._expected = node, expected
        self._heard: set[str] = set()
        self._silent = False
        self._timer = node.create_timer(_PERIOD, self.report, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self.report()

    def heard(self, name: str) -> None:
        """Note that something came."""
        self._heard.add(name)

    def report(self) -> None:
        """Say what is waited for, or once that everything comes."""
        missing = [name for name in self._expected() if name not in self._heard]
        if missing:
            self._node.get_logger().info(f"waiting for: {', '.join(missing)}")
        elif self._silent:
            self._node.get_logger().info("everything arrives")
        self._silent = bool(missing)
        self._heard.clear()

    def destroy(self) -> None:
        """Say nothing any more."""
        self._node.destroy_timer(self._timer)
