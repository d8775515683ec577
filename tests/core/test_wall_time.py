"""Times since 1970, as robots have them in real time, come in steps of a quarter of a microsecond."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from snnav_core.navigator.plans import shortened
from snnav_core.navigator.prediction import up_to
from snnav_core.planning.boundary_index import BoundaryIndex
from snnav_core.planning.certificate import CertificateSettings, certify
from snnav_core.planning.flight_separation import least_gap
from snnav_core.planning.separation import OtherRobot, separation
from snnav_core.types import Certificate, PathSource, PlannedPath, Pose2D, RobotSpec, Stop, TimedPath

TODAY = 1_790_000_000.0
seeds = st.integers(0, 2**32 - 1)
fractions = st.floats(0.0, 1000.0)
steps = st.sampled_from((0.05, 0.06, 0.1, 0.15, 0.25, 0.3))


def later(path: TimedPath, since: float) -> TimedPath:
    return replace(path, start_time=since + path.start_time)


@given(seeds, fractions, steps, st.sampled_from((-0.5, -0.3, 0.0, 0.2)))
def test_robots_are_as_near_to_each_other_at_any_time_of_the_world(
    seed: int, fraction: float, step: float, offset: float
) -> None:
    generator = np.random.default_rng(seed)
    ways = np.cumsum(generator.normal(0.0, 0.7 * step, (2, 40, 2)), axis=1)
    own, other = (
        TimedPath(0.0, step, ways[0]),
        TimedPath(offset, step, ways[1] + generator.normal(0.0, 1.0, 2)),
    )
    (early, near, _), (until, least, _) = (
        separation(
            later(own, since), [OtherRobot("b", 0.3, later(other, since))], since + 30.0 * step, 0.5, 0.5
        )
        for since in (0.0, TODAY + fraction)
    )
    assert least == pytest.approx(near, abs=1e-5)
    if math.isinf(early) != math.isinf(until):
        assert near == pytest.approx(0.5, abs=1e-5), "it may be on the brink only"


@given(seeds, fractions, steps, steps)
def test_so_are_robots_that_fly(seed: int, fraction: float, step: float, its_step: float) -> None:
    ways = np.cumsum(np.random.default_rng(seed).normal(0.0, 0.1, (2, 40, 3)), axis=1)
    one, other, since = TimedPath(0.0, step, ways[0]), TimedPath(-0.1, its_step, ways[1]), TODAY + fraction
    near, _ = least_gap(one, other, 0.0, 2.0)
    assert least_gap(later(one, since), later(other, since), since, since + 2.0)[0] == pytest.approx(
        near, abs=1e-5
    )


@given(fractions, st.integers(1, 12), st.integers(1, 10), st.sampled_from((0.1, 0.15, 0.2, 0.3, 0.5, 0.7)))
def test_a_window_is_driven_to_its_last_point(
    fraction: float, parts: int, window: int, interval: float
) -> None:
    path = TimedPath(TODAY + fraction, interval / parts, np.zeros((200, 2)))
    assert len(up_to(path, path.start_time + window * interval)) == parts * window + 1


@pytest.mark.parametrize("interval", [0.1, 0.2, 0.3, 0.5, 0.8])
@pytest.mark.parametrize("window", [1, 3, 4, 7])
def test_a_path_is_certified_for_all_of_its_window(interval: float, window: int) -> None:
    step = interval / 4
    points = np.column_stack((step * np.arange(150), np.zeros(150)))
    settings = CertificateSettings(0.5, 0.1, interval, window)
    boundary = BoundaryIndex(shapely.box(-5.0, -3.0, 60.0, 3.0))
    robot, start = RobotSpec("a", 0.2, 1.0, 2.0), TODAY + 0.37
    verdict = certify(
        TimedPath(start, step, points), robot, Pose2D(0.0, 0.0, 0.0), boundary, start, [], settings
    )
    assert verdict.valid_until == pytest.approx(start + window * interval, abs=1e-6)


def test_a_window_that_fails_becomes_shorter_each_time() -> None:
    """What fails a hair before its end fails again when it is as long as before: all would be asked for ever."""
    path = TimedPath(0.0, 0.1, np.zeros((50, 2)))
    verdict = Certificate("a", True, 1.5, 1.0, 1.0, 1.0, 0.0, path.digest())
    plan = PlannedPath("a", path, verdict, PathSource.WARM_START, 0.5)
    shorter = shortened(plan, 1.5 - 1e-7, 0.5, "too near")
    assert isinstance(shorter, PlannedPath)
    assert shorter.certificate.valid_until == 1.0
    assert isinstance(shortened(shorter, 0.5 - 1e-7, 0.5, "too near"), PlannedPath)
    assert isinstance(shortened(shorter, 0.3, 0.5, "too near"), Stop)
