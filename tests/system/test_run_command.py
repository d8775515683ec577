"""`snnav` as a person uses it: in a shell, with exit status and what is left behind."""

from __future__ import annotations

import csv
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from snnav_ros.bag.reader import BagReader
from snnav_sim.scene import find_scene, load_scene

# rclpy looks as if it were not installed
WITHOUT_ROS = """
import importlib.util, sys
class Block:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in ("rclpy", "std_msgs", "sensor_msgs", "nav_msgs", "builtin_interfaces"):
            raise ModuleNotFoundError(f"no {name}")
sys.meta_path.insert(0, Block())
found = importlib.util.find_spec
importlib.util.find_spec = lambda name, *rest: None if name == "rclpy" else found(name, *rest)
from snnav_ros.cli import main
sys.exit(main(sys.argv[1:]))
"""


def snnav(*arguments: str, cwd: Path, ros: bool = True) -> subprocess.CompletedProcess[str]:
    start = ["-m", "snnav_ros.cli"] if ros else ["-c", WITHOUT_ROS]
    command = [sys.executable, *start, *arguments]
    return subprocess.run(command, cwd=cwd, capture_output=True, text=True, check=False, timeout=120)


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_run_with_and_without_ros_writes_the_same_directory(tmp_path: Path) -> None:
    with_ros = snnav("run", "hello", "--out", "ros", cwd=tmp_path)
    without = snnav("run", "hello", "--core", "--out", "core", cwd=tmp_path, ros=False)
    assert (with_ros.returncode, without.returncode) == (0, 0), with_ros.stderr + without.stderr
    assert "run directory: ros" in with_ros.stdout
    assert "arrived" in with_ros.stdout
    for name in ("scene.yaml", "trajectories.csv", "paths.csv"):
        assert (tmp_path / "ros" / name).read_bytes() == (tmp_path / "core" / name).read_bytes()
    for run in ("ros", "core"):
        metrics = json.loads((tmp_path / run / "metrics.json").read_text(encoding="utf-8"))
        assert metrics["robots"]["robot_1"]["reached"]
        assert metrics["planner"]["step_ms"]["p50"] > 0.0
        assert metrics["fusion"]["step_ms"]["p50"] > 0.0
        assert sorted(path.name for path in (tmp_path / run / "figures").iterdir()) == [
            "animation.gif",
            "clearance.png",
            "decisions.png",
            "scene.png",
            "snapshots.png",
        ]
    assert "rclpy" in json.loads((tmp_path / "ros" / "metrics.json").read_text(encoding="utf-8"))["versions"]
    with BagReader(tmp_path / "ros" / "bag") as bag:
        assert bag.topics["/robot_1/path"] == "nav_msgs/msg/Path"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["core", "ros"]


def test_seed_is_used_and_written(tmp_path: Path) -> None:
    for seed in ("1", "7"):
        ended = snnav("run", "hello", "--core", "--no-figures", "--seed", seed, "--out", seed, cwd=tmp_path)
        assert ended.returncode == 0
    assert load_scene(tmp_path / "7" / "scene.yaml").seed == 7
    digests = [{row["digest"] for row in rows(tmp_path / seed / "paths.csv")} for seed in ("1", "7")]
    assert digests[0] != digests[1]


def test_default_directory_is_new_under_runs(tmp_path: Path) -> None:
    assert snnav("run", "hello", "--core", "--no-figures", cwd=tmp_path).returncode == 0
    (run,) = (tmp_path / "runs").iterdir()
    assert run.name.startswith("hello-")


def test_a_name_with_slashes_stays_under_runs_and_the_largest_seed_runs_again(tmp_path: Path) -> None:
    text = find_scene("hello").read_text(encoding="utf-8").replace("name: hello", "name: ../up/hello")
    (tmp_path / "up.yaml").write_text(text.replace("time_limit: 60.0", "time_limit: 1.0"), encoding="utf-8")
    largest = ("--seed", str(2**53))
    assert snnav("run", "up.yaml", "--core", "--no-figures", *largest, cwd=tmp_path).returncode == 0
    (run,) = (tmp_path / "runs").iterdir()
    assert run.name.startswith("up_hello-")
    again = snnav("run", str(run / "scene.yaml"), "--core", "--no-figures", "--out", "again", cwd=tmp_path)
    assert again.returncode == 0, again.stderr
    assert (tmp_path / "again" / "paths.csv").read_bytes() == (run / "paths.csv").read_bytes()


def test_run_that_does_not_arrive_is_a_run(tmp_path: Path) -> None:
    text = find_scene("hello").read_text(encoding="utf-8").replace("target: [8.8, 3]", "target: [5, 2.6]")
    (tmp_path / "blocked.yaml").write_text(text, encoding="utf-8")
    ended = snnav("run", "blocked.yaml", "--no-figures", "--out", "out", cwd=tmp_path)
    assert ended.returncode == 0, ended.stderr
    metrics = json.loads((tmp_path / "out" / "metrics.json").read_text(encoding="utf-8"))
    assert not metrics["robots"]["robot_1"]["reached"]
    assert metrics["robots"]["robot_1"]["reason"] == "goal_blocked"
    assert {row["digest"] for row in rows(tmp_path / "out" / "paths.csv")} == {"goal_blocked"}


def test_scenes_are_listed(tmp_path: Path) -> None:
    listed = snnav("scenes", cwd=tmp_path, ros=False)
    assert listed.returncode == 0
    for name in ("hello", "factory", "thesis_ch3_scene1", "thesis_ch3_scene2"):
        assert name in listed.stdout


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["run", "nowhere"], "snnav: nowhere: no scene of this name"),
        (["run", "nowhere.yaml"], "nowhere.yaml: there is no such file"),
        (["run", "bad.yaml"], "bad.yaml:1: "),
        (["run", "taken"], "taken: is a directory"),
        (["run", "hello", "--planners", "2"], "--planners 2: robots of hello: 1; give 1 to 1"),
        (["run", "hello", "--planners", "0"], "--planners 0: robots of hello: 1; give 1 to 1"),
        (["run", "hello", "--core", "--processes"], "--core does not go with --realtime, --processes"),
        (["run", "hello", "--seed", "-3"], "--seed"),
        (["run", "hello", "--out", "taken"], "taken: holds files of something else"),
        (["run", "hello", "--out", "file"], "file: is a file"),
        (["run"], "SCENE"),
        (["fly"], "invalid choice: 'fly'"),
        ([], "COMMAND"),
    ],
)
def test_mistakes_are_one_line_with_status_2_and_leave_nothing(
    tmp_path: Path, arguments: list[str], text: str
) -> None:
    (tmp_path / "bad.yaml").write_text("names: x\n", encoding="utf-8")
    (tmp_path / "file").write_text("", encoding="utf-8")
    (tmp_path / "taken").mkdir()
    (tmp_path / "taken" / "letter.txt").write_text("dear", encoding="utf-8")
    ended = snnav(*arguments, cwd=tmp_path)
    assert ended.returncode == 2
    assert text in ended.stderr
    assert len(ended.stderr.strip().splitlines()) == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bad.yaml", "file", "taken"]
    assert [path.name for path in (tmp_path / "taken").iterdir()] == ["letter.txt"]


def test_without_ros_it_says_what_to_install(tmp_path: Path) -> None:
    ended = snnav("run", "hello", cwd=tmp_path, ros=False)
    assert ended.returncode == 2
    assert "needs ROS 2 (rclpy), which is not found: source a ROS 2 Jazzy installation" in ended.stderr
    assert not list(tmp_path.iterdir())


def test_ctrl_c_ends_a_run_and_leaves_nothing(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "snnav_ros.cli", "run", "factory", "--out", "out"]
    with subprocess.Popen(
        command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    ) as child:  # fmt: skip
        assert child.stdout is not None
        assert "robot_1" in child.stdout.readline()  # the run goes on
        begin = time.monotonic()
        child.send_signal(signal.SIGINT)
        _, said = child.communicate(timeout=20.0)
        assert time.monotonic() - begin < 5.0
    assert child.returncode == 130
    assert said.strip() == "snnav: interrupted"
    assert not list(tmp_path.iterdir())


def test_ctrl_c_is_heard_in_the_background_of_a_script(tmp_path: Path) -> None:
    """A shell without job control starts what ends in `&` with SIGINT ignored."""
    script = f'"{sys.executable}" -m snnav_ros.cli run factory --core --out out & echo $!; wait $!'
    with subprocess.Popen(
        ["sh", "-c", script], cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    ) as shell:  # fmt: skip
        assert shell.stdout is not None
        process = int(shell.stdout.readline())
        assert "robot_1" in shell.stdout.readline()  # the run goes on
        os.kill(process, signal.SIGINT)
        _, said = shell.communicate(timeout=20.0)
    assert shell.returncode == 130
    assert said.strip() == "snnav: interrupted"
    assert not list(tmp_path.iterdir())
