"""The distance of two robots on their paths is exact in time."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from snnav_core.planning.flight_separation import least_gap
from snnav_core.types import TimedPath


@given(st.integers(0, 100_000), st.integers(1, 12), st.integers(1, 12))
def test_the_least_gap_is_that_of_fine_samples(seed: int, count: int, others: int) -> None:
    rng = np.random.default_rng(seed)
    one = TimedPath(rng.uniform(-1.0, 1.0), rng.uniform(0.05, 0.4), rng.uniform(-1.0, 1.0, (count, 3)))
    other = TimedPath(rng.uniform(-1.0, 1.0), rng.uniform(0.05, 0.4), rng.uniform(-1.0, 1.0, (others, 3)))
    begin = rng.uniform(-2.0, 2.0)
    end = begin + rng.uniform(0.0, 3.0)
    gap, time = least_gap(one, other, begin, end)
    assert begin <= time <= end
    at_time = np.array([time])
    np.testing.assert_allclose(
        np.linalg.norm(one.positions_at(at_time) - other.positions_at(at_time)), gap, atol=1e-9
    )
    times = np.linspace(begin, end, 3000)
    sampled = np.linalg.norm(one.positions_at(times) - other.positions_at(times), axis=1)
    fastest = 2.0 * np.sqrt(12.0) / 0.05
    assert sampled.min() - fastest * (end - begin) / 3000 <= gap <= sampled.min() + 1e-9
