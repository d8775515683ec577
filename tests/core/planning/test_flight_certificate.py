"""The check of paths in space lets a robot leave that stands too near, but towards nothing that is there now."""

from __future__ import annotations

import math

import numpy as np
import pytest

from snnav_core.area.grid import Grid
from snnav_core.area.spatial import SpatialArea
from snnav_core.flight_types import FlyerState
from snnav_core.planning.certificate import CertificateSettings
from snnav_core.planning.flight_certificate import certify_flight
from snnav_core.types import Certificate, RobotSpec, TimedPath

BEE = RobotSpec("bee", 0.2, 0.5, 2.0)
START = np.array([2.0, 1.37, 1.5])
WALL = 1.0  # its face [m, map, y]


def beside_a_wall() -> SpatialArea:
    """A known wall at y < 1 m, and something that may move 0.35 m above the robot: nearer than the margin."""
    grid = Grid(np.zeros(3), 0.1, (80, 40, 30))
    centres = grid.centres()
    static = np.maximum(centres[..., 1] - WALL, 0.0).astype(np.float32)
    above = np.linalg.norm(centres - START - np.array([0.0, 0.0, 0.9]), axis=-1) - 0.5
    return SpatialArea(0.0, grid, np.clip(above, 0.0, 2.0).astype(np.float32), static)


def fly(azimuth: float, elevation: float, links: int = 24) -> tuple[Certificate, TimedPath]:
    level = math.cos(elevation)
    ahead = np.array([level * math.cos(azimuth), level * math.sin(azimuth), math.sin(elevation)])
    path = TimedPath(0.0, 0.05, START + np.arange(links + 1)[:, None] * 0.025 * ahead)
    state = FlyerState("bee", START, ahead, 0.0)
    settings = CertificateSettings(0.4, 0.4, 0.2, 6, 0.01)
    return certify_flight(path, BEE, state, beside_a_wall(), (), settings), path


@pytest.mark.parametrize("angle_deg", [20.0, 30.0, 45.0, 52.0, 70.0])
def test_who_stands_too_near_to_one_thing_may_not_fly_at_a_wall(angle_deg: float) -> None:
    certificate, path = fly(-math.radians(angle_deg), -math.radians(10.0))
    if certificate.accepted:
        times = np.linspace(0.0, certificate.valid_until, 200)
        kept = path.positions_at(times)[:, 1] - WALL
        assert kept.min() >= certificate.least_clearance - 1e-6
        assert kept.min() >= 0.35 - 0.03  # no nearer than it was, by more than what cells leave open


def test_who_stands_too_near_may_leave() -> None:
    certificate, _ = fly(math.radians(40.0), -math.radians(40.0))
    assert certificate.accepted
