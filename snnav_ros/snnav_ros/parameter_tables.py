"""The tables of parameters in docs/interfaces.md: ``python -m snnav_ros.parameter_tables`` prints them."""

from __future__ import annotations

import math
from typing import Any

__all__ = ["parameter_table", "parameter_tables"]

_SENSOR, _ROBOT = "lms_1", "robot_1"

# What each node must be given, so that it starts without a scene.
_EXAMPLES: dict[str, tuple[str, str, dict[str, Any]]] = {
    "lms200_node": ("lms200", "Lms200Node", {"scene": "hello", "sensor_id": "lms_west"}),
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
    "robot_node": ("robot", "RobotNode", {"robot_id": _ROBOT}),
    "clock_node": ("clock", "ClockNode", {}),
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
    for name in sorted(names, key=lambda one: (one.startswith((_SENSOR, _ROBOT)), "." in one, one)):
        descriptor, value = node.describe_parameter(name), node.get_parameter(name).value
        default = "" if name in given else _shown(value)
        shown = name.replace(f"{_SENSOR}.", "<sensor>.").replace(f"{_ROBOT}.", "<robot>.")
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


def _print() -> None:
    import rclpy

    rclpy.init(args=[])
    for name, table in parameter_tables().items():
        print(f"### {name}\n\n{table}\n")
    rclpy.try_shutdown()


if __name__ == "__main__":
    _print()
