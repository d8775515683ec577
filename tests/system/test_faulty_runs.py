"""Scanners that drop, delay, repeat, garble or lie: no collision, no margin violation, an arrival or a typed stop."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context

import numpy as np
import pytest

from snnav_core.types import StopReason
from snnav_sim.random_scenes import faulty_scene
from snnav_sim.report.truth import GroundTruth
from snnav_sim.scene_faults import FAULT_KINDS
from snnav_sim.simulation import simulate

ALL = "all together"
GROUPS = (*FAULT_KINDS, ALL)
TYPED = {reason.value for reason in StopReason}
SERIES = 20  # runs of each kind in the long series


@dataclass(frozen=True)
class Outcome:
    """One run: how it ended, and the least distances [m] with what they must not fall below."""

    kind: str
    seed: int
    reason: str
    message: str
    refused: int
    least_clearance: float
    radius: float
    margin: float


def run(kind: str, seed: int) -> Outcome:
    scene = faulty_scene(seed, None if kind == ALL else [kind])
    record = simulate(scene)
    robot = scene.robots[0]
    rows = record.trajectory(robot.id)
    clearance = GroundTruth(scene).clearance(rows[:, 1:3], rows[:, 0])
    last = record.decisions[-1]
    return Outcome(
        kind,
        seed,
        last.reason or record.reason,
        last.message,
        sum(count for count, _ in record.rejected.values()),
        float(clearance.min()),
        robot.radius,
        scene.safety_margin,
    )


def check(outcomes: Sequence[Outcome]) -> None:
    assert outcomes
    for outcome in outcomes:
        assert outcome.least_clearance >= outcome.margin, outcome
        assert outcome.reason in TYPED, outcome
        assert outcome.message, outcome


@pytest.mark.parametrize("kind", GROUPS)
def test_whatever_the_scanners_do_the_robot_keeps_its_margin_and_ends_for_a_typed_reason(kind: str) -> None:
    check([run(kind, 1000 + GROUPS.index(kind))])


@pytest.mark.nightly
def test_two_hundred_faulty_runs(capsys: pytest.CaptureFixture[str]) -> None:
    jobs = [(kind, SERIES * index + seed) for index, kind in enumerate(GROUPS) for seed in range(SERIES)]
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        outcomes = list(pool.map(run, *zip(*jobs, strict=True)))
    with capsys.disabled():
        print("\n" + table(outcomes))
    check(outcomes)


def table(outcomes: Sequence[Outcome]) -> str:
    """Return one line for every kind of fault: arrivals, stops by reason, refused scans, violations."""
    lines = [
        "| fault | runs | arrived | stopped | collisions | margin violations | scans refused | least (m) |"
    ]
    lines.append("|---|---|---|---|---|---|---|---|")
    for kind in (*GROUPS, "sum"):
        some = [one for one in outcomes if kind in (one.kind, "sum")]
        stops = Counter(one.reason for one in some if one.reason != StopReason.ARRIVED.value)
        reasons = ", ".join(f"{reason} {count}" for reason, count in sorted(stops.items())) or "none"
        collisions = sum(one.least_clearance < one.radius for one in some)
        violations = sum(one.least_clearance < one.margin for one in some)
        least = np.floor(1e3 * min(one.least_clearance - one.margin for one in some)) / 1e3
        lines.append(
            f"| {kind} | {len(some)} | {len(some) - sum(stops.values())} | {reasons} | {collisions} | {violations} "
            f"| {sum(one.refused for one in some)} | margin + {least:.3f} |"
        )
    return "\n".join(lines)
