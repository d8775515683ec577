"""The launch files, on stand-ins for `launch` where it is not installed: their nodes start with their parameters."""

from __future__ import annotations

import importlib.util
import sys
import types
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from snnav_core.errors import SnnavError
from snnav_ros.nodes.clock import ClockNode
from snnav_ros.nodes.fusion import FusionNode
from snnav_ros.nodes.global_planner import GlobalPlannerNode
from snnav_ros.nodes.lms200 import Lms200Node
from snnav_ros.nodes.operator import OperatorNode
from snnav_ros.nodes.planner import PlannerNode
from snnav_ros.nodes.robot import RobotNode
from snnav_ros.nodes.tof import TofNode
from snnav_ros.nodes.tracker import TrackerNode
from snnav_sim.scene import Retarget, dump_scene, find_scene, load_scene

FOLDER = Path(__file__).parents[2] / "snnav_ros" / "launch"
CONFIG = FOLDER.parent / "config" / "network.yaml"
KINDS = {
    "lms200_node": Lms200Node,
    "tof_node": TofNode,
    "fusion_node": FusionNode,
    "planner_node": PlannerNode,
    "tracker_node": TrackerNode,
    "global_planner_node": GlobalPlannerNode,
    "robot_node": RobotNode,
    "clock_node": ClockNode,
    "operator_node": OperatorNode,
}


class Part:
    """Any part of a launch description: keeps what it was made with."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        self.args, self.kwargs = args, kwargs

    def perform(self, context: dict[str, str]) -> str:
        return context[self.args[0]]


@pytest.fixture
def launch_file(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Load a launch file with stand-ins for the packages it imports."""
    names = {
        "launch": ("LaunchContext", "LaunchDescription"),
        "launch.actions": ("DeclareLaunchArgument", "OpaqueFunction", "Shutdown"),
        "launch.conditions": ("IfCondition",),
        "launch.substitutions": ("LaunchConfiguration", "PathJoinSubstitution"),
        "launch_ros": (),
        "launch_ros.actions": ("Node",),
        "launch_ros.substitutions": ("FindPackageShare",),
    }
    for module_name, classes in names.items():
        module = types.ModuleType(module_name)
        for name in classes:
            setattr(module, name, type(name, (Part,), {}))
        monkeypatch.setitem(sys.modules, module_name, module)

    def load(name: str) -> Any:
        spec = importlib.util.spec_from_file_location(name.replace(".", "_"), FOLDER / name)
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module

    return load


def arguments_of(description: Any) -> dict[str, Any]:
    parts = [part for part in description.args[0] if type(part).__name__ == "DeclareLaunchArgument"]
    return {part.args[0]: part.kwargs["default_value"] for part in parts}


def brought_up(graph: Any, nodes: list[Any]) -> dict[str, Any]:
    """Make the nodes of a launch file in this process; return them by their names."""
    made = {}
    for node in nodes:
        (parameters,) = node.kwargs["parameters"]
        name = node.kwargs["name"]
        made[name] = graph.add(KINDS[node.kwargs["executable"]], name, **parameters)
    return made


@pytest.mark.parametrize("lockstep", ["false", "true"])
def test_scene_brings_up_its_nodes(launch_file: Any, graph: Any, lockstep: str) -> None:
    module = launch_file("scene.launch.py")
    context = {**arguments_of(module.generate_launch_description()), "lockstep": lockstep, "rate": "50.0"}
    nodes = module.scene_nodes(context)
    assert [node.kwargs["name"] for node in nodes] == [
        "lms_west", "lms_east", "fusion_node", "planner_node", "robot_1", "clock_node",
    ]  # fmt: skip
    made = brought_up(graph, nodes)
    graph.until(lambda: made["clock_node"].time > 3.0)
    graph.until(lambda: made["robot_1"]._body._base.pose.x > 1.3, "the robot to drive")


def test_scene_in_space_brings_up_its_nodes(launch_file: Any, graph: Any) -> None:
    module = launch_file("scene.launch.py")
    context = arguments_of(module.generate_launch_description())
    nodes = module.scene_nodes({**context, "scene": "hello_flight", "lockstep": "true"})
    assert [node.kwargs["executable"] for node in nodes] == [
        *["tof_node"] * 4, "fusion_node", "planner_node", "robot_node", "clock_node",
    ]  # fmt: skip
    made = brought_up(graph, nodes)
    graph.until(lambda: made["bee"]._body._base.state.speed > 0.0, "the robot to fly")


def test_scene_where_nothing_is_planned_needs_no_fusion(launch_file: Any) -> None:
    module = launch_file("scene.launch.py")
    context = arguments_of(module.generate_launch_description())
    nodes = module.scene_nodes({**context, "scene": "thesis_ch4_tracking"})
    assert [node.kwargs["executable"] for node in nodes] == ["robot_node", "clock_node"]


def test_scene_with_the_global_planner_brings_up_tracker_and_global_planner(
    launch_file: Any, graph: Any, tmp_path: Path
) -> None:
    hello = replace(load_scene(find_scene("hello")), planner="global", obstacles=())
    file = tmp_path / "scene.yaml"
    file.write_text(dump_scene(hello), encoding="utf-8")
    module = launch_file("scene.launch.py")
    context = arguments_of(module.generate_launch_description())
    nodes = module.scene_nodes({**context, "scene": str(file), "lockstep": "true"})
    assert [node.kwargs["name"] for node in nodes][2:] == [
        "fusion_node", "tracker_node", "global_planner_node", "robot_1", "clock_node",
    ]  # fmt: skip
    made = brought_up(graph, nodes)
    graph.until(lambda: made["robot_1"]._body._base.pose.x > 1.5, "the robot to drive")


def test_several_planners_and_an_operator_where_the_scene_asks_for_them(
    launch_file: Any, graph: Any, tmp_path: Path
) -> None:
    hello = load_scene(find_scene("hello"))
    (first,) = hello.robots
    first = replace(first, retargets=(Retarget(1.5, (2.0, 4.8)),))
    second = replace(first, id="late", start=(8.5, 1.0), target=(7.0, 1.0), joins_at=1.0, retargets=())
    file = tmp_path / "scene.yaml"
    file.write_text(dump_scene(replace(hello, robots=(first, second))), encoding="utf-8")
    module = launch_file("scene.launch.py")
    context = arguments_of(module.generate_launch_description())
    nodes = module.scene_nodes({**context, "scene": str(file), "lockstep": "true", "planners": "2"})
    assert [node.kwargs["name"] for node in nodes][2:] == [
        "fusion_node", "planner_1", "planner_2", "robot_1", "late", "operator_node", "clock_node",
    ]  # fmt: skip
    made = brought_up(graph, nodes)
    graph.until(lambda: made["clock_node"].time > 4.0)
    assert made["planner_1"]._goals["robot_1"] == (2.0, 4.8)
    assert set(made["planner_2"].robots) == {"robot_1", "late"}
    assert made["late"]._body._base.pose.x < 8.0


@pytest.mark.parametrize(
    ("planner", "planners"),
    [("local", ["planner_node"]), ("global", ["tracker_node", "global_planner_node"])],
)
def test_network_brings_up_fusion_planner_and_robots(
    launch_file: Any, tmp_path: Path, planner: str, planners: list[str]
) -> None:
    config = tmp_path / "site.yaml"
    config.write_text("{}", encoding="utf-8")
    module = launch_file("network.launch.py")
    context = {
        **arguments_of(module.generate_launch_description()),
        "config": str(config),
        "robots": "cart_1,cart_2",
        "planner": planner,
        "remap": "/a/scan=sensors/a/scan,/b/scan=sensors/b/scan",
    }
    nodes = module.network_nodes(context)
    assert [(node.kwargs["executable"], node.kwargs["name"]) for node in nodes] == [
        ("fusion_node", "fusion_node"),
        *((name, name) for name in planners),
        ("robot_node", "cart_1"),
        ("robot_node", "cart_2"),
    ]
    assert nodes[0].kwargs["parameters"] == [str(config)]
    assert nodes[0].kwargs["remappings"] == [("sensors/a/scan", "/a/scan"), ("sensors/b/scan", "/b/scan")]


@pytest.mark.parametrize(
    ("name", "argument", "value", "said"),
    [
        ("scene.launch.py", "scene", "helo", "did you mean hello"),
        ("scene.launch.py", "rate", "fast", "rate:=fast is no number"),
        ("scene.launch.py", "planners", "two", "planners:=two is no number"),
        ("scene.launch.py", "planners", "2", "2 planners for 1 robots; give 1 to 1"),
        ("network.launch.py", "config", "nowhere.yaml", "config:=nowhere.yaml is no file"),
        ("network.launch.py", "remap", "/a/scan", "/a/scan is no pair; write driver_topic=our_topic"),
    ],
)
def test_mistake_in_an_argument_is_named_before_any_node_starts(
    launch_file: Any, name: str, argument: str, value: str, said: str
) -> None:
    module = launch_file(name)
    description = module.generate_launch_description()
    context = {**arguments_of(description), argument: value}
    if argument != "config":
        context["config"] = str(CONFIG)
    (nodes,) = [part for part in description.args[0] if type(part).__name__ == "OpaqueFunction"]
    with pytest.raises((ValueError, SnnavError), match=said):
        nodes.kwargs["function"](context)


@pytest.mark.parametrize("name", ["scene.launch.py", "network.launch.py"])
def test_rviz_is_looked_for_before_any_node_starts(launch_file: Any, name: str) -> None:
    """Where it is missing, launch fails at once and would leave behind what it has started."""
    parts = launch_file(name).generate_launch_description().args[0]
    kinds = [type(part).__name__ for part in parts]
    assert kinds.index("Node") < kinds.index("OpaqueFunction")
