"""Places to wait: off the claims of others, within reach, and with a way on afterwards."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from snnav_core.area.planar import UnoccupiedArea, as_multipolygon
from snnav_core.navigator.context import AreaContext
from snnav_core.navigator.places import Claim, PlaceSearch
from snnav_core.navigator.settings import NavigatorSettings, RobotDistances
from snnav_core.types import RobotSpec

SETTINGS = NavigatorSettings(0.5, 0.4, 4)
DISTANCES = RobotDistances(RobotSpec("a", 0.2, 0.8, 1.6), SETTINGS)


def search(
    region: shapely.Geometry, start: tuple[float, float], goal: tuple[float, float], grain: float = 0.0
) -> PlaceSearch:
    context = AreaContext(UnoccupiedArea(0.0, as_multipolygon(region)), SETTINGS.simplification, grain)
    return PlaceSearch(context, np.array(start), DISTANCES, np.array(goal))


def test_the_place_is_off_the_claim_and_keeps_the_margin() -> None:
    hall = shapely.box(0.0, 0.0, 10.0, 8.0)
    way = shapely.LineString([(0.0, 4.0), (10.0, 4.0)])
    place = search(hall, (5.0, 4.1), (1.0, 4.0)).nearest((), (), [Claim(way, 0.7)], [])
    assert place is not None
    assert shapely.distance(way, shapely.points(place.point)) >= 0.7
    assert shapely.distance(hall.boundary, shapely.points(place.point)) >= 0.4
    assert np.linalg.norm(place.point - (5.0, 4.1)) < 0.65, "the nearer side"


@pytest.mark.parametrize("start", [(5.0, 4.1), (0.45, 0.45), (41.0, 4.1)])
def test_in_a_crowd_a_place_is_as_good(start: tuple[float, float]) -> None:
    """Only what lies around the robot is looked at; where nobody stands in the way that makes no difference."""
    hall = shapely.box(0.0, 0.0, 60.0, 8.0)
    way, stands = shapely.LineString([(0.0, 4.0), (60.0, 4.0)]), ((5.0, 5.3, 0.5), (50.0, 2.0, 0.5))
    alone, crowd = (
        search(hall, start, (1.0, 4.0), grain).nearest(stands, (), [Claim(way, 0.7)], [])
        for grain in (0.0, 0.01)
    )
    assert alone is not None
    assert crowd is not None
    assert crowd.cost <= alone.cost + 0.05
    assert shapely.distance(way, shapely.points(crowd.point)) >= 0.7
    assert shapely.distance(hall.boundary, shapely.points(crowd.point)) >= 0.4
    assert all(np.linalg.norm(crowd.point - (x, y)) >= radius for x, y, radius in stands)


def test_somebody_elses_way_is_kept_free_where_that_is_little_farther() -> None:
    hall = shapely.box(0.0, 0.0, 10.0, 8.0)
    way = shapely.LineString([(0.0, 4.0), (10.0, 4.0)])
    above = Claim(shapely.LineString([(0.0, 5.0), (10.0, 5.0)]), 0.6)
    place = search(hall, (5.0, 4.1), (1.0, 4.0)).nearest((), (), [Claim(way, 0.7)], [above])
    assert place is not None
    assert place.point[1] < 4.0


def test_behind_who_passes_is_no_place() -> None:
    """A corridor with dead ends: a bay far away beats a corner from where the other's goal leaves no way."""
    corridor = shapely.union_all([shapely.box(0.0, 0.0, 14.0, 1.2), shapely.box(6.2, 1.1, 7.8, 2.6)])
    way = shapely.LineString([(0.6, 0.6), (12.0, 0.6)])
    looking = search(corridor, (12.6, 0.6), (0.6, 0.6))
    corner = looking.nearest((), (), [Claim(way, 0.7)], [])
    bay = looking.nearest((), ((12.0, 0.6, 0.7),), [Claim(way, 0.7)], [])
    assert corner is not None
    assert corner.point[0] > 12.5
    assert bay is not None
    assert bay.point[1] > 1.2


def test_nowhere_off_the_claim_is_no_place() -> None:
    tube = shapely.box(0.0, 0.0, 10.0, 1.2)
    way = shapely.LineString([(0.0, 0.6), (10.0, 0.6)])
    assert search(tube, (5.0, 0.6), (9.0, 0.6)).nearest((), (), [Claim(way, 0.7)], []) is None


def test_nobody_is_driven_through() -> None:
    tube = shapely.box(0.0, 0.0, 10.0, 1.2)
    claim = Claim(shapely.LineString([(5.0, 0.6), (10.0, 0.6)]), 0.7)
    open_way = search(tube, (6.0, 0.6), (0.6, 0.6))
    assert open_way.nearest((), (), [claim], []) is not None
    assert open_way.nearest(((4.5, 0.6, 0.7),), (), [claim], []) is None
