"""A node that was told to end is not disturbed by a second signal, as `ros2 launch` sends it."""

from __future__ import annotations

import signal
import subprocess
import sys
import time

import pytest


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_further_signals_change_nothing(number: signal.Signals) -> None:
    command = [sys.executable, "-m", "snnav_ros.nodes.planner_node", "--ros-args", "-p", "scene:=hello"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as child:
        try:
            assert child.stdout is not None
            assert any("waiting for" in line for line in child.stdout)  # a slow machine says more before
            end = time.monotonic() + 10.0
            while child.poll() is None:
                assert time.monotonic() < end, "the node lives on"
                child.send_signal(number)
            assert child.returncode == 0
            assert child.stdout.read().count("\n") <= 1  # of what it may have said before the signal
        finally:
            child.kill()


def test_unknown_argument_of_ros_is_named() -> None:
    command = [sys.executable, "-m", "snnav_ros.nodes.clock_node", "--ros-args", "scene:=hello"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=20.0, check=False)
    assert done.returncode == 2
    assert "arguments after --ros-args cannot be used: " in done.stderr
    assert "scene:=hello" in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
