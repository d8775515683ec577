"""A run looked at again: what was in sight, remembered, planned and driven at a moment."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely

from snnav_core.types import TimedPath
from snnav_sim.report.moment import Moments
from snnav_sim.report.record import Decision, RunRecord
from snnav_sim.report.truth import GroundTruth
from snnav_sim.scene_types import Circle, Mover, Scene
from snnav_sim.simulation import simulate
from snnav_sim.world import World

PATH = TimedPath(1.0, 0.5, np.array([[2.0, 2.0], [2.5, 2.0], [3.0, 2.0], [3.5, 2.0]]))


def moments_of(scene: Scene, record: RunRecord) -> Moments:
    return Moments(scene, record, GroundTruth(scene))


@pytest.fixture
def record() -> RunRecord:
    """Driven along x at 1 m/s from 1 to 3 s, on a path from 1 s to 2.5 s and none from then on."""
    record = RunRecord(0)
    rows = [(1.0 + 0.05 * tick, 2.0 + 0.05 * tick, 2.0, 0.1, 1.0, 0.0) for tick in range(41)]
    record.samples["r"] = rows
    record.decisions += [Decision(1.0, "r", PATH), Decision(2.5, "r", None, "no_path", "nothing")]
    return record


def test_a_robot_at_a_moment(room: Scene, record: RunRecord) -> None:
    (robot,) = room.robots
    moments = moments_of(room, record)
    assert moments.robot(robot, 0.5) is None, "before its first sample"
    moment = moments.robot(robot, 1.75)
    assert moment is not None
    assert moment.position == pytest.approx((2.75, 2.0))
    assert moment.heading == 0.1
    assert len(moment.driven) == 16
    assert moment.ahead == pytest.approx(np.array([[2.75, 2.0], [3.0, 2.0], [3.5, 2.0]])), "what is left"
    stopped = moments.robot(robot, 2.8)
    assert stopped is not None
    assert len(stopped.ahead) == 0


def test_even_times_are_sampling_instants_up_to_the_end(room: Scene, record: RunRecord) -> None:
    moments = moments_of(room, record)
    assert moments.end == pytest.approx(3.0)
    assert moments.times(4) == pytest.approx([0.5, 1.5, 2.0, 3.0])
    assert moments.times(100)[-1] == pytest.approx(3.0)
    assert np.all(np.diff(moments.times(100)) > 0.0)


def test_where_nothing_moves_all_is_in_sight(room: Scene) -> None:
    record = simulate(replace(room, time_limit=2.0))
    moments = moments_of(room, record)
    assert moments.area_is_one
    seen, remembered = moments.area(1.0)
    assert seen is record.areas[0][1]
    assert remembered.is_empty


def test_what_a_walker_hides_is_remembered_and_not_in_sight(room: Scene) -> None:
    walker = Mover("w", Circle(0.0, 0.0, 0.4), ((2.2, 7.0), (2.2, 1.0)), speed=0.5)
    robot = replace(room.robots[0], start=(5.0, 1.0), target=(9.0, 1.0))
    scene = replace(room, movers=(walker,), boundary_speed=0.5, time_limit=8.0, robots=(robot,))
    record = simulate(scene)
    moments, world = moments_of(scene, record), World(scene)
    assert moments.remembers
    shown = 0.0
    for stamp, region in record.areas:
        seen, remembered = moments.area(stamp + 0.2)
        assert seen is region
        assert remembered.difference(region.buffer(0.01)).is_empty
        assert remembered.intersection(world.true_unoccupied_area(stamp)).area < 0.02
        shown = max(shown, remembered.area)
    assert shown > 0.05


def test_behind_a_robot_a_sensor_on_the_floor_sees_nothing(room: Scene) -> None:
    record = RunRecord(0, samples={"r": [(0.0, 2.0, 4.0, 0.0, 0.0, 0.0)]})
    whole = shapely.MultiPolygon([shapely.box(0, 0, 10, 8)])
    record.areas.append((0.0, whole))
    sensors = (replace(room.sensors[0], sees_robots=True),)  # at (1, 4), the robot one metre before it
    _, hidden = moments_of(replace(room, sensors=sensors), record).area(0.0)
    assert hidden.contains(shapely.Point(3.5, 4.0))
    assert hidden.contains(shapely.Point(5.0, 4.0)), "within the block: not seen at all"
    beside = shapely.Point(3.5, 4.0 + 1.1 * 2.5 * 0.2 / math.sqrt(1.0 - 0.2**2))
    assert not hidden.contains(beside)


def test_without_recorded_areas_nothing_is_drawn_free(room: Scene, record: RunRecord) -> None:
    seen, remembered = moments_of(room, record).area(2.0)
    assert seen.is_empty
    assert remembered.is_empty
