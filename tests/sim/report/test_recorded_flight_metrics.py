"""How near a recorded flight comes: exact to every hit, and never too far between two rows."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from snnav_core.area.grid import Grid
from snnav_core.area.spatial import SpatialArea
from snnav_sim.report.recorded_flight_metrics import recorded_clearances

GRID = Grid(np.zeros(3), 0.1, (20, 20, 20))
FIELD = np.full(GRID.shape, 0.5, dtype=np.float32)
AREA = SpatialArea(0.0, GRID, FIELD, FIELD.copy())


def rows(places: np.ndarray) -> np.ndarray:
    return np.column_stack((0.05 * np.arange(len(places)), places, np.zeros((len(places), 4))))


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10_000), count=st.integers(1, 60_000))
def test_no_hit_is_nearer_than_told_anywhere_on_the_way(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    places = 1.0 + np.cumsum(rng.uniform(-0.02, 0.02, (12, 3)), axis=0)
    hits = rng.uniform(-1.0, 3.0, (count, 3))
    _, to_hits = recorded_clearances(rows(places), AREA, hits)
    for index in range(len(places) - 1):
        way = places[index] + np.linspace(0.0, 1.0, 7)[:, None] * (places[index + 1] - places[index])
        nearest = np.linalg.norm(way[:, None] - hits[:4_000], axis=2).min()
        assert to_hits[index] <= nearest + 1e-12
    if count <= 4_000:
        last = np.linalg.norm(places[-1] - hits, axis=1).min()
        assert abs(to_hits[-1] - last) < 1e-12
        steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
        starts = np.linalg.norm(places[:-1, None] - hits, axis=2).min(axis=1)
        assert (to_hits[:-1] >= starts - 1.1 * steps).all()  # and not much less than it is


def test_without_hits_nothing_is_near() -> None:
    to_region, to_hits = recorded_clearances(rows(np.full((2, 3), 1.05)), AREA, np.empty((0, 3)))
    assert np.isinf(to_hits).all()
    assert (to_region > 0.4).all()
