"""Many robots in one hall: the step for all of them by their number, and where its time goes."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from crowd import crowd
from harness import Row
from parts import PartTimer

from snnav_core.area.fusion import AreaFusion
from snnav_core.navigator import search
from snnav_core.navigator.context import AreaContext
from snnav_core.navigator.ground import GroundNavigator
from snnav_core.navigator.yielding import Yielding
from snnav_core.planning import adjustment, certificate, separation
from snnav_core.types import FloatArray
from snnav_sim.scene import find_scene, load_scene
from snnav_sim.scene_types import Scene
from snnav_sim.simulation import Simulation

STEPS = {1: 40, 10: 40, 50: 60, 100: 120, 200: 40}  # robots -> decisions measured
LIMITED = 100  # robots; the limit is the sampling interval
BEFORE_PROFILE = 10  # decisions of a run of its own, after which ...
PROFILED = 30  # ... parts are timed in so many more, while most robots are under way
PARTS = {
    "rest": [(GroundNavigator, "step")],
    "area": [(AreaFusion, "add_scan"), (AreaFusion, "area")],
    "who makes room": [(Yielding, "update")],
    "search": [(search, "find_route"), (search, "route_candidates"), (AreaContext, "region")],
    "adjust": [(adjustment, "adjust")],
    "certificate": [(certificate, "certify")],
    "separation": [(separation, "separation")],
}


@dataclass(frozen=True)
class Drive:
    """What a closed loop took.

    Parameters
    ----------
    seconds : ndarray
        Fusion and decision together, of every sampling interval [s]; the first one is apart from the others.
    decisions : ndarray
        The decision alone [s].
    factor : float
        Simulated time over the time that it took, simulation of scanners and bases included.
    parts : str
        Which part of the step takes how much.
    """

    seconds: FloatArray
    decisions: FloatArray
    factor: float
    parts: str


def drive(scene: Scene, steps: int, profiled: int = 0) -> Drive:
    """Run the closed loop for some sampling intervals, and some more in which parts are timed."""
    simulation, timer = Simulation(scene), PartTimer()

    def interval() -> None:
        for _ in range(scene.ticks_per_sample):
            simulation.move()
        simulation.decide()

    simulation.decide()
    begin = time.perf_counter()
    for _ in range(steps):
        interval()
    factor = steps * scene.sampling_interval / (time.perf_counter() - begin)
    with timer.watching(PARTS):
        for _ in range(profiled):
            interval()
    record = simulation.record
    decisions = np.array(record.planner_seconds)[: steps + 1]
    seconds = decisions + np.array(record.fusion_seconds)[: steps + 1]
    return Drive(seconds, decisions, factor, timer.shares() if profiled else "")


def rows() -> list[Row]:
    """Measure the first robots of the scene, or all and more of their kinds."""
    scene = load_scene(find_scene("hundred"))
    drive(crowd(scene, 2), 2)  # loads compiled code
    found, others = [], []
    for count, steps in STEPS.items():
        limited = count == LIMITED
        result = drive(crowd(scene, count), steps)
        first, later = float(result.seconds[0]), result.seconds[1:]
        median, high = np.percentile(later, (50, 99)).tolist()
        alone = np.percentile(result.decisions[1:], (50, 99))
        text = f"p50 {1e3 * median:.0f} ms, p99 {1e3 * high:.0f} ms; {1e3 * median / count:.1f} ms each"
        text += f"; decision alone {1e3 * alone[0]:.0f} and {1e3 * alone[1]:.0f} ms"
        found.append(
            Row(
                f"{count} robots, {steps} steps (first one {1e3 * first:.0f} ms)",
                text,
                median,
                f"p99 < {1e3 * scene.sampling_interval:g} ms" if limited else "",
                limited and high >= scene.sampling_interval,
            )
        )
        if limited:
            parts = drive(crowd(scene, count), BEFORE_PROFILE, PROFILED).parts
            others.append(Row(f"where it goes, {count} robots", parts))
            closed = f"closed loop, {count} robots, {len(scene.sensors)} simulated scanners"
            others.append(Row(closed, f"{result.factor:.1f} x real time"))
    return [*found, *others]
