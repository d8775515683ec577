"""docs/interfaces.md says what the nodes do."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

from snnav_core.types import StopReason
from snnav_ros.convert.area import AREA_FIELDS
from snnav_ros.convert.obstacles import OBSTACLE_FIELDS
from snnav_ros.convert.returns import RETURN_FIELDS
from snnav_ros.nodes.fusion import FusionNode
from snnav_ros.nodes.global_planner import GlobalPlannerNode
from snnav_ros.nodes.planner import PlannerNode
from snnav_ros.nodes.robot import RobotNode
from snnav_ros.nodes.tracker import TrackerNode
from snnav_ros.parameter_tables import parameter_tables

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "docs" / "interfaces.md").read_text(encoding="utf-8")
CONFIG = ROOT / "snnav_ros" / "config"


def section(title: str) -> str:
    return TEXT.partition(f"### {title}\n")[2].partition("\n#")[0].strip()


def test_tables_of_parameters_are_those_of_the_nodes(graph: Any) -> None:
    for name, table in parameter_tables(graph.context).items():
        assert section(name) == table, (
            "run `python -m snnav_ros.parameter_tables` and put its tables into the text"
        )


def test_words_of_the_text_are_those_of_the_code() -> None:
    assert all(f"`{reason.value}`" in TEXT for reason in StopReason)
    assert [name for name, _, _ in AREA_FIELDS] == ["x", "y", "z", "ring"]
    assert "| `ring` | UINT32 | 24 |" in TEXT
    kinds = {5: "INT32", 6: "UINT32", 8: "FLOAT64"}
    for name, offset, kind in (*OBSTACLE_FIELDS[3:], *RETURN_FIELDS[3:]):
        assert f"| `{name}` | {kinds[kind]} | {offset} |" in TEXT


@pytest.mark.parametrize(
    ("file", "name", "kind"),
    [
        ("network", "fusion_node", FusionNode),
        ("network", "planner_node", PlannerNode),
        ("network", "tracker_node", TrackerNode),
        ("network", "global_planner_node", GlobalPlannerNode),
        ("network", "cart_1", RobotNode),
        ("network_in_space", "fusion_node", FusionNode),
        ("network_in_space", "planner_node", PlannerNode),
    ],
)
def test_example_of_a_network_starts_its_nodes(graph: Any, file: str, name: str, kind: type) -> None:
    content = yaml.safe_load((CONFIG / f"{file}.yaml").read_text(encoding="utf-8"))
    graph.add(kind, name, **flat(content[f"/**/{name}"]["ros__parameters"]))


def flat(group: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, value in group.items():
        found |= flat(value, f"{prefix}{key}.") if isinstance(value, dict) else {f"{prefix}{key}": value}
    return found


def test_topics_of_a_scene_are_those_of_the_table(graph: Any) -> None:
    options = {"scene": "hello"}
    for kind in (FusionNode, PlannerNode, TrackerNode, GlobalPlannerNode, RobotNode):
        graph.add(kind, **options)
    named = {name for name, _ in graph.probe.get_topic_names_and_types()}
    documented = {line.split("|")[1].strip(" `") for line in TEXT.splitlines() if line.startswith("| `")}
    ours = {
        name.replace("robot_1", "<robot>").replace("lms_west", "<sensor>").replace("lms_east", "<sensor>")
        for name in named
    }
    ours = {name if name in ("/diagnostics", "/clock") else name.lstrip("/") for name in ours}
    of_ros = {name for name in ours if name.endswith(("rosout", "parameter_events", "transition_event"))}
    assert not ours - documented - of_ros
