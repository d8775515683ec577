"""The examples of docs/scene-format.md are scenes, and its tables name every key."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest

from snnav_sim.scene import SceneError, parse_scene
from snnav_sim.scene_faults import FAULT_KINDS
from snnav_sim.scene_read import OPTIONAL, REQUIRED, SCANNER
from snnav_sim.simulation import simulate

DOC = (Path(__file__).parents[2] / "docs" / "scene-format.md").read_text(encoding="utf-8")
FAULTS = DOC.partition("### Faults of a sensor")[2]
EXAMPLES = re.findall(r"```yaml\n(.*?)```", DOC, flags=re.DOTALL)


def test_there_are_examples() -> None:
    assert len(EXAMPLES) == 4


@pytest.mark.parametrize("text", EXAMPLES)
def test_an_example_runs(text: str) -> None:
    scene = replace(parse_scene(text, "docs/scene-format.md"), time_limit=2.0)
    record = simulate(scene)
    assert len(record.samples) == sum(scene.is_present(robot, 2.0) for robot in scene.robots)


def test_the_error_message_that_is_shown() -> None:
    wrong = EXAMPLES[0].replace("heading_deg: 0, field", "heading: 0, field")
    with pytest.raises(SceneError) as caught:
        parse_scene(wrong, "my.yaml")
    shown = re.search(r"```text\n(.*?)\n```", DOC, flags=re.DOTALL)
    assert shown is not None
    assert str(caught.value) == shown.group(1)


def test_every_key_of_a_scene_is_described() -> None:
    for key in (*REQUIRED, *OPTIONAL, *SCANNER):
        assert f"| `{key}` |" in DOC


@pytest.mark.parametrize("kind", FAULT_KINDS)
def test_every_fault_is_described_with_its_keys(kind: str) -> None:
    (row,) = [line for line in FAULTS.splitlines() if line.startswith(f"| `{kind}` |")]
    needed, optional = FAULT_KINDS[kind]
    assert re.findall(r"`(\w+)`", row.split("|")[2]) == [*needed, *optional]
