"""What a recording says of a robot's motions and windows: each is found, none is invented, whatever the clocks do."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from snnav_core.errors import InvalidInput, SnnavError
from snnav_core.types import Certificate, PathSource, PlannedPath, Pose2D, Stop, StopReason, TimedPath
from snnav_ros.bag.commands import add_parser
from snnav_ros.bag.drives import EVENTS_TOPIC, Drive, read_drive
from snnav_ros.bag.errors import BagError
from snnav_ros.bag.messages import jazzy_types, time_message
from snnav_ros.bag.writer import BagWriter
from snnav_ros.convert import (
    nanoseconds,
    odometry_to_message,
    path_to_message,
    stop_to_path,
    verdict_to_message,
)

START = 1_700_000_000.0  # log time of the first message [s]: of a clock on the wall
ROBOT = "cart"
COMMITTED = Path(__file__).parents[3] / "bags" / "thesis_ch3_scene1" / "bag"


class Recorder:
    """Writes messages one by one, each a hundredth of a second after the other unless told otherwise."""

    def __init__(self, bag: BagWriter) -> None:
        self._bag, self.log = bag, 0.0

    def write(self, topic: str, message: object, after: float = 0.01) -> None:
        self.log += after
        self._bag.write(topic, message, nanoseconds(START) + nanoseconds(self.log))

    def clock(self, now: float, after: float = 0.01) -> None:
        kind = jazzy_types().types["rosgraph_msgs/msg/Clock"]
        self.write("/clock", kind(clock=time_message(nanoseconds(now))), after)

    def pose(
        self,
        now: float,
        x: float,
        y: float = 0.0,
        heading: float = 0.0,
        after: float = 0.01,
        z: float = 0.0,
    ) -> None:
        message = odometry_to_message(ROBOT, Pose2D(x, y, heading), 0.0, 0.0, nanoseconds(now))
        message.pose.pose.position.z = z
        self.write(f"{ROBOT}/odom", message, after)

    def window(self, stamp: float, end: float, accepted: bool = True) -> None:
        path = TimedPath(stamp, 0.5, np.array([[0.0, 0.0], [1.0, 0.0]]))
        reason = "" if accepted else "too near"
        held = Certificate(ROBOT, accepted, end, 1.0, 1.0, 1.0, stamp, path.digest(), reason)
        plan = PlannedPath(ROBOT, path, held, PathSource.WARM_START, 1.0)
        message = verdict_to_message(plan, nanoseconds(stamp), path_to_message(path))
        self.write(f"{ROBOT}/certificate", message)

    def stop(self, stamp: float) -> None:
        at = nanoseconds(stamp)
        stop = Stop(ROBOT, StopReason.NO_PATH, "none")
        self.write(f"{ROBOT}/certificate", verdict_to_message(stop, at, stop_to_path(at)))

    def say(self, text: str) -> None:
        self.write(EVENTS_TOPIC, jazzy_types().types["std_msgs/msg/String"](data=text))


def recorded(folder: Path, tell: Callable[[Recorder], None]) -> Path:
    with BagWriter(folder / "run") as bag:
        tell(Recorder(bag))
    return folder / "run"


def read(folder: Path, tell: Callable[[Recorder], None]) -> Drive:
    return read_drive(recorded(folder, tell), ROBOT)


def straight(recorder: Recorder, times: Sequence[float], speed: float = 1.0) -> None:
    for now in times:
        recorder.clock(now)
        recorder.pose(now, speed * now)


def test_a_motion_outlasts_its_window_by_just_what_it_does(tmp_path: Path) -> None:
    def tell(recorder: Recorder) -> None:
        recorder.clock(0.0)
        recorder.window(0.0, 0.3)
        straight(recorder, [0.0, 0.1, 0.2, 0.3, 0.4, 0.5])

    motions = read(tmp_path, tell).motions()
    np.testing.assert_allclose(motions.end - motions.begin, 0.1)
    np.testing.assert_allclose(motions.after[:, 0], motions.end)
    np.testing.assert_allclose(motions.outside(), [0.1, 0.2])


def test_a_robot_that_climbs_moves(tmp_path: Path) -> None:
    def tell(recorder: Recorder) -> None:
        recorder.clock(0.0)
        recorder.window(0.0, 0.25)
        for k in range(5):
            recorder.pose(0.1 * k, 1.0, z=0.07 * k, after=0.1)

    drive = read_drive(recorded(tmp_path, tell), ROBOT)
    motions = drive.motions()
    np.testing.assert_allclose(motions.after[:, 2], 0.07 * np.arange(1, 5))
    np.testing.assert_allclose(motions.outside(), [0.05, 0.15])
    assert drive.distance(0.0, float(drive.poses[-1, 0])) == pytest.approx(0.28)


def test_a_window_that_was_heard_too_late_does_not_excuse_what_was_before(tmp_path: Path) -> None:
    def tell(recorder: Recorder) -> None:
        recorder.clock(0.0)
        recorder.window(0.0, 0.1)
        straight(recorder, [0.0, 0.1, 0.2])
        recorder.window(0.1, 1.0)  # decided in time, heard after the robot had moved on
        straight(recorder, [0.3])

    np.testing.assert_allclose(read(tmp_path, tell).motions().outside(), [0.1])


def test_refused_paths_and_stops_allow_nothing(tmp_path: Path) -> None:
    def tell(recorder: Recorder) -> None:
        recorder.clock(0.0)
        recorder.window(0.0, 5.0, accepted=False)
        recorder.stop(0.0)
        straight(recorder, [0.0, 0.1])

    assert read(tmp_path, tell).motions().outside().tolist() == [math.inf]


def test_a_window_of_the_time_before_the_clock_was_set_back_holds_no_more(tmp_path: Path) -> None:
    def tell(recorder: Recorder) -> None:
        recorder.clock(10.0)
        recorder.window(10.0, 12.0)
        recorder.pose(10.0, 0.0)
        recorder.clock(10.1)
        recorder.pose(10.1, 0.1)
        recorder.say("clock set back")
        recorder.clock(0.0)
        recorder.window(10.1, 12.1)  # was still under way
        recorder.pose(0.0, 0.1)
        recorder.clock(0.1)
        recorder.pose(0.1, 0.2)
        recorder.window(0.1, 2.0)
        recorder.clock(0.2)
        recorder.pose(0.2, 0.3)

    drive = read(tmp_path, tell)
    assert len(drive.jumps) == 1
    assert [event.text for event in drive.events] == ["clock set back"]
    assert drive.events[0].now == 10.1
    assert drive.events[0].log < drive.jumps[0]
    motions = drive.motions()
    assert motions.end.tolist() == [10.1, 0.1, 0.2]
    assert motions.allowed_until.tolist() == [12.0, -math.inf, 2.0]
    np.testing.assert_allclose(drive.restarts(), [0.0])


def test_the_jump_shows_in_the_poses_even_if_they_were_heard_before_the_clock(tmp_path: Path) -> None:
    def tell(recorder: Recorder) -> None:
        recorder.clock(10.0)
        recorder.window(10.0, 12.0)
        recorder.pose(10.0, 0.0)
        recorder.pose(0.0, 3.0)  # set down elsewhere
        recorder.clock(0.0)
        recorder.pose(0.1, 3.0)

    drive = read(tmp_path, tell)
    assert len(drive.motions().log) == 0
    np.testing.assert_allclose(drive.restarts(), [3.0])
    assert drive.distance(0.0, 1.0) == 0.0


def test_a_turn_on_the_spot_is_a_motion(tmp_path: Path) -> None:
    def tell(recorder: Recorder) -> None:
        recorder.clock(0.0)
        recorder.stop(0.0)
        recorder.pose(0.0, 1.0, heading=3.1)
        recorder.pose(0.1, 1.0, heading=-3.1, after=0.1)

    drive = read(tmp_path, tell)
    assert len(drive.motions().outside()) == 1
    assert drive.distance(0.0, 1.0) == 0.0
    speeds, turns, _ = drive.over_time(np.array([0.0, 1.0]))
    assert speeds[0] == 0.0
    assert turns[0] == pytest.approx(2.0 * math.pi - 6.2), "the short way round"


def test_what_is_left_of_a_window_stands_still_with_the_clock(tmp_path: Path) -> None:
    def tell(recorder: Recorder) -> None:
        recorder.clock(0.0)
        recorder.window(0.0, 1.5)
        recorder.pose(0.0, 0.0)
        recorder.clock(0.5, after=0.5)
        recorder.pose(0.5, 0.4)
        recorder.clock(0.55, after=2.0)  # the clock had fallen asleep
        recorder.pose(0.55, 0.44, after=0.0)

    drive = read(tmp_path, tell)
    (silence,) = drive.silences(longest=1.0)
    assert silence[1] - silence[0] == pytest.approx(2.01)
    middle = np.linspace(silence[0] + 0.1, silence[1] - 0.1, 20)
    speeds, _, left = drive.over_time(middle)
    np.testing.assert_allclose(left, 1.0)
    np.testing.assert_allclose(
        speeds, 0.0, err_msg="what was driven in 0.05 s was driven right before it was said"
    )
    assert drive.distance(0.0, silence[1] + 1.0) == pytest.approx(0.44)


def test_without_a_clock_the_time_of_recording_is_that_of_the_stamps(tmp_path: Path) -> None:
    def tell(recorder: Recorder) -> None:
        recorder.window(START, START + 0.25)
        for k in range(4):
            recorder.pose(START + 0.1 * k, 0.1 * k, after=0.1)

    drive = read(tmp_path, tell)
    np.testing.assert_allclose(drive.motions().outside(), [0.05], atol=1e-6)
    assert drive.now(np.array([0.1]))[0] == pytest.approx(START + 0.11, abs=0.011)


@given(
    ends=st.lists(st.floats(0.05, 3.0), min_size=1, max_size=5),
    speeds=st.lists(st.floats(0.0, 2.0), min_size=2, max_size=30),
)
def test_exactly_the_motions_beyond_all_windows_are_outside(
    tmp_path_factory: pytest.TempPathFactory, ends: list[float], speeds: list[float]
) -> None:
    def tell(recorder: Recorder) -> None:
        recorder.clock(0.0)
        for end in ends:
            recorder.window(0.0, end)
        x = 0.0
        recorder.pose(0.0, x)
        for k, speed in enumerate(speeds, start=1):
            x += 0.1 * speed
            recorder.pose(0.1 * k, x, after=0.1)

    drive = read(tmp_path_factory.mktemp("bag"), tell)
    moved = [0.1 * k for k in range(1, len(speeds) + 1) if _moves(speeds, k)]
    assert len(drive.motions().log) == len(moved)
    late = [now - max(ends) for now in moved if now > max(ends) + 1e-6]
    np.testing.assert_allclose(drive.motions().outside(), late, atol=1e-6)
    whole = float(drive.poses[-1, 0])
    assert drive.distance(0.0, whole) == pytest.approx(0.1 * sum(speeds))
    times = np.linspace(0.0, whole, 17)
    assert float(np.sum(drive.over_time(times)[0] * np.diff(times))) == pytest.approx(0.1 * sum(speeds))


def _moves(speeds: list[float], k: int) -> bool:
    """Whether x changes with the k-th speed, which may be too small for a float."""
    x = 0.0
    for speed in speeds[: k - 1]:
        x += 0.1 * speed
    return x + 0.1 * speeds[k - 1] != x


def test_what_is_missing_is_named(tmp_path: Path) -> None:
    path = recorded(tmp_path, lambda recorder: straight(recorder, [0.0, 0.1]))
    with pytest.raises(BagError, match="no topic '/cart/certificate'; the bag has"):
        read_drive(path, ROBOT)
    with pytest.raises(BagError, match="no topic '/other/odom'"):
        read_drive(path, "other")


def test_a_message_that_makes_no_sense_is_named(tmp_path: Path) -> None:
    def tell(recorder: Recorder) -> None:
        recorder.window(0.0, 1.0)
        recorder.pose(0.0, math.nan)

    with pytest.raises(InvalidInput, match=r"/cart/odom: position \(nan"):
        read(tmp_path, tell)


# the command


def run(*arguments: object) -> int:
    parser = argparse.ArgumentParser(prog="snnav")
    add_parser(parser.add_subparsers(required=True))
    parsed = parser.parse_args(["windows", *map(str, arguments)])
    return parsed.func(parsed)


def test_the_committed_run_stayed_inside_its_windows(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    figure = tmp_path / "new" / "speed.png"
    assert run(COMMITTED, "--robot", "robot_1", "--out", figure) == 0
    told = capsys.readouterr().out
    assert "robot_1 drove" in told
    assert "always inside a certified window" in told
    assert figure.read_bytes().startswith(b"\x89PNG")


def test_a_robot_that_drove_on_is_told_and_fails(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def tell(recorder: Recorder) -> None:
        recorder.clock(0.0)
        recorder.window(0.0, 0.25)
        straight(recorder, [0.0, 0.1, 0.2, 0.3, 0.4])

    path = recorded(tmp_path, tell)
    assert run(path, "--robot", ROBOT) == 1
    told = capsys.readouterr().out
    assert "2 of 4 motions outside its certified windows" in told
    assert "by up to 0.15 s" in told
    assert run(path, "--robot", ROBOT, "--duration", 0.07) == 0, "up to then all was well"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--robot", "robot_1", "--start", "900"], "give a smaller --start"),
        (["--robot", "robot_1", "--out", "figure.txt"], r"only \.png"),
        (["--robot", "nobody"], "no topic '/nobody/odom'"),
    ],
)
def test_mistakes_are_told_in_one_line(arguments: list[str], words: str) -> None:
    with pytest.raises(SnnavError, match=words) as caught:
        run(COMMITTED, *arguments)
    assert "\n" not in str(caught.value)
