"""What the recorder of a run makes of messages, in whatever order they come from several processes."""

from __future__ import annotations

import itertools

import pytest
import shapely

from snnav_core.area.planar import UnoccupiedArea, as_multipolygon
from snnav_core.types import Stop, StopReason
from snnav_ros.convert import area_to_message, nanoseconds, stop_to_path, verdict_to_message
from snnav_ros.recorder import RunCollector
from snnav_sim.report.record import RunRecord
from snnav_sim.scene import find_scene, load_scene

AREA = UnoccupiedArea(0.5, as_multipolygon(shapely.box(0.0, 0.0, 10.0, 6.0)))


@pytest.mark.parametrize("order", list(itertools.permutations(("area", "path", "verdict"))))
def test_the_area_of_the_last_instant_is_kept_though_it_comes_after_the_decisions(
    order: tuple[str, ...],
) -> None:
    """Area and decisions come from different processes: either may be heard first."""
    scene = load_scene(find_scene("hello"))
    (robot,) = scene.robots
    record, stamp = RunRecord(1), nanoseconds(AREA.stamp)
    collector = RunCollector(scene, record, None, lockstep=True)
    path = stop_to_path(stamp)
    verdict = verdict_to_message(Stop(robot.id, StopReason.ARRIVED, "there"), stamp, path)
    takes = {
        "area": lambda: collector.take_area("unoccupied_area", area_to_message(AREA)),
        "path": lambda: collector.take_path(robot.id, f"{robot.id}/path", path),
        "verdict": lambda: collector.take_verdict(robot.id, f"{robot.id}/certificate", verdict),
    }
    for name in order:
        takes[name]()
    assert record.reason == "all robots arrived"
    assert [time for time, _ in record.areas] == [AREA.stamp]
    later = UnoccupiedArea(AREA.stamp + scene.sampling_interval, AREA.region)
    collector.take_area("unoccupied_area", area_to_message(later))
    assert len(record.areas) == 1, "what comes after the end is no part of the run"
