"""In a large crowd work is spread over steps; nobody is forgotten, and nothing depends on the machine."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np
import shapely

from snnav_core.area.planar import UnoccupiedArea, as_multipolygon
from snnav_core.navigator.ground import GroundNavigator
from snnav_core.navigator.settings import NavigatorSettings
from snnav_core.types import (
    PathSource,
    PlannedPath,
    Pose2D,
    RobotSpec,
    RobotState,
    StepResult,
    Stop,
    StopReason,
)

HALL = as_multipolygon(shapely.box(0.0, 0.0, 60.0, 40.0))
COUNT, STEPS, INTERVAL = 30, 12, 0.5
SETTINGS = NavigatorSettings(INTERVAL, 0.5, 4, searches_per_step=10, followed_steps=2, crowd=20)


def run() -> list[StepResult]:
    """Robots in rows, all to the next corner of the hall; they follow their paths exactly."""
    specs = [RobotSpec(f"r{index}", 0.2 + 0.05 * (index % 3), 1.0, 1.5) for index in range(COUNT)]
    poses = {s.id: Pose2D(5.0 + 8.0 * (k % 6), 5.0 + 6.0 * (k // 6), 0.3 * k) for k, s in enumerate(specs)}
    goals = {s.id: (50.0 - 6.0 * (k % 6), 33.0 - 5.0 * (k // 6)) for k, s in enumerate(specs)}
    navigator = GroundNavigator(specs, SETTINGS)
    results = []
    for step in range(STEPS):
        time = step * INTERVAL
        states = {name: RobotState(name, pose, time) for name, pose in poses.items()}
        results.append(navigator.step(time, UnoccupiedArea(time, HALL), states, goals))
        for name, decision in results[-1].decisions.items():
            if isinstance(decision, PlannedPath):
                poses[name] = _followed(decision, poses[name], time + INTERVAL)
    return results


def _followed(plan: PlannedPath, pose: Pose2D, time: float) -> Pose2D:
    if plan.path.turn_to is not None:
        return Pose2D(pose.x, pose.y, plan.path.turn_to)
    before, after = plan.path.positions_at(np.array([time - 1e-3, time]))
    x, y = after.tolist()
    return Pose2D(x, y, math.atan2(after[1] - before[1], after[0] - before[0]))


def test_ways_are_sought_for_a_few_robots_in_a_step_and_for_all_in_a_few_steps() -> None:
    results = run()
    for step, result in enumerate(results[:3]):
        waiting = [d for d in result.decisions.values() if isinstance(d, Stop)]
        assert len(waiting) >= COUNT - 10 * (step + 1)
        for stop in waiting[: COUNT - 10 * (step + 1)]:
            assert stop.reason is StopReason.NO_PATH
    texts = [d.message for d in results[0].decisions.values() if isinstance(d, Stop)]
    assert sum("its way is sought when that of others has been" in text for text in texts) == COUNT - 10
    under_way = {name for r in results[:5] for name, d in r.decisions.items() if isinstance(d, PlannedPath)}
    assert len(under_way) == COUNT


def test_good_paths_are_followed_twice_before_they_are_adjusted_again() -> None:
    results = run()
    sources = [
        {name: d.source for name, d in result.decisions.items() if isinstance(d, PlannedPath)}
        for result in results
    ]
    assert Counter(source for step in sources for source in step.values())[PathSource.LAST_PATH] > COUNT
    for name in sources[-1]:
        row = [step.get(name) is PathSource.LAST_PATH for step in sources]
        runs = "".join("x" if kept else " " for kept in row).split()
        assert all(len(one) <= SETTINGS.followed_steps for one in runs), name


def test_two_navigators_decide_the_same() -> None:
    first, second = run(), run()
    for one, other in zip(first, second, strict=True):
        assert list(one.decisions) == list(other.decisions)
        for a, b in zip(one.decisions.values(), other.decisions.values(), strict=True):
            if isinstance(a, PlannedPath):
                assert isinstance(b, PlannedPath)
                assert a.path.digest() == b.path.digest()
            else:
                assert a == b
