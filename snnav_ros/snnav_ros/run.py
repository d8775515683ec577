"""Run one node as a program: it ends cleanly on Ctrl-C, SIGTERM or a shutdown from outside."""

from __future__ import annotations

import gc
import importlib
import os
import signal
import sys
import threading
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from typing import Any

from snnav_core.errors import SnnavError
from snnav_ros.available import make_executor, require_ros
from snnav_ros.parameter_files import ParameterFileError, check_parameter_files, parameter_files
from snnav_ros.signals import noted_signals

__all__ = ["PARENT_VARIABLE", "run_node"]

PARENT_VARIABLE = "SNNAV_PARENT"
"""Environment variable with the process that started this one; when that is gone, the node ends."""

_LONGEST_WAIT = 0.2  # [s]
_SILENCE = 8.0  # [s]


def run_node(module: str, name: str, args: Sequence[str] | None = None, *, kernels: bool = False) -> int:
    """Run the node class `name` of `module` until it is told to end.

    Parameters
    ----------
    module, name : str
        Where the class is; it is imported here, so that a Ctrl-C during the start is clean as well.
    args : sequence of str, optional
        Arguments of the program with those of ROS, ``sys.argv`` by default.
    kernels : bool
        Whether the numerical kernels are made ready first, so that no step has to wait for the compiler. A bring-up
        that starts this program has done so already.

    Returns
    -------
    int
        Exit status: 0 after a signal, 2 after a mistake of the user (one line on stderr).
    """
    signal.signal(signal.SIGINT, _raise)
    signal.signal(signal.SIGTERM, _raise)
    arguments = sys.argv if args is None else ["", *args]
    try:
        status = _run_or_refuse(module, name, arguments, kernels)
        _ignore_signals()
    except _ToldToEnd:
        status = 0
    gc.freeze()  # the end takes 0.05 instead of 0.5 s: no search through all that numba and scipy have made
    return status


def _run_or_refuse(module: str, name: str, arguments: Sequence[str], kernels: bool) -> int:
    """Run the node, or say in one line what is wrong with its parameters; return the exit status."""
    try:
        check_parameter_files(arguments)
        if kernels and PARENT_VARIABLE not in os.environ:
            _prepare_kernels(name)
        return _run(module, name, arguments)
    except ParameterFileError as error:
        print(error, file=sys.stderr)
    except SnnavError as error:
        files = ", ".join(map(str, parameter_files(arguments)))
        print(f"{error}{f' (parameter file {files})' if files else ''}", file=sys.stderr)
    return 2


class _ToldToEnd(BaseException):
    """A signal during the start; not KeyboardInterrupt, for CPython may exit with 130 after one that was caught."""


def _raise(*_: Any) -> None:
    _ignore_signals()
    raise _ToldToEnd


def _ignore_signals() -> None:
    """Let no second signal kill what is ending, as `ros2 launch` may send it and then call it a failure."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)


def _prepare_kernels(name: str) -> None:
    """Load the kernels, or compile them: that takes a while once, and is said then."""
    note = f"{name}: compiling the numerical kernels, once; this takes up to a minute"
    timer = threading.Timer(_SILENCE, lambda: print(note, file=sys.stderr, flush=True))
    timer.daemon = True
    timer.start()
    try:
        from snnav_sim.warm_up import warm_up

        warm_up()
    finally:
        timer.cancel()


def _run(module: str, name: str, arguments: Sequence[str]) -> int:
    require_ros(name)
    import rclpy
    from rclpy.signals import SignalHandlerOptions

    node_class = getattr(importlib.import_module(module), name)
    with ExitStack() as stack:
        told = stack.enter_context(noted_signals())
        try:
            rclpy.init(args=list(arguments), signal_handler_options=SignalHandlerOptions.NO)
        except Exception as error:  # rcl reports bad arguments and parameter files by several types
            raise SnnavError(f"arguments after --ros-args cannot be used: {_first_line(error)}") from None
        stack.callback(rclpy.try_shutdown)
        node = node_class()
        stack.callback(node.destroy_node)
        executor = make_executor()
        stack.callback(executor.shutdown)
        executor.add_node(node)
        _spin(executor, told)
    return 0


def _spin(executor: Any, told: Callable[[], bool]) -> None:
    """Work until told to end or ROS is shut down (`spin` of the events executor would not return)."""
    from rclpy.executors import ExternalShutdownException
    from rclpy.utilities import ok

    parent = int(os.environ.get(PARENT_VARIABLE, "0"))
    try:
        while ok() and not told() and parent in (0, os.getppid()):
            executor.spin_once(timeout_sec=_LONGEST_WAIT)
    except ExternalShutdownException:
        return


def _first_line(error: Exception) -> str:
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return lines[0] if lines else type(error).__name__
