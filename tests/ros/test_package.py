"""The package that is imported is this one, under one version number."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from importlib.metadata import distribution, version
from pathlib import Path

import snnav_ros

MANIFEST = ElementTree.parse(Path(__file__).parents[2] / "snnav_ros" / "package.xml").getroot()


def test_manifest_metadata_and_module_agree_on_the_version() -> None:
    assert MANIFEST.findtext("name") == "snnav_ros"
    assert MANIFEST.findtext("version") == version("snnav_ros") == snnav_ros.__version__


def test_every_executable_loads() -> None:
    scripts = {entry.name: entry for entry in distribution("snnav_ros").entry_points}
    assert {
        "snnav",
        "lms200_node",
        "tof_node",
        "fusion_node",
        "planner_node",
        "tracker_node",
        "global_planner_node",
        "robot_node",
        "clock_node",
        "operator_node",
    } == scripts.keys()
    assert all(callable(entry.load()) for entry in scripts.values())
