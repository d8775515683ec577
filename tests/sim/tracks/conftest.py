"""A hall with scanners in its corners, and bodies at random in it."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import shapely
import yaml

from snnav_core.area.fusion import AreaFusion
from snnav_core.area.planar import UnoccupiedArea
from snnav_core.area.returns import FusedReturns
from snnav_core.area.tracks import ObstacleTracker, TrackedScene, TrackerSettings
from snnav_core.types import FloatArray
from snnav_sim.configure import planar_sensor
from snnav_sim.devices.factory import make_device
from snnav_sim.scene import parse_scene
from snnav_sim.world import World, mover_positions, solid

INTERVAL = 0.3
SIZE = (12.0, 9.0)
_CORNERS = ((0.1, 0.1, 45), (11.9, 8.9, 225), (11.9, 0.1, 135), (0.1, 8.9, -45))
_GAP = 0.25  # [m] between bodies


class Hall:
    """A hall of which up to four LMS-200 in its corners measure, with noise, bodies at rest and in motion."""

    def __init__(
        self,
        movers: list[dict[str, Any]],
        obstacles: list[dict[str, Any]],
        scanners: int = 4,
        seed: int = 1,
        drop_out: float = 0.0,
    ) -> None:
        width, height = SIZE
        device = {"device": "lms200", "noise": "lms200", "field_of_view_deg": 180, "resolution_deg": 0.5}
        sensors = [
            {"id": f"lms_{k}", "position": [x, y], "heading_deg": heading, "range_max": 20.0, **device}
            | {"drop_out": drop_out}
            for k, (x, y, heading) in enumerate(_CORNERS[:scanners])
        ]
        document = {"name": "hall", "sampling_interval": INTERVAL, "safety_margin": 0.5, "robots": []}
        document |= {"workspace": {"polygon": [[0, 0], [width, 0], [width, height], [0, height]]}}
        document |= {"movers": movers, "obstacles": obstacles, "sensors": sensors, "boundary_speed": 1.5}
        self.world = World(parse_scene(yaml.safe_dump(document), "hall"))
        self.movers = self.world.scene.movers
        self.devices = [make_device(sensor, self.world, seed) for sensor in self.world.scene.sensors]
        self.fusion = AreaFusion([planar_sensor(sensor) for sensor in self.world.scene.sensors])
        self.tracker = ObstacleTracker(TrackerSettings())
        self.least_hits = {mover.id: math.inf for mover in self.movers}
        self.area: UnoccupiedArea
        self.returns: FusedReturns

    def step(self, time: float) -> TrackedScene:
        """Measure and track."""
        for device in self.devices:
            self.fusion.add_scan(device.sensor.id, device.scan(time))
        self.area, self.returns = self.fusion.area(time), self.fusion.returns(time)
        for name, body in self.bodies(time).items():
            hits = int((shapely.distance(shapely.points(self.returns.points), body) < 0.03).sum())
            self.least_hits[name] = min(self.least_hits[name], hits)
        return self.tracker.update(time, self.returns, self.area)

    def bodies(self, time: float) -> dict[str, shapely.Polygon]:
        """True moving bodies at a time [s]."""
        found = {}
        for mover in self.movers:
            x, y = mover_positions(mover, time)[0]
            found[mover.id] = shapely.affinity.translate(solid(mover.shape), x, y)
        return found


def _shape(rng: np.random.Generator) -> tuple[dict[str, Any], float]:
    """Return a disk, box, triangle or an L about its origin, and its radius."""
    kind = int(rng.integers(4))
    if kind == 0:
        radius = float(rng.uniform(0.2, 0.6))
        return {"circle": [0.0, 0.0, radius]}, radius
    length, width = rng.uniform(0.5, 1.3), rng.uniform(0.4, 1.0)
    corners = (
        np.array([[-length, -width], [length, -width], [length, width], [-length, width]]) / 2.0,
        length * np.array([[-0.5, -0.3], [0.5, -0.3], [0.1, 0.6]]),
        length * (np.array([[0, 0], [1, 0], [1, 0.4], [0.4, 0.4], [0.4, 1], [0, 1]]) - 0.4),
    )[kind - 1]
    angle = rng.uniform(0.0, 2.0 * math.pi)
    turn = np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])
    turned: FloatArray = corners @ turn
    return {"polygon": turned.tolist()}, float(np.hypot(*turned.T).max())


def _moved(shape: dict[str, Any], place: FloatArray) -> dict[str, Any]:
    if "circle" in shape:
        return {"circle": [*place.tolist(), shape["circle"][2]]}
    return {"polygon": (np.array(shape["polygon"]) + place).tolist()}


def random_hall(
    seed: int, moving: int = 3, standing: int = 3, scanners: int = 0, drop_out: float = 0.0
) -> Hall:
    """Return a hall in which bodies of 0.2 to 1 m/s keep clear of each other for 2.1 s; 2 to 4 scanners unless told."""
    rng = np.random.default_rng(seed)
    count = scanners or int(rng.integers(2, 5))
    movers: list[dict[str, Any]] = []
    obstacles: list[dict[str, Any]] = []
    ways = [shapely.Point(x, y).buffer(0.8) for x, y, _ in _CORNERS[:count]]
    hall = shapely.box(0.0, 0.0, *SIZE)
    while len(movers) + len(obstacles) < moving + standing:
        shape, radius = _shape(rng)
        place, angle = rng.uniform((0.0, 0.0), SIZE), rng.uniform(0.0, 2.0 * math.pi)
        speed = rng.uniform(0.2, 1.0) if len(movers) < moving else 0.0
        velocity = speed * np.array([math.cos(angle), math.sin(angle)])
        way = shapely.LineString([place, place + 2.1 * velocity + 1e-6]).buffer(radius + _GAP)
        if not hall.contains(way) or any(way.intersects(other) for other in ways):
            continue
        ways.append(way)
        if len(movers) < moving:
            body = {"id": f"m{len(movers)}", "start": place.tolist(), "velocity": velocity.tolist()}
            movers.append(body | shape)
        else:
            obstacles.append(_moved(shape, place))
    return Hall(movers, obstacles, count, seed, drop_out)


@pytest.fixture
def make_hall() -> Callable[..., Hall]:
    """Return the hall with given bodies."""
    return Hall


@pytest.fixture
def make_random_hall() -> Callable[..., Hall]:
    """Return the hall with bodies at random."""
    return random_hall
