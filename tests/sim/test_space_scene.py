"""Scenes in space: read strictly, written completely."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import trimesh

from snnav_sim.scene import (
    SceneError,
    SpaceScene,
    dump_scene,
    find_scene,
    load_any_scene,
    load_scene,
    parse_any_scene,
    parse_scene,
)
from snnav_sim.simulation import simulation_of
from snnav_sim.space_read import SPACE_OPTIONAL, SPACE_REQUIRED, SPACE_SENSOR
from snnav_sim.space_types import Mesh
from snnav_sim.space_world import SpaceWorld

ROOT = Path(__file__).parents[2]
DOC = (ROOT / "docs" / "scenes-in-space.md").read_text(encoding="utf-8")
EXAMPLE = re.findall(r"```yaml\n(.*?)```", DOC, flags=re.DOTALL)[0]


def parse(text: str) -> SpaceScene:
    scene = parse_any_scene(text, "my.yaml")
    assert isinstance(scene, SpaceScene)
    return scene


def test_the_example_of_the_document_runs() -> None:
    simulation = simulation_of(parse(EXAMPLE.replace("columns: 128", "columns: 32")))
    simulation.decide()
    assert simulation.record.decisions


def test_every_key_is_described() -> None:
    for key in (*SPACE_REQUIRED, *SPACE_OPTIONAL, *SPACE_SENSOR):
        assert f"| `{key}` |" in DOC


def test_what_is_written_reads_the_same() -> None:
    for scene in (parse(EXAMPLE), load_any_scene(find_scene("hello_flight"))):
        assert parse(dump_scene(scene)) == scene


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("target: [5, 2, 2]", "target: [5, 2]", "robots[0].target: a list of 2, expected 3: write [x, y, z]"),
        ("target: [5, 2, 2]", "target: [5, 2, 9]", "robots[0].target: [5, 2, 9] lies outside the workspace"),
        ("[6, 4, 3]]", "[6, 4, 0]]", "workspace.box[1]: z 0 is not above z 0 of the first corner"),
        ("safety_margin: 0.4", "safety_margin: 0.3", "safety_margin: 0.3 is below the turning radius 0.35 of bee"),
        ("], speed: 0.2", "], speed: 0.5", "movers[0].speed: person moves at 0.5 m/s, faster than boundary_speed 0.2"),
        ("look_at: [3, 2, 1]", "look: [3, 2, 1]", "sensors[0].look: unknown key: did you mean look_at?"),
        ("position: [0.1, 0.1, 2.8]", "position: [2.9, 0.1, 2.8]", "sensors[0].position: [2.9, 0.1, 2.8] is inside"),
        ("height: [0, 1.8]", "height: [1, 1]", "movers[0].height[1]: 1 is not above the bottom 1"),
        ("kind: drop_out", "kind: beam_count, change: 2", "sensors[1].faults[0].kind: beam_count is for planar"),
        ("pitch_deg: 0", "pitch_deg: 99", "robots[0].pitch_deg: 99 is out of range"),
        ("grid_spacing: 0.1", "grid_spacing: 2", "grid_spacing: 2 is out of range"),
        ("sensors:", "sensors: []\nleft: ", "left: unknown key"),
        ("heading_deg: 0, pitch", "curve: [[1, 1, 1], [2, 2, 2]], heading_deg: 0, pitch", "needs a target or a curve"),
    ],
)  # fmt: skip
def test_mistakes_are_told_with_line_and_key(old: str, new: str, message: str) -> None:
    assert old in EXAMPLE
    with pytest.raises(SceneError) as caught:
        parse(EXAMPLE.replace(old, new))
    assert re.match(r"my\.yaml:\d+: ", str(caught.value))
    assert message in str(caught.value)


def test_where_a_scene_in_the_plane_is_wanted_one_in_space_is_refused() -> None:
    with pytest.raises(SceneError, match="only `snnav run --core` takes one"):
        parse_scene(EXAMPLE, "my.yaml")
    with pytest.raises(SceneError, match="workspace"):
        load_scene(find_scene("hello_flight"))


def test_meshes_come_from_files_beside_the_scene(tmp_path: Path) -> None:
    trimesh.creation.box(bounds=[[2.0, 1.0, 0.0], [2.5, 1.5, 1.0]]).export(tmp_path / "crate.stl")
    text = EXAMPLE.replace("movers:", "  - {mesh: crate.stl}\nmovers:")
    path = tmp_path / "scene.yaml"
    path.write_text(text, encoding="utf-8")
    scene = load_any_scene(path)
    assert isinstance(scene, SpaceScene)
    assert scene.obstacles[-1].solid == Mesh(str(tmp_path / "crate.stl"))
    world = SpaceWorld(scene)
    point = np.array([[1.6, 1.2, 0.5]])
    assert world.clearance(point)[0] == pytest.approx(0.4, abs=1e-6)
    ranges = world.still_ranges(point[0], np.array([[1.0, 0.0, 0.0]]))
    assert ranges[0] == pytest.approx(0.4, abs=1e-6)
    (tmp_path / "crate.stl").write_text("no triangles", encoding="utf-8")
    path.write_text(text.replace("crate.stl", "box.ply"), encoding="utf-8")
    with pytest.raises(SceneError, match=r"obstacles\[\d\].mesh: box.ply: give a file of triangles"):
        load_any_scene(path)
    path.write_text(text.replace("crate.stl", "lost.obj"), encoding="utf-8")
    with pytest.raises(SceneError, match=r"lost.obj does not exist"):
        load_any_scene(path)
