"""The tables of parameters: ``python -m snnav_ros.parameter_tables docs/interfaces.md`` renews them there."""

from __future__ import annotations

import math
import re
import sys
from pathlib import Path
from typing import Any

__all__ = ["parameter_table", "parameter_tables", "replaced"]

_SENSOR, _CAMERA, _ROBOT = "lms_1", "tof_1", "robot_1"

# What each node must be given, so that it starts without a scene.
_EXAMPLES: dict[str, tuple[str, str, dict[str, Any]]] = {
    "lms200_node": ("lms200", "Lms200Node", {"scene": "hello", "sensor_id": "lms_west"}),
    "tof_node": ("tof", "TofNode", {"scene": "hello_flight", "sensor_id": "south_west"}),
    "fusion_node": (
        "fusion",
        "FusionNode",
        {
            "boundary_speed": 0.5,
            "sensors": [_SENSOR],
            f"{_SENSOR}.position": [0.0, 0.0],
            f"{_SENSOR}.heading_deg": 0.0,
        },
    ),
    "fusion_node in space": (
        "fusion",
        "FusionNode",
        {
            "boundary_speed": 0.5,
            "workspace": [0.0, 0.0, 0.0, 6.0, 5.0, 3.0],
            "sensors": [_CAMERA],
            f"{_CAMERA}.position": [0.1, 0.1, 2.9],
            f"{_CAMERA}.look_at": [3.0, 2.5, 1.0],
        },
    ),
    "planner_node": (
        "planner",
        "PlannerNode",
        {
            "sampling_interval": 1.0,
            "safety_margin": 0.5,
            "boundary_speed": 0.2,
            "robots": [_ROBOT],
            f"{_ROBOT}.radius": 0.3,
            f"{_ROBOT}.speed": 0.5,
            f"{_ROBOT}.max_turn_rate": 1.0,
        },
    ),
    "tracker_node": ("tracker", "TrackerNode", {}),
    "global_planner_node": (
        "global_planner",
        "GlobalPlannerNode",
        {
            "sampling_interval": 0.3,
            "safety_margin": 0.6,
            "robots": [_ROBOT],
            f"{_ROBOT}.radius": 0.3,
            f"{_ROBOT}.speed": 0.5,
            f"{_ROBOT}.max_turn_rate": 1.0,
        },
    ),
    "robot_node": ("robot", "RobotNode", {"robot_id": _ROBOT}),
    "clock_node": ("clock", "ClockNode", {}),
    "operator_node": ("operator", "OperatorNode", {"scene": "hello"}),
}

_OWN_OF_ROS = ("use_sim_time", "start_type_description_service")


def parameter_tables(context: Any = None) -> dict[str, str]:
    """Return the Markdown table of every node by the name of its executable."""
    from importlib import import_module

    from snnav_ros.nodes.base import NodeOptions

    tables = {}
    for executable, (module, class_name, given) in _EXAMPLES.items():
        options = NodeOptions(parameters=given, context=context, lean=True)
        node = getattr(import_module(f"snnav_ros.nodes.{module}"), class_name)(options)
        try:
            tables[executable] = parameter_table(node, given)
        finally:
            node.destroy_node()
    return tables


def parameter_table(node: Any, given: dict[str, Any]) -> str:
    """Return the Markdown table of the parameters of one node; those in `given` have no default to show."""
    names = [name for name in node.get_parameters_by_prefix("") if name not in _OWN_OF_ROS]
    rows = ["| parameter | type | default | range | meaning |", "|---|---|---|---|---|"]
    for name in sorted(names, key=lambda one: (one.startswith((_SENSOR, _CAMERA, _ROBOT)), "." in one, one)):
        descriptor, value = node.describe_parameter(name), node.get_parameter(name).value
        default = "" if name in given else _shown(value)
        shown = name.replace(f"{_SENSOR}.", "<sensor>.").replace(f"{_CAMERA}.", "<sensor>.")
        shown = shown.replace(f"{_ROBOT}.", "<robot>.")
        kind = descriptor.additional_constraints.removesuffix(", may stay unset")
        text = descriptor.description.replace("|", "\\|")
        rows.append(f"| `{shown}` | {kind} | {default} | {_range(descriptor)} | {text} |")
    return "\n".join(rows)


def _shown(value: Any) -> str:
    if value is None:
        return "unset"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return f"{value:g}"
    return (
        f"{value}" if isinstance(value, int) else f"`{list(value) if not isinstance(value, str) else value}`"
    )


def _range(descriptor: Any) -> str:
    for limits in (*descriptor.floating_point_range, *descriptor.integer_range):
        return f"{limits.from_value:g} to {limits.to_value:g}" if math.isfinite(limits.to_value) else ""
    return ""


def replaced(text: str, tables: dict[str, str]) -> str:
    """Return a Markdown text with the table below the heading of every node replaced."""
    for name, table in tables.items():
        pattern = re.compile(rf"(^### {name}\n\n)(?:\|.*\n)*", re.MULTILINE)
        text = pattern.sub(lambda match, table=table: f"{match.group(1)}{table}\n", text)
    return text


def main() -> None:
    """Print the tables, or put them into the files that are named as arguments."""
    import rclpy

    rclpy.init(args=[])
    tables = parameter_tables()
    rclpy.try_shutdown()
    for path in map(Path, sys.argv[1:]):
        path.write_text(replaced(path.read_text(encoding="utf-8"), tables), encoding="utf-8")
    if not sys.argv[1:]:
        print("\n\n".join(f"### {name}\n\n{table}" for name, table in tables.items()))


if __name__ == "__main__":
    main()
