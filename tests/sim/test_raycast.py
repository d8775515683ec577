"""The scan kernel against geometry computed by shapely, beam by beam."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from snnav_sim.raycast import cast
from snnav_sim.visibility import ring_segments

ROOM = shapely.box(0.0, 0.0, 20.0, 12.0)
NO_CIRCLES = np.zeros((0, 3))


def by_shapely(
    origin: tuple[float, float], angle: float, solids: list[shapely.Geometry], reach: float = 40.0
) -> float:
    """Return the distance to the first solid along one beam."""
    tip = (origin[0] + reach * math.cos(angle), origin[1] + reach * math.sin(angle))
    beam = shapely.LineString([origin, tip])
    return min(
        shapely.Point(origin).distance(solid.intersection(beam)) if solid.intersects(beam) else math.inf
        for solid in solids
    )


@st.composite
def rooms(draw: st.DrawFn) -> tuple[list[shapely.Polygon], np.ndarray]:
    """Return triangles and disks in the room, all away from the point (10, 6)."""
    triangles = []
    for _ in range(draw(st.integers(0, 5))):
        x, y = draw(st.floats(0.0, 20.0)), draw(st.floats(0.0, 12.0))
        turn = draw(st.floats(0.0, 2.0))
        corners = [(x + 1.5 * math.cos(turn + a), y + 1.5 * math.sin(turn + a)) for a in (0.0, 1.9, 4.0)]
        triangle = shapely.Polygon(corners)
        if triangle.distance(shapely.Point(10.0, 6.0)) > 0.2:
            triangles.append(triangle)
    disks = []
    for _ in range(draw(st.integers(0, 3))):
        disk = (draw(st.floats(0.0, 20.0)), draw(st.floats(0.0, 12.0)), draw(st.floats(0.05, 2.0)))
        if math.dist(disk[:2], (10.0, 6.0)) > disk[2] + 0.2:
            disks.append(disk)
    return triangles, np.array(disks).reshape(-1, 3)


def segments_of(triangles: list[shapely.Polygon]) -> np.ndarray:
    return np.concatenate([ring_segments(ROOM), *(ring_segments(t)[:, [2, 3, 0, 1]] for t in triangles)])


@given(rooms(), st.floats(-4.0, 4.0), st.sampled_from([(181, 1.0), (360, 1.0), (91, 3.9), (7, 20.0)]))
def test_every_beam_agrees_with_shapely(
    room: tuple[list[shapely.Polygon], np.ndarray], heading: float, fan: tuple[int, float]
) -> None:
    triangles, disks = room
    beams, step = fan[0], math.radians(fan[1])
    first = -(beams - 1) * step / 2
    ranges = cast((10.0, 6.0), heading, first, step, beams, segments_of(triangles), disks, 40.0)
    walls = [ROOM.exterior, *(triangle.exterior for triangle in triangles)]
    for beam in range(0, beams, 7):
        angle = heading + first + beam * step
        expected = by_shapely((10.0, 6.0), angle, walls)
        for x, y, radius in disks:
            along, aside = _split(x - 10.0, y - 6.0, angle)
            if along > 0.0 and abs(aside) < radius:
                expected = min(expected, along - math.sqrt(radius**2 - aside**2))
        assert ranges[beam] == pytest.approx(expected, abs=1e-6)


def _split(x: float, y: float, angle: float) -> tuple[float, float]:
    return x * math.cos(angle) + y * math.sin(angle), x * math.sin(angle) - y * math.cos(angle)


@given(st.floats(0.5, 19.5), st.floats(0.5, 11.5), st.floats(-10.0, 10.0))
def test_no_beam_slips_through_a_closed_room(x: float, y: float, heading: float) -> None:
    ranges = cast((x, y), heading, 0.0, math.tau / 720, 720, ring_segments(ROOM), NO_CIRCLES, 100.0)
    assert np.isfinite(ranges).all()
    angles = heading + math.tau / 720 * np.arange(720)
    ends = np.stack((x + ranges * np.cos(angles), y + ranges * np.sin(angles)), axis=-1)
    assert shapely.distance(shapely.points(ends), ROOM.exterior).max() < 1e-9


def test_beams_exactly_through_corners_hit() -> None:
    step = math.radians(45.0)
    ranges = cast(
        (0.0, 0.0), 0.0, 0.0, step, 8, ring_segments(shapely.box(-1.0, -1.0, 1.0, 1.0)), NO_CIRCLES, 10.0
    )
    assert ranges == pytest.approx([1.0, math.sqrt(2.0)] * 4)


def test_range_limit() -> None:
    ranges = cast((1.0, 6.0), 0.0, -math.pi, math.pi / 2, 4, ring_segments(ROOM), NO_CIRCLES, 10.0)
    assert ranges == pytest.approx([1.0, 6.0, math.inf, 6.0])


@pytest.mark.parametrize("origin", [(0.0, 6.0), (0.0, 0.0)])
def test_a_device_on_the_wall_sees_the_room_and_nothing_behind_the_wall(origin: tuple[float, float]) -> None:
    angles = np.radians(np.arange(-179.5, 180.0, 1.0))
    ranges = cast(origin, 0.0, angles[0], math.radians(1.0), 360, ring_segments(ROOM), NO_CIRCLES, 100.0)
    inward = np.cos(angles) > 0.0 if origin[1] > 0.0 else (np.cos(angles) > 0.0) & (np.sin(angles) > 0.0)
    assert (ranges[inward] > 0.0).all()
    assert np.isfinite(ranges[inward]).all()
    assert (ranges[~inward] == 0.0).all()


def test_a_device_inside_a_disk_is_blind() -> None:
    ranges = cast((5.0, 5.0), 0.0, 0.0, 0.1, 30, ring_segments(ROOM), np.array([[5.1, 5.0, 0.3]]), 100.0)
    assert (ranges == 0.0).all()
