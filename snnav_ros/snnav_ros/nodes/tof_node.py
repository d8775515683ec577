"""Executable of the node of a simulated depth camera: `ros2 run snnav_ros tof_node`."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from snnav_ros.run import run_node

__all__ = ["main"]


def main(args: Sequence[str] | None = None) -> int:
    """Run the node until it is told to end; return the exit status."""
    return run_node("snnav_ros.nodes.tof", "TofNode", args)


if __name__ == "__main__":
    sys.exit(main())
