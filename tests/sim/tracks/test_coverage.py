"""What no body explains stays covered: at every time, and where bodies have left."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
import shapely

from snnav_core.area.tracks import TrackedScene
from snnav_core.obstacles import MovingObstacle
from snnav_sim.world import solid

INTERVAL = 0.3
NOISE = 0.04  # [m] by which measured surfaces may be off, rarely

MakeHall = Callable[..., Any]


def union(bodies: list[MovingObstacle]) -> Any:
    return shapely.union_all([shapely.Polygon(body.outline).buffer(body.radius) for body in bodies])


def check(hall: Any, scene: TrackedScene) -> None:
    workspace = shapely.union_all([shapely.Polygon(ring) for ring in scene.workspace])
    standing = union([body for body in scene.obstacles if body.speed == 0.0])
    free = workspace.difference(union(list(scene.obstacles)))
    # everything is seen to be free, in a body, or outside
    assert free.difference(hall.area.region.buffer(1e-6)).area < 1e-6
    # nothing true is free
    bodies = shapely.union_all(list(hall.bodies(scene.stamp).values()))
    walls = shapely.union_all([solid(shape) for shape in hall.world.scene.obstacles])
    assert free.intersection(bodies).buffer(-NOISE).is_empty
    assert workspace.difference(shapely.box(0.0, 0.0, 12.0, 9.0)).buffer(-NOISE).is_empty
    # what stands is covered by what stands: it stays so when bodies go on
    assert workspace.difference(standing).intersection(walls).buffer(-NOISE).is_empty


def check_halls(make: MakeHall, seeds: range) -> None:
    for seed in seeds:
        hall = make(seed, standing=4)
        for k in range(8):
            check(hall, hall.step(INTERVAL * k))


def test_everything_is_covered_that_is_not_seen_free(make_random_hall: MakeHall) -> None:
    check_halls(make_random_hall, range(6))


@pytest.mark.nightly
def test_everything_is_covered_in_many_halls(make_random_hall: MakeHall) -> None:
    check_halls(make_random_hall, range(100))


def test_bodies_seen_from_all_sides_stay_inside_their_outlines(make_random_hall: MakeHall) -> None:
    """One second ahead too, with twice the deviation."""
    for seed in range(20, 26):
        hall = make_random_hall(seed, moving=2, standing=0, scanners=4)
        for k in range(4):
            scene = hall.step(INTERVAL * k)
        for true in hall.bodies(scene.stamp + 1.0).values():
            ahead = [
                shapely.Polygon(body.outline_at(scene.stamp + 1.0)).buffer(
                    2.0 * body.velocity_deviation + NOISE
                )
                for body in scene.obstacles
                if body.speed > 0.0
            ]
            assert any(outline.contains(true) for outline in ahead)


def test_a_scanner_alone_leaves_shadows_standing(make_hall: MakeHall) -> None:
    walker = {"id": "walker", "circle": [0, 0, 0.4], "start": [4, 4], "velocity": [0.5, 0.2]}
    hall = make_hall([walker], [{"circle": [8, 6, 0.5]}], 1)
    for k in range(6):
        check(hall, hall.step(INTERVAL * k))
