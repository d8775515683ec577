"""Set operations give the same as those of shapely, and give something where those give up."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import shapely
from shapely.errors import GEOSException

from snnav_core.area import overlay

KNOT = shapely.Polygon([(0.0, 0.0), (2.0, 2.0), (2.0, 0.0), (0.0, 2.0)])  # crosses itself
BOX = shapely.box(0.5, -0.5, 1.5, 1.5)
PAIRS = [
    (overlay.union, shapely.union),
    (overlay.difference, shapely.difference),
    (overlay.intersection, shapely.intersection),
]


@pytest.mark.parametrize(("ours", "plain"), PAIRS)
def test_what_shapely_can_do_is_left_to_it(ours: Callable[..., Any], plain: Callable[..., Any]) -> None:
    disk = shapely.Point(0.3, 0.2).buffer(0.8)
    assert shapely.equals_exact(ours(BOX, disk), plain(BOX, disk))
    assert shapely.equals_exact(overlay.union_all([BOX, disk]), shapely.union_all([BOX, disk]))


@pytest.mark.parametrize(("ours", "plain"), PAIRS)
def test_where_shapely_gives_up_the_result_is_that_of_the_valid_outline(
    ours: Callable[..., Any], plain: Callable[..., Any]
) -> None:
    with pytest.raises(GEOSException):
        plain(KNOT, BOX)
    expected = plain(shapely.make_valid(KNOT), BOX)
    result = ours(KNOT, BOX)
    assert result.is_valid
    assert shapely.symmetric_difference(result, expected).area < 1e-6


def test_many_outlines_that_almost_coincide_are_united() -> None:
    draws = np.random.default_rng(1)
    knots = [
        shapely.transform(KNOT, lambda points, shift=shift: points + shift) for shift in draws.random(40)
    ]
    united = overlay.union_all(knots)
    assert united.is_valid
    for knot in knots:
        assert shapely.difference(shapely.make_valid(knot), united.buffer(1e-5)).area < 1e-9
