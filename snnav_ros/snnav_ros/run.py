"""Run one node as a program: it ends cleanly on Ctrl-C, SIGTERM or a shutdown from outside."""

from __future__ import annotations

import importlib
import os
import signal
import sys
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

from snnav_core.errors import SnnavError
from snnav_ros.available import make_executor, require_ros

__all__ = ["PARENT_VARIABLE", "run_node", "spin"]

PARENT_VARIABLE = "SNNAV_PARENT"
"""Environment variable with the process that started this one; when that is gone, the node ends."""

_LONGEST_WAIT = 0.5  # [s]


def run_node(module: str, name: str, args: Sequence[str] | None = None) -> int:
    """Run the node class `name` of `module` until it is told to end.

    Parameters
    ----------
    module, name : str
        Where the class is; it is imported here, so that a Ctrl-C during the start is clean as well.
    args : sequence of str, optional
        Arguments of the program with those of ROS, ``sys.argv`` by default.

    Returns
    -------
    int
        Exit status: 0 after a signal, 2 after a mistake of the user (one line on stderr).
    """
    signal.signal(signal.SIGTERM, _raise_interrupt)
    try:
        return _run(module, name, sys.argv if args is None else ["", *args])
    except KeyboardInterrupt:
        return 0
    except SnnavError as error:
        print(f"{error}{_files(sys.argv if args is None else args)}", file=sys.stderr)
        return 2


def _raise_interrupt(*_: Any) -> None:
    raise KeyboardInterrupt


def _run(module: str, name: str, arguments: Sequence[str]) -> int:
    require_ros(name)
    import rclpy
    from rclpy.executors import ExternalShutdownException

    node_class = getattr(importlib.import_module(module), name)
    try:
        rclpy.init(args=list(arguments))
    except Exception as error:  # rcl reports bad arguments and parameter files by several types
        raise SnnavError(_first_line(error)) from None
    node = executor = None
    try:
        node = node_class()
        executor = make_executor()
        executor.add_node(node)
        spin(executor)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        if executor is not None:
            executor.shutdown()
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()
    return 0


def spin(executor: Any) -> None:
    """Work until ROS is shut down or the parent is gone (`spin` of the events executor would not return)."""
    from rclpy.utilities import ok

    parent = int(os.environ.get(PARENT_VARIABLE, "0"))
    while ok() and parent in (0, os.getppid()):
        executor.spin_once(timeout_sec=_LONGEST_WAIT)


def _first_line(error: Exception) -> str:
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return lines[0] if lines else type(error).__name__


def _files(arguments: Sequence[str]) -> str:
    """Return the parameter files among the arguments, for a message."""
    files = [str(Path(value)) for key, value in pairwise(arguments) if key == "--params-file"]
    return f" (parameter file {', '.join(files)})" if files else ""
