"""Robots that want past each other: our closed loop from scans, beside ORCA, which knows everything exactly."""

from __future__ import annotations

import math
from functools import partial

import numpy as np
from harness import Row, absent, milliseconds
from orca import OrcaRun, orca_run

from snnav_sim.report.metrics import compute_metrics
from snnav_sim.scene import find_scene, load_scene
from snnav_sim.scene_types import Scene
from snnav_sim.simulation import simulate

ORCA_SEEDS = 5


def straight_time(scene: Scene) -> float:
    """Return when the last robot would arrive if each drove straight through everything [s]."""
    return max(math.dist(robot.start, robot.target) / robot.speed for robot in scene.robots)


def ours(scene: Scene) -> Row:
    """Run our closed loop to its end."""
    record = simulate(scene)
    robots = compute_metrics(scene, record)["robots"].values()
    arrivals = [robot["arrival_time"] for robot in robots if robot["reached"]]
    least = min(robot["least_separation"] for robot in robots)
    all_there = len(arrivals) == len(scene.robots)
    times = np.array(record.planner_seconds[1:])
    result = (
        f"{_arrived(len(arrivals), scene, max(arrivals, default=math.nan))}, least {_down(least)} m; "
        f"step {milliseconds(times)}"
    )
    demanded = f"all, >= {scene.safety_margin:g} m"
    missed = not all_there or least < scene.safety_margin
    return Row(f"snnav, {scene.name}", result, max(arrivals, default=math.nan), demanded, missed)


def _down(distance: float) -> str:
    """Round a distance down to a millimetre [m]: no margin is kept by rounding."""
    return f"{math.floor(1e3 * distance) / 1e3:.3f}"


def _arrived(count: int, scene: Scene, makespan: float) -> str:
    """Say how many arrived, and when the last one of all did."""
    total = len(scene.robots)
    return f"all in {makespan:.1f} s" if count == total else f"{count} of {total} arrive"


def orca(scene: Scene) -> Row:
    """Run ORCA with several seeds; the median of its makespans and the least of all separations count."""
    runs = [orca_run(scene, seed) for seed in range(ORCA_SEEDS)]
    done = [run for run in runs if run is not None]
    if not done:
        return absent("ORCA")
    middle = sorted(done, key=lambda run: run.makespan)[len(done) // 2]
    times = np.concatenate([run.step_seconds for run in done])
    spread = _spread(done)
    result = (
        f"{_arrived(middle.arrived, scene, middle.makespan)}{spread}, least "
        f"{_down(min(run.separation for run in done))} m; step {milliseconds(times)}"
    )
    return Row(f"ORCA, {scene.name} ({ORCA_SEEDS} seeds)", result, middle.makespan, peer=True)


def _spread(runs: list[OrcaRun]) -> str:
    spans = [run.makespan for run in runs]
    if not math.isfinite(max(spans)):
        return (
            f" ({sum(map(math.isfinite, spans))} of {len(spans)} runs end)"
            if math.isfinite(min(spans))
            else ""
        )
    return f" ({min(spans):.1f} to {max(spans):.1f})"


def rows(name: str) -> list[Row]:
    """Measure one scene."""
    scene = load_scene(find_scene(name))
    straight = straight_time(scene)
    return [
        ours(scene),
        Row("straight through everything", f"{straight:.1f} s", straight, peer=True),
        orca(scene),
    ]


def benches() -> dict[str, partial[list[Row]]]:
    """Return a benchmark for every scene."""
    return {
        "twenty robots change places on a circle of 15 m": partial(rows, "swap20"),
        "two robots change rooms through a corridor": partial(rows, "corridor_swap"),
        "four robots, one door": partial(rows, "doorway"),
        "four robots at a crossing": partial(rows, "crossing"),
    }
