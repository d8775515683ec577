"""Executable of the global planner node: `ros2 run snnav_ros global_planner_node`."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from snnav_ros.run import run_node

__all__ = ["main"]


def main(args: Sequence[str] | None = None) -> int:
    """Run the node until it is told to end; return the exit status."""
    return run_node("snnav_ros.nodes.global_planner", "GlobalPlannerNode", args, kernels=True)


if __name__ == "__main__":
    sys.exit(main())
