"""Run one node as a program: it ends cleanly on Ctrl-C, SIGTERM or a shutdown from outside."""

from __future__ import annotations

import importlib
import os
import signal
import sys
from collections.abc import Callable, Sequence
from typing import Any

from snnav_core.errors import SnnavError
from snnav_ros.available import make_executor, require_ros
from snnav_ros.parameter_files import ParameterFileError, check_parameter_files, parameter_files

__all__ = ["PARENT_VARIABLE", "run_node"]

PARENT_VARIABLE = "SNNAV_PARENT"
"""Environment variable with the process that started this one; when that is gone, the node ends."""

_LONGEST_WAIT = 0.2  # [s]


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
    signal.signal(signal.SIGINT, _raise)
    signal.signal(signal.SIGTERM, _raise)
    arguments = sys.argv if args is None else ["", *args]
    try:
        check_parameter_files(arguments)
        return _run(module, name, arguments)
    except _ToldToEnd:
        return 0
    except ParameterFileError as error:
        print(error, file=sys.stderr)
    except SnnavError as error:
        files = ", ".join(map(str, parameter_files(arguments)))
        print(f"{error}{f' (parameter file {files})' if files else ''}", file=sys.stderr)
    return 2


class _ToldToEnd(BaseException):
    """A signal during the start. (After a KeyboardInterrupt, CPython may exit with 130 although it was caught.)"""


def _raise(*_: Any) -> None:
    raise _ToldToEnd


def _run(module: str, name: str, arguments: Sequence[str]) -> int:
    require_ros(name)
    import rclpy
    from rclpy.signals import SignalHandlerOptions

    node_class = getattr(importlib.import_module(module), name)
    told = _told_to_end()
    try:
        rclpy.init(args=list(arguments), signal_handler_options=SignalHandlerOptions.NO)
    except Exception as error:  # rcl reports bad arguments and parameter files by several types
        raise SnnavError(_first_line(error)) from None
    node = executor = None
    try:
        node = node_class()
        executor = make_executor()
        executor.add_node(node)
        _spin(executor, told)
    finally:
        if executor is not None:
            executor.shutdown()
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()
    return 0


def _told_to_end() -> Callable[[], bool]:
    """Note signals from now on; what is being done is done to its end, nothing fails half-way with an exception."""
    told = False

    def note(*_: Any) -> None:
        nonlocal told
        told = True

    signal.signal(signal.SIGINT, note)
    signal.signal(signal.SIGTERM, note)
    parent = int(os.environ.get(PARENT_VARIABLE, "0"))
    return lambda: told or parent not in (0, os.getppid())


def _spin(executor: Any, told: Callable[[], bool]) -> None:
    """Work until told to end or ROS is shut down (`spin` of the events executor would not return)."""
    from rclpy.executors import ExternalShutdownException
    from rclpy.utilities import ok

    try:
        while ok() and not told():
            executor.spin_once(timeout_sec=_LONGEST_WAIT)
    except ExternalShutdownException:
        return


def _first_line(error: Exception) -> str:
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return lines[0] if lines else type(error).__name__
