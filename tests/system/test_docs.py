"""The examples of README and docs are run, their names and links are looked up."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from snnav_core.types import StopReason
from snnav_sim.scene import parse_any_scene, parse_scene
from snnav_sim.simulation import simulate

ROOT = Path(__file__).parents[2]
TEXTS = {
    path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8")
    for path in [*sorted(ROOT.glob("*.md")), *sorted(ROOT.glob("docs/*.md"))]
}
SOURCE = "\n".join(path.read_text(encoding="utf-8") for path in sorted(ROOT.glob("snnav_*/snnav_*/**/*.py")))


def blocks(language: str) -> list[tuple[str, str]]:
    """Return every fenced block of a language with a name that tells where it stands."""
    found = []
    for name, text in TEXTS.items():
        for match in re.finditer(rf"^```{language}\n(.*?)^```", text, re.DOTALL | re.MULTILINE):
            line = text.count("\n", 0, match.start()) + 1
            found.append((f"{name}:{line}", match.group(1)))
    return found


def scenes() -> list[tuple[str, str]]:
    return [(where, block) for where, block in blocks("yaml") if "workspace" in (yaml.safe_load(block) or {})]


def parameter_files() -> list[tuple[str, str]]:
    return [(where, block) for where, block in blocks("yaml") if "ros__parameters" in block]


def commands(program: str) -> list[tuple[str, str]]:
    """Return every line of a shell block that calls a program, without comments."""
    lines = [
        (where, line.partition(" #")[0].strip())
        for where, block in blocks("bash")
        for line in block.splitlines()
    ]
    return [(where, line) for where, line in lines if line.split(" ")[0] == program]


def named(cases: list[tuple[str, str]]) -> list[object]:
    return [pytest.param(text, id=where) for where, text in cases]


def test_there_is_something_to_check() -> None:
    assert scenes()
    assert parameter_files()
    assert commands("snnav")
    assert commands("make")


@pytest.mark.parametrize("text", named(scenes()))
def test_scene_examples_are_scenes(text: str) -> None:
    assert parse_any_scene(text, "example").sensors


def test_scene_of_the_readme_runs_to_the_target() -> None:
    (text,) = [block for where, block in scenes() if where.startswith("README")]
    record = simulate(parse_scene(text, "README.md"))
    assert record.decisions[-1].reason == StopReason.ARRIVED.value


@pytest.mark.parametrize("text", named(parameter_files()))
def test_parameter_examples_start_their_nodes(text: str, tmp_path: Path) -> None:
    import rclpy

    from snnav_ros.nodes.fusion import FusionNode
    from snnav_ros.nodes.planner import PlannerNode

    kinds = {"fusion_node": FusionNode, "planner_node": PlannerNode}
    path = tmp_path / "parameters.yaml"
    path.write_text(text, encoding="utf-8")
    rclpy.init(args=["--ros-args", "--params-file", str(path)])
    try:
        for name in yaml.safe_load(text):
            kinds[name]().destroy_node()
    finally:
        rclpy.try_shutdown()


@pytest.mark.parametrize("line", named(commands("make")))
def test_make_targets_exist(line: str) -> None:
    targets = set(re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
    words = shlex.split(line)[1:]
    if "-C" in words:
        del words[words.index("-C") : words.index("-C") + 2]
    assert {word for word in words if "=" not in word} <= targets


@pytest.mark.parametrize("line", named(commands("snnav")))
def test_snnav_commands_exist_with_their_options(line: str) -> None:
    _, command, *rest = shlex.split(line)
    program = [sys.executable, "-m", "snnav_ros.cli", command, "--help"]
    told = subprocess.run(program, capture_output=True, text=True, check=False, timeout=60)
    assert told.returncode == 0, told.stderr
    unknown = [word for word in rest if word.startswith("--") and word not in told.stdout]
    assert not unknown, f"snnav {command} does not know {unknown}"


@pytest.mark.parametrize("name", TEXTS)
def test_links_lead_somewhere(name: str) -> None:
    links = re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", TEXTS[name])
    missing = [
        link
        for link in links
        if not re.match(r"https?:", link) and not (ROOT / name).parent.joinpath(link).exists()
    ]
    assert not missing


def test_names_of_the_symbol_table_exist() -> None:
    rows = [line for line in TEXTS["docs/symbols.md"].splitlines() if line.startswith("|")]
    names = {name for row in rows for name in re.findall(r"`([\w.]+)`", row.split("|")[-2])}
    assert len(names) > 30
    missing = []
    for name in names:
        owner, _, member = name.partition(".")
        defined = re.search(rf"^(class|def) {owner}\b", SOURCE, re.MULTILINE) or owner == "goals"
        known = not member or re.search(rf"^\s+(def )?(self\.)?{member}\b\s*[:(=]", SOURCE, re.MULTILINE)
        if not (defined and known):
            missing.append(name)
    assert not missing
