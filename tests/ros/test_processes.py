"""Child processes that are killed, put to sleep and started again."""

from __future__ import annotations

import signal
from pathlib import Path

from snnav_ros.processes import ChildProcesses
from support.waiting import until

CLOCK = ("clock_node", "snnav_ros.nodes.clock_node", {"control_period": 0.1})


def test_killed_node_is_not_missed_and_can_be_started_again(tmp_path: Path, ros_domain: int) -> None:
    with ChildProcesses(tmp_path, ros_domain) as children:
        children.start(*CLOCK)
        first = children._children["clock_node"].pid
        children.kill("clock_node")
        assert children.ended() == ""
        children.restart("clock_node", rate=2.0)
        assert "rate: 2.0" in (tmp_path / "clock_node.yaml").read_text()
        second = children._children["clock_node"].pid
        children.restart("clock_node", rate=0.0)  # kills the one that runs; a mistake ends the new one
        assert children._children["clock_node"].pid not in (first, second)
        until(children.ended, "the end of a process")
        assert "rate: value 0.0 lies outside" in children.ended()


def test_sleeping_node_is_ended_like_others(tmp_path: Path, ros_domain: int) -> None:
    with ChildProcesses(tmp_path, ros_domain) as children:
        children.start(*CLOCK)
        process = children._children["clock_node"]
        children.kill("clock_node", signal.SIGSTOP)
        state = Path(f"/proc/{process.pid}/stat")
        until(lambda: state.read_text().rpartition(")")[2].split()[0] == "T", "a process that sleeps")
    assert process.returncode is not None
    assert process.returncode != -signal.SIGKILL
