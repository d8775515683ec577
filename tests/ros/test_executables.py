"""Every executable alone: it says what it waits for, and answers Ctrl-C and SIGTERM within two seconds."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from support.waiting import until

NODES = {
    "lms200_node": (["scene:=hello", "sensor_id:=lms_west", "use_sim_time:=true"], "waiting for: /clock"),
    "tof_node": (
        ["scene:=hello_flight", "sensor_id:=south_west", "use_sim_time:=true"],
        "waiting for: /clock, bee/odom",
    ),
    "fusion_node": (["scene:=hello"], "waiting for: sensors/lms_west/scan, sensors/lms_east/scan"),
    "planner_node": (["scene:=hello"], "waiting for: unoccupied_area, robot_1/odom"),
    "tracker_node": (["scene:=hello"], "waiting for: unoccupied_area, unoccupied_area/returns"),
    "global_planner_node": (["scene:=hello"], "waiting for: obstacles, obstacles/workspace, robot_1/odom"),
    "robot_node": (["scene:=hello"], "waiting for: robot_1/path, robot_1/certificate"),
    "clock_node": (
        ["scene:=hello", "lockstep:=true"],
        "waiting for: fusion_node, lms_east, lms_west, planner_node, robot_1",
    ),
}


@contextmanager
def started(name: str, parameters: list[str], *more: str) -> Iterator[subprocess.Popen[str]]:
    arguments = [part for one in parameters for part in ("-p", one)]
    child = subprocess.Popen(
        [sys.executable, "-m", f"snnav_ros.nodes.{name}", "--ros-args", *arguments, *more],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        bufsize=1,
    )
    try:
        yield child
    finally:
        if child.poll() is None:
            child.kill()
        child.communicate()


def read_until(child: subprocess.Popen[str], text: str) -> str:
    assert child.stdout is not None
    said = ""
    for line in child.stdout:
        said += line
        if text in line:
            return said
    raise AssertionError(f"ended with {child.wait()} without saying {text!r}: {said}")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("name", NODES)
def test_says_what_it_waits_for_and_ends_cleanly(name: str, number: signal.Signals) -> None:
    parameters, waiting = NODES[name]
    with started(name, parameters) as child:
        read_until(child, waiting)
        begin = time.monotonic()
        child.send_signal(number)
        rest, _ = child.communicate(timeout=10.0)
        assert time.monotonic() - begin < 2.0
        assert child.returncode == 0
        assert "Traceback" not in rest
        assert "Error" not in rest


def test_namespace_goes_before_every_name() -> None:
    parameters, waiting = NODES["planner_node"]
    with started("planner_node", parameters, "-r", "__ns:=/hall_3") as child:
        assert "[hall_3.planner_node]" in read_until(child, waiting)


@pytest.mark.parametrize("delay", [0.05, 0.3, 0.6])
def test_signal_during_the_start_ends_cleanly(delay: float) -> None:
    parameters, _ = NODES["fusion_node"]
    with started("fusion_node", parameters) as child:
        with pytest.raises(subprocess.TimeoutExpired):
            child.wait(timeout=delay)  # a moment that nothing announces
        child.send_signal(signal.SIGINT)
        said, _ = child.communicate(timeout=10.0)
        assert "RCLError" not in said
        # until the program has begun, Python answers as it does
        assert child.returncode == 0 or ("in run_node" not in said and "waiting for" not in said)


@pytest.mark.parametrize("name", NODES)
def test_mistake_is_one_line_and_status_2(name: str, tmp_path: Path) -> None:
    file = tmp_path / "site.yaml"
    scene = "hello_flight" if name == "tof_node" else "hello"
    text = f"{name}:\n  ros__parameters:\n    scene: {scene}\n    lockstepp: true\n"
    file.write_text(text, encoding="utf-8")
    more = "" if name in ("planner_node", "fusion_node", "clock_node") else NODES[name][0][-1]
    with started(name, [more] if more else [], "--params-file", str(file)) as child:
        said, _ = child.communicate(timeout=20.0)
    assert child.returncode == 2
    assert len(said.strip().splitlines()) == 1
    assert re.search(
        r"parameter (lockstepp: is unknown \(value True\); did you mean lockstep\?|sensor_id)", said
    )
    assert str(file) in said


def test_node_without_its_parent_ends() -> None:
    code = (
        "import os, subprocess, sys\n"
        "env = {**os.environ, 'SNNAV_PARENT': str(os.getpid())}\n"
        "command = [sys.executable, '-m', 'snnav_ros.nodes.clock_node']\n"
        "child = subprocess.Popen(command, env=env, stdin=subprocess.DEVNULL)\n"
        "print(child.pid, flush=True)\n"
        "child.wait()\n"
    )
    parent = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    assert parent.stdout is not None
    node = int(parent.stdout.readline())
    parent.kill()
    parent.wait()
    until(lambda: not Path(f"/proc/{node}").exists(), "the end of the node", longest=20.0)
