"""Scenes that the tests of the simulator share."""

from __future__ import annotations

import pytest

from snnav_sim.scene import Scene, parse_scene

EXAMPLE = """\
name: factory
description: one line
seed: 1
sampling_interval: 1.0
control_period: 0.05
time_window: 4
boundary_speed: 0.5
safety_margin: 1.0
time_limit: 300.0
workspace: {polygon: [[0, 0], [70, 0], [70, 45], [0, 45]]}
obstacles:
  - {polygon: [[10, 5], [14, 5], [14, 30], [10, 30]]}
  - {circle: [40, 20, 2.5]}
movers:
  - {id: person_1, circle: [0, 0, 0.3], waypoints: [[20, 5], [20, 40]], speed: 0.4, loop: true}
  - {id: cart_1, polygon: [[-1, -1], [1, -1], [1, 1], [-1, 1]], start: [50, 10], velocity: [0.0, 0.3]}
sensors:
  - {id: lms_1, device: lms200, position: [2, 2], heading_deg: 45, field_of_view_deg: 180, resolution_deg: 0.5,
     range_max: 15.0, noise: none}
robots:
  - {id: robot_1, start: [3, 22], heading_deg: 0, target: [66, 22], speed: 1.0, max_turn_rate: 0.5, radius: 0.3}
"""

ROOM = """\
name: room
sampling_interval: 0.5
safety_margin: 0.5
workspace: {polygon: [[0, 0], [10, 0], [10, 8], [0, 8]]}
obstacles: [{polygon: [[4, 3], [6, 3], [6, 5], [4, 5]]}]
sensors:
  - {id: a, device: lms200, position: [1, 4], heading_deg: 0, field_of_view_deg: 360, resolution_deg: 1, range_max: 30}
  - {id: b, device: lms200, position: [9, 4], heading_deg: 0, field_of_view_deg: 360, resolution_deg: 1, range_max: 30}
robots:
  - {id: r, start: [2, 2], heading_deg: 0, target: [8, 2], speed: 1.0, max_turn_rate: 1.0, radius: 0.2}
"""

RECORDED = """\
name: network
sampling_interval: 0.5
safety_margin: 0.4
workspace: {polygon: [[-1, -1], [5, -1], [5, 5], [-1, 5]]}
sensors:
  - {id: node_1, device: recorded, position: [0, 0], heading_deg: 0, angle_min_deg: 0, resolution_deg: 45,
     range_max: 8, ranges: [4, 5.5, 4]}
  - {id: node_2, device: recorded, position: [4, 4], heading_deg: 180, angle_min_deg: 0, resolution_deg: 45,
     range_max: 8, ranges: [4.1, .nan, 4.1]}
robots: []
"""


@pytest.fixture
def example_text() -> str:
    """The scene of the contract, word for word."""
    return EXAMPLE


@pytest.fixture
def example() -> Scene:
    return parse_scene(EXAMPLE, "example.yaml")


@pytest.fixture
def room() -> Scene:
    """A room of 10 x 8 m with a block of 2 x 2 m in its middle and no noise."""
    return parse_scene(ROOM, "room.yaml")


@pytest.fixture
def recorded() -> Scene:
    return parse_scene(RECORDED, "recorded.yaml")
