"""What this machine offers: the one module that asks, so that no other has to try an import."""

from __future__ import annotations

from functools import cache
from importlib import import_module
from importlib.util import find_spec
from typing import Any

from snnav_core.errors import SnnavError

__all__ = [
    "MissingRos",
    "has_ros",
    "has_tf2",
    "make_executor",
    "make_tf_broadcasters",
    "new_message",
    "require_ros",
]

_REMEDY = (
    "source a ROS 2 Jazzy installation, or `pip install -r requirements-ros.txt` into a venv of Python 3.11"
)


class MissingRos(SnnavError):
    """ROS 2 is asked for and not there."""


def has_ros() -> bool:
    """Whether rclpy can be imported."""
    return find_spec("rclpy") is not None


def require_ros(purpose: str) -> None:
    """Make sure that ROS 2 is there.

    Parameters
    ----------
    purpose : str
        What needs it, for the message.

    Raises
    ------
    MissingRos
        One line that says what to install or to source.
    """
    if not has_ros():
        raise MissingRos(f"{purpose} needs ROS 2 (rclpy), which is not found: {_REMEDY}")


@cache
def _message_class(name: str) -> Any:
    package, _, interface = name.partition("/")
    return getattr(import_module(f"{package}.msg"), interface)


def new_message(kind: str, /, **fields: Any) -> Any:
    """Return a message by the name of its type, such as ``nav_msgs/Path``; its package is imported when first used."""
    return _message_class(kind)(**fields)


def has_tf2() -> bool:
    """Whether transforms can be broadcast (the wheels of rclpy come without tf2)."""
    return find_spec("tf2_ros") is not None


def make_tf_broadcasters(node: Any) -> tuple[Any, Any] | None:
    """Return a broadcaster of moving and one of fixed transforms for a node, or None without tf2."""
    if not has_tf2():
        return None
    from tf2_ros import StaticTransformBroadcaster, TransformBroadcaster

    return TransformBroadcaster(node), StaticTransformBroadcaster(node)


def make_executor(context: Any = None) -> Any:
    """Return the executor that all programs of snnav use.

    The events executor where rclpy has it (1,200 lockstep ticks of 14 nodes: 1.2 s against 8.6 s), else the
    single-threaded one. Drive it by `spin_once` only: `spin` of the events executor does not return after a
    signal or an exception.
    """
    from rclpy.executors import SingleThreadedExecutor

    if find_spec("rclpy.experimental") is not None:
        from rclpy import experimental

        if hasattr(experimental, "EventsExecutor"):
            return experimental.EventsExecutor(context=context)
    return SingleThreadedExecutor(context=context)
