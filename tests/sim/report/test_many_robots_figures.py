"""Figures of runs with many robots: who is who, who waited for whom, and how near they came."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.image import imread

from snnav_core.types import Pose2D, TimedPath, VelocityCommand
from snnav_sim.report.clearance_figure import draw_clearance
from snnav_sim.report.decisions_figure import draw_decisions, phases
from snnav_sim.report.figures import draw_scene
from snnav_sim.report.look import Look, short_names
from snnav_sim.report.record import Decision, RunRecord
from snnav_sim.report.separation import separations
from snnav_sim.report.separation_figure import draw_separation
from snnav_sim.report.truth import GroundTruth
from snnav_sim.scene import Scene

STAY = TimedPath(0.0, 0.5, np.zeros((1, 2)))


def many(scene: Scene, count: int) -> Scene:
    robots = tuple(
        replace(scene.robots[0], id=f"r_{index}", start=(0.8 + 0.1 * index % 8, 0.8), speed=1.0 + index % 3)
        for index in range(count)
    )
    return replace(scene, robots=robots)


def run(scene: Scene) -> RunRecord:
    """All robots creep to the right; every other one waits for the one before it."""
    record = RunRecord(0)
    for index, robot in enumerate(scene.robots):
        for tick in range(20):
            pose = Pose2D(robot.start[0] + 0.01 * tick, robot.start[1], 0.0)
            record.add_sample(robot.id, 0.05 * tick, pose, VelocityCommand(0.2, 0.0))
        waits = Decision(0.0, robot.id, None, "blocked_by_robot", f"robot {robot.id} waits for r_{index - 1}")
        record.decisions.append(waits if index % 2 else Decision(0.0, robot.id, STAY))
    return record


def test_few_robots_have_names_some_a_colour_many_a_kind(room: Scene) -> None:
    few, some, crowd = (Look.of(many(room, count)) for count in (8, 24, 60))
    assert [label for _, label in few.handles] == [f"r_{index}" for index in range(8)]
    assert not few.named
    assert len(set(few.colours)) == 8
    assert some.named
    assert not some.handles
    assert len(set(some.colours)) == 24
    assert [label for _, label in crowd.handles] == [
        f"20 x r: radius 0.2 m, {speed} m/s" for speed in (1, 2, 3)
    ]
    assert len(crowd.colours) == 60
    assert len(set(crowd.colours)) == 3


def test_many_kinds_are_only_counted(room: Scene) -> None:
    robots = tuple(
        replace(robot, speed=1.0 + 0.1 * index) for index, robot in enumerate(many(room, 30).robots)
    )
    ((_, label),) = Look.of(replace(room, robots=robots)).handles
    assert label == "30 robots of 30 kinds"


@pytest.mark.parametrize(
    ("names", "short"),
    [
        (["robot_1", "robot_12"], ["1", "12"]),
        (["cart_1", "robot_2"], ["cart_1", "robot_2"]),
        (["robot_1"], ["robot_1"]),
        (["left", "right"], ["left", "right"]),
    ],
)
def test_short_names(names: list[str], short: list[str]) -> None:
    assert short_names(names) == dict(zip(names, short, strict=True))


def test_phases_put_equal_decisions_together_and_name_the_others() -> None:
    def stop(time: float, reason: str, message: str) -> Decision:
        return Decision(time, "a", None, reason, message)

    decisions = [
        Decision(0.0, "a", STAY, source="warm_start"),
        Decision(0.5, "a", STAY, source="tangent_graph"),
        stop(1.0, "blocked_by_robot", "robot a waits: comes within 0.1 m of robot b, then of robot c and b"),
        stop(1.5, "blocked_by_robot", "robot a waits for b and c"),
        stop(2.0, "blocked_by_robot", "robot a waits for c"),
        Decision(2.5, "a", STAY, source="turn_in_place"),
        stop(3.0, "made_up", "for b"),
        stop(3.5, "arrived", "robot a is 0.05 m from its target"),
    ]
    found = phases(decisions, 5.0, ["a", "b", "c"])
    assert [(phase.begin, phase.end, phase.others) for phase in found] == [
        (0.0, 1.0, ()),
        (1.0, 2.0, ("b", "c")),
        (2.0, 2.5, ("c",)),
        (2.5, 3.0, ()),
        (3.0, 3.5, ("b",)),
        (3.5, 5.0, ()),
    ]
    assert [phase.doing for phase in found][3:] == ["turns on the spot", "stopped: made up", "arrived"]


@pytest.mark.parametrize("count", [2, 12, 60])
def test_all_figures_are_drawn(tmp_path: Path, room: Scene, count: int) -> None:
    scene = many(room, count)
    record, truth = run(scene), GroundTruth(scene)
    draw_scene(scene, record, truth, tmp_path / "scene.png")
    draw_clearance(scene, record, truth, tmp_path / "clearance.png")
    draw_separation(scene, separations(scene, record), tmp_path / "separation.png")
    draw_decisions(scene, record, tmp_path / "decisions.png")
    for name in ("scene", "clearance", "separation", "decisions"):
        image = imread(tmp_path / f"{name}.png")
        assert image.shape[1] > 1000
        assert float(image[..., :3].std()) > 0.01, "something is drawn"
    assert imread(tmp_path / "decisions.png").shape[0] < 1800


@pytest.mark.parametrize("together", [False, True])
def test_only_robots_that_were_there_at_once_have_a_least_separation(
    tmp_path: Path, room: Scene, monkeypatch: pytest.MonkeyPatch, together: bool
) -> None:
    """One may leave before the other one joins."""
    scene, record = many(room, 2), RunRecord(0)
    for index, robot in enumerate(scene.robots):
        for tick in range(20):
            time = 0.05 * tick + (0.0 if together else 5.0 * index)
            record.add_sample(robot.id, time, Pose2D(*robot.start, 0.0), VelocityCommand(0.0, 0.0))
    drawn: list[Figure] = []
    monkeypatch.setattr(Figure, "savefig", lambda figure, *_, **__: drawn.append(figure))
    draw_separation(scene, separations(scene, record), tmp_path / "separation.png")
    labels = [text.get_text() for text in drawn[0].axes[0].get_legend().get_texts()]
    assert any(label.startswith("least: ") for label in labels) == together
