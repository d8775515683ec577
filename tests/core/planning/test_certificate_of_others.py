"""The certificate keeps the margin from other robots in time."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from support.certificates import START, check, dense, other, random_path, refused, seeds, straight


def test_a_robot_that_crosses_between_two_samples_is_seen() -> None:
    fast = np.column_stack((np.full(9, 1.25), 3.0 * np.arange(9) - 7.5))
    at_samples = np.linalg.norm(straight(8) - fast, axis=1).min()
    assert at_samples > 1.3, "far enough at every sample"
    certificate = check(straight(), others=[other(fast)])
    assert refused(certificate, "of robot robot_2 after 1.00 s, margin 1.020 m"), (
        "both may be off their paths"
    )
    assert certificate.least_separation == pytest.approx(-0.3, abs=0.05)
    assert check(straight(), others=[other(fast, start=START - 2.0)]).accepted, "it has passed before"


def test_a_standing_robot_is_kept_clear_of_also_beside_a_link() -> None:
    for y, accepted in ((1.321, True), (1.319, False)):
        assert check(straight(), others=[other([[1.25, y]])]).accepted == accepted
    later = check(straight(), others=[other([[3.25, 1.2]])], least_window=1)
    assert later.accepted
    assert later.valid_until == START + 2.0
    assert later.least_separation == pytest.approx(0.9)


def test_another_robot_stays_at_the_end_of_its_path() -> None:
    arriving = other([[3.25, 6.0], [3.25, 4.0], [3.25, 0.5]])
    assert refused(check(straight(), others=[arriving]), "of robot robot_2")


def test_robots_that_stand_too_near_may_only_part() -> None:
    behind, ahead = other([[-0.9, 0.0]]), other([[0.9, 0.0]])
    assert check(straight(), others=[behind]).accepted
    assert refused(check(straight(), others=[ahead], least_window=1), "margin 0.600 m")


@given(seeds, st.integers(2, 16))
def test_the_separation_is_that_of_dense_sampling(seed: int, links: int) -> None:
    generator = np.random.default_rng(seed)
    points = random_path(generator, 12)
    way = generator.normal((2.0, 0.0), 2.0) + np.cumsum(generator.normal(0.0, 0.5, (links, 2)), axis=0)
    robot = other(
        way, step=float(generator.uniform(0.1, 1.0)), start=START - float(generator.uniform(0.0, 2.0))
    )
    certificate = check(points, others=[robot], least_window=1)
    times, positions = dense(points, 4.0)
    distance = np.linalg.norm(positions - robot.path.positions_at(START + times), axis=1) - 0.3
    assert certificate.least_separation <= distance.min() + 1e-9
    assert certificate.least_separation >= distance.min() - 0.02
    margin = min(1.0, distance[0])
    if certificate.accepted:
        assert (distance[times <= certificate.valid_until - START + 1e-9] >= margin - 1e-6).all()
    # Up to the next decision, 1 s, the other robot may also stop anywhere on its way.
    soon = times <= 1.0 + 1e-9
    anywhere = positions[soon][:, None] - robot.path.positions_at(START + times[soon])[None]
    if distance.min() > 1.02 and np.linalg.norm(anywhere, axis=2).min() - 0.3 > 1.02:
        assert not certificate.reason.startswith("comes within")
