"""What a replay is judged by, against distances worked out by hand and by brute force."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from snnav_core.area.fusion import PlanarSensor
from snnav_core.area.planar import UnoccupiedArea
from snnav_core.sensing.scan import PlanarScan, ScanSettings
from snnav_core.types import Pose2D
from snnav_ros.bag.recorded_scans import RecordedScan, Recording
from snnav_ros.bag.replay_judge import Returns, count_outrun, judge, measured_returns
from snnav_ros.bag.sensors_file import TopicSensor

RADIUS = 0.2


def standing(x: float = 0.0, y: float = 0.0, until: float = 2.0) -> np.ndarray:
    times = np.arange(0.0, until + 1e-9, 0.05)
    rows = np.zeros((len(times), 6))
    rows[:, 0], rows[:, 1], rows[:, 2] = times, x, y
    return rows


def driving(speed: float = 1.0, until: float = 2.0) -> np.ndarray:
    """Along the x axis from the origin."""
    rows = standing(until=until)
    rows[:, 1], rows[:, 4] = speed * rows[:, 0], speed
    return rows


def seen(stamp: float, *points: tuple[float, float], person: bool = True, sensor: str = "a") -> Returns:
    count = len(points)
    there = np.array(points, dtype=np.float64).reshape(-1, 2)
    return Returns(sensor, stamp, there, np.full(count, stamp), np.full(count, person))


def test_a_return_counts_at_the_time_when_it_was_measured() -> None:
    verdict = judge([seen(0.5, (0.5, 0.7), (1.5, 0.0)), seen(1.5, (9.0, 9.0))], driving(), RADIUS)
    assert verdict.nearest is not None
    assert verdict.nearest.distance == pytest.approx(0.7 - RADIUS)
    assert (verdict.nearest.time, verdict.nearest.moving) == (0.5, True)
    assert (verdict.nearest.x, verdict.nearest.y, verdict.nearest.sensor_id) == (0.5, 0.7, "a")
    assert (verdict.met_moving, verdict.met_standing) == (0, 0)


def test_between_scans_the_latest_one_counts() -> None:
    """The robot drives through the place of a return of 0.5 s, where nothing is at 1.6 s any more."""
    verdict = judge([seen(0.5, (1.5, 0.0)), seen(1.6, (9.0, 9.0))], driving(), RADIUS)
    assert verdict.met_moving == 0
    assert verdict.distances.min() == pytest.approx(-RADIUS)
    assert verdict.times[int(verdict.distances.argmin())] == pytest.approx(1.45, abs=0.051)
    assert verdict.distances[verdict.times >= 1.6].min() > 7.0
    assert np.isinf(verdict.distances[verdict.times < 0.5]).all()


def test_who_meets_a_standing_robot_is_told_apart() -> None:
    returns = [seen(1.0, (0.1, 0.0), (0.0, 0.15), (0.31, 0.0))]
    still = judge(returns, standing(), RADIUS)
    assert (still.met_moving, still.met_standing) == (0, 2)
    assert still.nearest is not None
    assert still.nearest.distance == pytest.approx(0.1 - RADIUS)
    assert still.nearest_moving is None
    moving = judge(returns, driving(0.1), RADIUS)
    assert (moving.met_moving, moving.met_standing) == (2, 0)


def test_walls_are_no_people() -> None:
    verdict = judge(
        [seen(1.0, (0.5, 0.0), person=False), seen(1.0, (0.0, 0.9), sensor="b")], standing(), RADIUS
    )
    assert verdict.nearest is not None
    assert verdict.nearest_person is not None
    assert verdict.nearest.distance == pytest.approx(0.3)
    assert verdict.nearest_person.distance == pytest.approx(0.7)
    assert verdict.nearest_person.sensor_id == "b"
    assert verdict.person_distances.min() == pytest.approx(0.7)


def test_what_was_measured_before_or_after_the_run_does_not_count() -> None:
    verdict = judge([seen(-0.1, (0.0, 0.0)), seen(2.1, (0.0, 0.0))], standing(), RADIUS)
    assert verdict.nearest is None
    assert verdict.met_standing == 0


coordinate = st.floats(-3.0, 3.0)


@given(
    points=st.lists(st.tuples(coordinate, coordinate), min_size=1, max_size=8),
    stamp=st.floats(0.0, 1.9),
    speed=st.floats(0.05, 2.0),
)
def test_distances_agree_with_a_fine_sampling_of_the_way(
    points: list[tuple[float, float]], stamp: float, speed: float
) -> None:
    rows = driving(speed)
    verdict = judge([seen(stamp, *points)], rows, RADIUS)
    held = rows[:, 0] >= stamp
    times = np.linspace(rows[held][0, 0], rows[-1, 0], 2000)
    way = np.column_stack((speed * times, np.zeros_like(times)))
    fine = np.hypot(*(way[:, None] - np.array(points)).transpose(2, 0, 1)).min() - RADIUS
    assert fine - 0.003 <= verdict.distances.min() <= fine + 1e-9
    assert verdict.nearest is not None
    there = np.array([speed * stamp, 0.0])
    assert verdict.nearest.distance == pytest.approx(
        np.hypot(*(np.array(points) - there).T).min() - RADIUS, abs=1e-6
    )


def sweep(stamp: float, ranges: np.ndarray, time_increment: float = 0.0) -> RecordedScan:
    return RecordedScan("a", stamp, PlanarScan(stamp, ranges, -0.5, 0.01, 0.1, 10.0), time_increment)


def recording(*scans: RecordedScan) -> Recording:
    return Recording(Path("bag"), 0, scans)


def test_returns_of_a_scan_lie_where_its_beams_ended() -> None:
    ranges = np.full(101, 4.0)
    ranges[[0, 1, 2, 3, 4]] = np.nan, np.inf, 0.0, 0.05, 11.0  # nothing that was measured
    ranges[6] = 8.188
    entry = TopicSensor(PlanarSensor("a", Pose2D(1.0, 2.0, 0.5), ScanSettings(error_codes=(8.188,))), "scan")
    (found,) = measured_returns(recording(sweep(3.0, ranges, 0.001)), [entry])
    beams = np.array([5, *range(7, 101)])
    angles = 0.5 - 0.5 + 0.01 * beams
    expected = np.column_stack((1.0 + 4.0 * np.cos(angles), 2.0 + 4.0 * np.sin(angles)))
    np.testing.assert_allclose(found.points, expected, atol=1e-12)
    np.testing.assert_allclose(found.times, 3.0 + 0.001 * beams)
    assert not found.is_person.any()


def test_a_person_is_what_stands_before_the_usual() -> None:
    """Legs cover several beams; one beam alone is the rim of something, and what is a little nearer is noise."""
    empty = np.full(101, 4.0)
    visited = empty.copy()
    visited[20:26] = 2.0
    visited[50] = 2.0
    visited[70:80] = 3.8
    entry = TopicSensor(PlanarSensor("a", Pose2D(0.0, 0.0, 0.0)), "scan")
    scans = [sweep(0.1 * k, visited if k == 3 else empty) for k in range(9)]
    found = measured_returns(recording(*scans), [entry])
    people = [np.flatnonzero(one.is_person).tolist() for one in found]
    assert people[3] == [20, 21, 22, 23, 24, 25]
    assert not any(people[:3] + people[4:])


def test_people_before_nothing_are_seen_too() -> None:
    nothing = np.full(101, np.inf)
    visited = nothing.copy()
    visited[20:26] = 2.0
    entry = TopicSensor(PlanarSensor("a", Pose2D(0.0, 0.0, 0.0)), "scan")
    found = measured_returns(
        recording(sweep(0.0, nothing), sweep(0.1, visited), sweep(0.2, nothing)), [entry]
    )
    assert [int(one.is_person.sum()) for one in found] == [0, 6, 0]


def test_who_is_faster_than_assumed_is_told() -> None:
    area = UnoccupiedArea(1.0, shapely.MultiPolygon([shapely.box(-2.0, -2.0, 2.0, 2.0)]))
    slow, fast = (-1.6, 0.0), (-1.0, 0.0)  # 0.4 and 1.0 m inside half a second later
    outrun = count_outrun([seen(0.9, fast), seen(1.5, slow, fast, (5.0, 5.0))], [area], 1.0)
    assert outrun.count == 1
    assert outrun.share == pytest.approx(1.0 / 3.0)
    assert outrun.deepest == pytest.approx(0.5, abs=0.01)
    assert count_outrun([seen(1.5, slow, fast)], [area], 2.0).count == 0
    assert math.isclose(count_outrun([], [area], 1.0).share, 0.0)
