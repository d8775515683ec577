"""CARMEN logs: geometry, no-return values, clocks and bad lines."""

from __future__ import annotations

import gzip
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from snnav_core.types import Pose2D
from snnav_ros.bag.carmen import NOMINAL_PERIOD, read_carmen
from snnav_ros.bag.carmen_import import write_carmen_bag
from snnav_ros.bag.errors import LogError
from snnav_ros.bag.messages import pose_of
from snnav_ros.bag.no_return import find_no_return
from snnav_ros.bag.reader import BagReader

LOGS = Path(__file__).parents[3].parent / "shared" / "data" / "carmen_corrected"


def flaser(ranges, pose=(1.0, 2.0, 0.5), stamp="10.0") -> str:
    x, y, theta = pose
    readings = " ".join(f"{r:g}" for r in ranges)
    return f"FLASER {len(ranges)} {readings} {x} {y} {theta} {x} {y} {theta} {stamp} host {stamp}\n"


def robotlaser(
    ranges, start=-0.75, step=0.5, reach=50.0, remissions=(), pose="3 4 0.25", stamp="10.0"
) -> str:
    readings = " ".join(f"{r:g}" for r in ranges)
    rest = " ".join(f"{r:g}" for r in remissions)
    view = step * (len(ranges) - 1)
    return (
        f"ROBOTLASER1 0 -0.75 {view} {step} 50.0 0.01 0 {len(ranges)} {readings} {len(remissions)} {rest} "
        f"3 4 0.25 9 9 9 0 0 0 0 0 10.0 host 10.0\n"
    )


def write_log(path: Path, *lines: str) -> Path:
    path.write_text("# message formats defined: PARAM\nPARAM robot_use_laser on nohost 0\n" + "".join(lines))
    return path


@pytest.mark.parametrize(("beams", "step"), [(180, 1.0), (181, 1.0), (360, 0.5), (361, 0.5)])
def test_flaser_geometry(tmp_path: Path, beams: int, step: float) -> None:
    log = read_carmen(
        write_log(tmp_path / "a.log", flaser(np.linspace(1, 9, beams), (1.5, -2.0, 0.7), "12.25"))
    )
    (scan,) = log.scans
    assert (scan.pose, scan.stamp, scan.line) == (Pose2D(1.5, -2.0, 0.7), 12.25, 3)
    assert math.degrees(scan.angle_min) == pytest.approx(-90.0)
    assert math.degrees(scan.angle_increment) == pytest.approx(step)
    np.testing.assert_allclose(scan.ranges, np.linspace(1, 9, beams), rtol=1e-5)


def test_robotlaser_says_its_geometry_itself(tmp_path: Path) -> None:
    line = robotlaser([1, 2, 50.0, 4], remissions=(7, 8, 9))
    log = read_carmen(write_log(tmp_path / "a.log", line))
    (scan,) = log.scans
    assert log.kind == "ROBOTLASER1"
    assert (scan.angle_min, scan.angle_increment, scan.range_max) == (-0.75, 0.5, 50.0)
    assert (scan.pose, scan.stamp) == (Pose2D(3.0, 4.0, 0.25), 10.0)
    write_carmen_bag(log, tmp_path / "bag")
    with BagReader(tmp_path / "bag") as bag:
        (message,) = bag.messages(["scan"])
    assert list(message.message.ranges) == [1.0, 2.0, math.inf, 4.0]


def test_gzip_is_told_by_content_and_a_cut_file_keeps_its_scans(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    text = "".join(flaser(rng.uniform(1, 9, 180), stamp=str(k + 1)) for k in range(20))
    content = gzip.compress(text.encode())
    (tmp_path / "odd.log").write_bytes(content)
    assert len(read_carmen(tmp_path / "odd.log").scans) == 20
    (tmp_path / "cut.log.gz").write_bytes(content[: len(content) // 2])
    log = read_carmen(tmp_path / "cut.log.gz")
    assert 5 <= len(log.scans) < 20
    assert any("the compressed file is damaged after line" in warning for warning in log.warnings)


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("FLASER 180 1 2 3\n", "5 fields, expected 191 for 180 readings"),
        ("FLASER\n", "no count of readings"),
        ("FLASER many 1 2\n", "no count of readings"),
        (flaser([1.0] * 90), "90 readings, expected one of 180, 181, 360, 361"),
        (flaser([1.0] * 179 + [float("nan")]), "range has 'nan', expected a finite number"),
        (flaser([1.0] * 179 + [-1.0]), "range is -1 m, must not be negative"),
        (flaser([1.0] * 180, pose=("x", 0, 0)), "pose has 'x', expected a number"),
        (flaser([1.0] * 180, pose=("nan", 0, 0)), "pose has 'nan'"),
        (flaser([1.0] * 180, stamp="inf"), "time stamp has 'inf'"),
        (robotlaser([1.0, 2.0], step=0.0), "do not fit the field of view"),
        ("ROBOTLASER1 0 -1 2 1 50 0.01 0 99 1 2 3\n", "no count of readings"),
    ],
)
def test_bad_lines_are_counted_and_the_first_is_named(tmp_path: Path, line: str, reason: str) -> None:
    good = flaser([2.0] * 180)
    log = read_carmen(write_log(tmp_path / "a.log", line, good, line))
    assert (len(log.scans), log.bad_lines) == (1, 2)
    (warning,) = log.warnings
    assert "2 bad lines left out, the first is line 3" in warning
    assert reason in warning
    with pytest.raises(LogError, match="no usable scan, all 1 are bad; the first is line 3"):
        read_carmen(write_log(tmp_path / "b.log", line))


def test_logs_without_scans_and_unreadable_ones(tmp_path: Path) -> None:
    with pytest.raises(LogError, match=r"no usable scan; give a CARMEN log with FLASER"):
        read_carmen(write_log(tmp_path / "a.log"))
    with pytest.raises(LogError, match="No such file"):
        read_carmen(tmp_path / "missing.log")
    with pytest.raises(LogError, match="Is a directory"):
        read_carmen(tmp_path)
    (tmp_path / "noise.log.gz").write_bytes(b"\x1f\x8b" + bytes(range(256)))
    with pytest.raises(LogError, match="no usable scan"):
        read_carmen(tmp_path / "noise.log.gz")
    (tmp_path / "binary.log").write_bytes(bytes(range(256)) * 40)
    with pytest.raises(LogError, match="no usable scan"):
        read_carmen(tmp_path / "binary.log")


@given(
    st.lists(st.sampled_from([0.0, 1.0, 1.5, 3.0, 1e9, -4.0]) | st.floats(-1e3, 1e10), min_size=1, max_size=8)
)
@settings(max_examples=60, deadline=None)
def test_stamps_always_increase_and_are_kept_when_they_do(tmp_path_factory, stamps: list[float]) -> None:
    path = tmp_path_factory.mktemp("log") / "a.log"
    log = read_carmen(write_log(path, *(flaser([1.0] * 180, stamp=repr(stamp)) for stamp in stamps)))
    times = np.array([scan.stamp for scan in log.scans])
    assert (np.diff(times) > 0.0).all()
    assert (times >= 0.0).all()
    if (np.diff(stamps) >= 1e-9).all() and stamps[0] >= 0.0:
        np.testing.assert_array_equal(times, stamps)
        assert log.warnings == ()
    else:
        np.testing.assert_allclose(np.diff(times), NOMINAL_PERIOD)
        assert len(log.warnings) == 1


@pytest.mark.parametrize("code", [81.83, 81.91, 51.15, 50.0, 32.76, 8.191, 16.383, 32.767])
@given(share=st.floats(0.002, 0.1), seed=st.integers(0, 2**31))
@settings(max_examples=15, deadline=None)
def test_the_no_return_value_is_found(code: float, share: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    readings = (0.9 * code * rng.random(20_000) ** 3).round(2)
    lost = rng.random(readings.size) < share
    readings[lost] = code
    found = find_no_return(readings)
    assert found.value == code
    assert code - 0.21 <= found.threshold < code or found.threshold == 80.0
    assert found.share == pytest.approx(lost.mean())


def test_several_codes_lie_in_one_cluster_and_an_outlier_does_not_hide_them() -> None:
    rng = np.random.default_rng(1)
    readings = np.concatenate(
        [rng.uniform(0, 46, 5000).round(2), [51.15] * 300, [51.1] * 90, [51.16] * 60, [300.0]]
    )
    found = find_no_return(readings)
    assert (found.value, found.threshold) == (51.15, pytest.approx(50.95))
    assert found.share == pytest.approx(451 / readings.size)


def test_a_wall_seen_often_is_no_code() -> None:
    readings = np.concatenate([np.linspace(1, 12, 1000).round(2), [11.8] * 500])
    found = find_no_return(readings)
    assert (found.value, found.threshold, found.share) == (math.inf, 80.0, 0.0)
    assert "no value stands for no return" in str(found)
    assert find_no_return(np.zeros(0)).value == math.inf


def test_import_keeps_geometry_and_marks_no_returns(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    scans = [rng.uniform(1, 40, 361).round(2) for _ in range(6)]
    for ranges in scans:
        ranges[40:60] = 81.91
    poses = [(k, -k, 3.0 * k) for k in range(6)]
    lines = [flaser(r, p, str(100 + k)) for k, (r, p) in enumerate(zip(scans, poses, strict=True))]
    log = read_carmen(write_log(tmp_path / "a.log", *lines))
    summary = write_carmen_bag(log, tmp_path / "bag")
    assert (summary.scans, summary.beams, summary.duration, summary.extent) == (6, (361,), 5.0, (5.0, 5.0))
    assert summary.path_length == pytest.approx(5 * math.sqrt(2))
    with BagReader(tmp_path / "bag") as bag:
        messages = list(bag.messages(["scan"]))
        placed = list(bag.messages(["pose"]))
    for k, (message, pose) in enumerate(zip(messages, placed, strict=True)):
        assert message.stamp_ns == pose.stamp_ns == (100 + k) * 10**9
        assert message.message.header == type(message.message.header)(
            stamp=pose.message.header.stamp, frame_id="laser"
        )
        assert pose.message.header.frame_id == "map"
        np.testing.assert_array_equal(np.isinf(message.message.ranges), scans[k] == 81.91)
        finite = np.isfinite(message.message.ranges)
        np.testing.assert_allclose(message.message.ranges[finite], scans[k][finite], rtol=1e-6)
        assert scans[k][finite].max() < message.message.range_max < 81.91
        read = pose_of(pose.message.pose)
        assert (read.x, read.y) == (k, -k)
        assert math.remainder(read.heading - 3.0 * k, 2 * math.pi) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.skipif(not LOGS.is_dir(), reason="recordings of shared/data are not there")
@pytest.mark.parametrize(
    ("name", "scans", "beams", "value", "share", "warnings"),
    [
        ("intel", 910, 180, 81.83, 0.025, ["4 of 909 time stamps do not increase"]),
        ("csail", 406, 361, 81.91, 0.027, ["404 of 405 time stamps do not increase"]),
        ("seattle", 241, 361, 81.87, 0.008, []),
        ("aces", 440, 180, 50.0, 0.008, []),
        ("edmonton", 340, 180, 51.15, 0.055, []),
        ("freiburg-079", 4791, 360, 81.91, 0.021, []),
    ],
)
def test_real_logs(
    name: str, scans: int, beams: int, value: float, share: float, warnings: list[str]
) -> None:
    log = read_carmen(LOGS / f"{name}-corrected.log.gz")
    assert (len(log.scans), log.bad_lines, log.no_return.value) == (scans, 0, value)
    assert {len(scan.ranges) for scan in log.scans} == {beams}
    assert log.no_return.share == pytest.approx(share, abs=5e-4)
    assert len(log.warnings) == len(warnings)
    assert all(expected in warning for expected, warning in zip(warnings, log.warnings, strict=True))
