"""Bodies in uniform motion."""

from __future__ import annotations

import math

import numpy as np
import pytest

from snnav_core.errors import InvalidInput
from snnav_core.obstacles import MovingObstacle

SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


def test_a_body_moves_by_its_velocity_from_its_stamp_on() -> None:
    body = MovingObstacle("cart", SQUARE, velocity=np.array([0.3, -0.4]), stamp=2.0)
    assert body.speed == pytest.approx(0.5)
    np.testing.assert_allclose(body.outline_at(2.0), SQUARE)
    np.testing.assert_allclose(body.outline_at(4.0), SQUARE + np.array([0.6, -0.8]))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"outline": SQUARE[:, :1]}, "shape"),
        ({"outline": np.full((3, 2), math.nan)}, "NaN"),
        ({"outline": np.zeros((1, 2))}, "single point"),
        ({"velocity": np.zeros(3)}, "velocity has shape"),
        ({"velocity": np.array([math.inf, 0.0])}, "infinity"),
        ({"radius": -0.1}, "radius is -0.1"),
        ({"velocity_deviation": math.nan}, "velocity_deviation is nan"),
    ],
)
def test_wrong_bodies_are_refused_by_name(change: dict[str, object], message: str) -> None:
    arguments: dict[str, object] = {"outline": SQUARE, **change}
    with pytest.raises(InvalidInput, match=rf"'cart'.*{message}"):
        MovingObstacle("cart", **arguments)  # type: ignore[arg-type]
