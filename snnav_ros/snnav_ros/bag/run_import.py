"""What ``snnav import-carmen`` and ``snnav import-depth`` do."""

from __future__ import annotations

import argparse
import sys

from snnav_ros.bag.cameras_file import read_cameras
from snnav_ros.bag.carmen import read_carmen
from snnav_ros.bag.carmen_import import write_carmen_bag
from snnav_ros.bag.depth_import import write_depth_bag
from snnav_ros.bag.progress import counter
from snnav_ros.bag.settings import POSE_TOPIC, SCAN_TOPIC

__all__ = ["run", "run_depth"]


def run(arguments: argparse.Namespace) -> int:
    """Run ``snnav import-carmen``."""
    with counter("reading scans") as progress:
        log = read_carmen(arguments.log, progress)
    for warning in log.warnings:
        print(f"warning: {warning}", file=sys.stderr)
    with counter("writing scans", len(log.scans)) as progress:
        summary = write_carmen_bag(log, arguments.bag, progress)
    beams = " or ".join(map(str, summary.beams))
    width, height = summary.extent
    print(f"{summary.scans} {log.kind} scans of {beams} beams, {log.no_return}")
    print(f"{width:.1f} x {height:.1f} m, path {summary.path_length:.1f} m, {summary.duration:.1f} s")
    print(f"written: {arguments.bag} (topics {SCAN_TOPIC}, {POSE_TOPIC})")
    return 0


def run_depth(arguments: argparse.Namespace) -> int:
    """Run ``snnav import-depth``."""
    source = read_cameras(arguments.cameras)
    total = sum(len(entry.files) for entry in source.cameras)
    with counter("writing images", total) as progress:
        summaries = write_depth_bag(source, arguments.bag, progress)
    for each in summaries:
        print(
            f"{each.camera}: {each.images} images, {100 * each.valid:.1f} % of the pixels have a reading, "
            f"{each.nearest:.2f} to {each.farthest:.2f} m"
        )
    print(f"written: {arguments.bag} (topics sensors/*/points, sensors/*/camera_info, tf_static)")
    return 0
