"""One camera judged by another: right poses leave no hit in free space, wrong ones are found out."""

from __future__ import annotations

import numpy as np
import pytest

from snnav_core.area.doubted import CameraErrors, Outlook
from snnav_core.area.grid import Grid
from snnav_core.sensing.depth import DepthCamera, DepthImage, looking_at, pinhole
from snnav_core.types import FloatArray
from snnav_sim.report.cross_view import MARGINS, CrossView, compare_views, values_at
from support.box_world import image

ROOM = np.array([[0.0, 0.0, 0.0], [4.0, 3.0, 2.4]])
BOXES = np.array([[[2.0, 1.0, 0.0], [2.4, 1.5, 1.2]]])
GRID = Grid.covering(np.array([-0.2, -0.2, -0.2]), np.array([4.2, 3.2, 2.6]), 0.1)
MODEL = pinhole(160, 120, (140.0, 140.0), (79.5, 59.5))


def camera(name: str, position: FloatArray) -> DepthCamera:
    return DepthCamera(name, position, looking_at(position, np.array([3.0, 1.5, 0.9])), MODEL)


ONE, TWO = camera("one", np.array([0.2, 0.3, 1.5])), camera("two", np.array([0.3, 2.7, 1.2]))


def judge(moved: float, images: int = 1) -> CrossView:
    """Judge the first camera by the second one, which is believed to stand elsewhere."""
    pairs = [(image(ONE, BOXES, ROOM), image(TWO, BOXES, ROOM))] * images
    believed = DepthCamera("two", TWO.position - np.array([moved, 0.0, 0.0]), TWO.rotation, MODEL)
    return compare_views(Outlook(ONE, GRID, CameraErrors(0.01, 0.0, 0.1)), believed, pairs, GRID, 0.1)


def test_with_right_poses_no_hit_lies_in_free_space() -> None:
    view = judge(0.0)
    assert view.hits > 10_000
    assert view.carved == view.false_free(0.0) == 0
    assert view.worst == 0.0
    assert view.volumes[0] > 3.0


def test_a_wrong_pose_is_found_out_and_a_margin_above_it_hides_it() -> None:
    view = judge(0.45)
    assert view.share(0.0) > 0.1
    assert view.share(0.1) == view.worst > 0.01
    assert 0.1 < view.depths[-1] <= 0.45
    assert view.false_free(0.45) == 0
    rates = [view.share(margin) for margin in MARGINS]
    assert rates == sorted(rates, reverse=True)
    assert list(view.volumes) == sorted(view.volumes, reverse=True)
    assert view.open_share(0.1) > view.share(0.1)  # fewer hits to judge by


def test_pairs_add_up() -> None:
    once, twice = judge(0.45), judge(0.45, images=2)
    assert (twice.hits, twice.carved, twice.false_free(0.05)) == (
        2 * once.hits,
        2 * once.carved,
        2 * once.false_free(0.05),
    )
    assert twice.worst == once.worst
    assert twice.volumes == pytest.approx(once.volumes)


def test_hits_out_of_view_are_not_counted_and_hidden_ones_are_told_apart() -> None:
    away = DepthCamera("two", TWO.position, looking_at(TWO.position, np.array([-3.0, 2.7, 1.2])), MODEL)
    pairs = [(image(ONE, BOXES, ROOM), image(away, BOXES, ROOM))]
    view = compare_views(Outlook(ONE, GRID, CameraErrors()), away, pairs, GRID, 0.1)
    assert view.hits < 2_000  # the wall behind both
    behind = judge(0.0)
    assert 0 < behind.hits - behind.open_hits < behind.hits  # what stands behind the box for the first camera


def test_without_pairs_there_is_nothing_to_divide_by() -> None:
    view = compare_views(Outlook(ONE, GRID, CameraErrors()), TWO, [], GRID, 0.1)
    assert (view.hits, view.share(0.0), view.summary()["deepest"]) == (0, 0.0, None)


def test_outside_of_the_grid_the_value_is_nothing() -> None:
    field = np.ones(GRID.shape, dtype=np.float32)
    points = np.array([[1.0, 1.0, 1.0], [9.0, 1.0, 1.0], [1.0, -9.0, 1.0]])
    assert values_at(field, GRID, points).tolist() == [1.0, 0.0, 0.0]


def test_an_image_without_readings_shows_nothing() -> None:
    nothing = DepthImage(0.0, np.full((120, 160), np.nan))
    view = compare_views(
        Outlook(ONE, GRID, CameraErrors()), TWO, [(nothing, image(TWO, BOXES, ROOM))], GRID, 0.1
    )
    assert view.hits > 0
    assert (view.carved, view.volumes.max()) == (0, 0.0)
