"""Bodies and velocities from simulated scanners with noise."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import shapely
import yaml

from snnav_core.area.fusion import AreaFusion
from snnav_core.area.tracks import ObstacleTracker, TrackedScene
from snnav_core.errors import InvalidInput
from snnav_sim.configure import planar_sensor
from snnav_sim.devices.factory import make_device
from snnav_sim.scene import parse_scene
from snnav_sim.world import World, mover_positions

INTERVAL = 0.3
SIZE = (12.0, 9.0)
BOX = [[-0.5, -0.4], [0.5, -0.4], [0.5, 0.4], [-0.5, 0.4]]


class Hall:
    """A hall of which up to four scanners in its corners measure bodies at rest and in motion."""

    def __init__(self, movers: list[dict[str, Any]], obstacles: list[Any], scanners: int, seed: int) -> None:
        width, height = SIZE
        corners = [
            (0.1, 0.1, 45),
            (width - 0.1, height - 0.1, 225),
            (width - 0.1, 0.1, 135),
            (0.1, height - 0.1, -45),
        ]
        sensors = [
            {
                "id": f"lms_{k}",
                "device": "lms200",
                "position": [x, y],
                "heading_deg": heading,
                "noise": "lms200",
            }
            | {"field_of_view_deg": 180, "resolution_deg": 0.5, "range_max": 20.0}
            for k, (x, y, heading) in enumerate(corners[:scanners])
        ]
        document = {
            "name": "hall",
            "seed": seed,
            "sampling_interval": INTERVAL,
            "safety_margin": 0.5,
            "robots": [],
        }
        document |= {"workspace": {"polygon": [[0, 0], [width, 0], [width, height], [0, height]]}}
        document |= {"movers": movers, "obstacles": obstacles, "sensors": sensors, "boundary_speed": 1.5}
        self.world = World(parse_scene(yaml.safe_dump(document), "hall"))
        self.devices = [make_device(sensor, self.world, seed) for sensor in self.world.scene.sensors]
        self.fusion = AreaFusion([planar_sensor(sensor) for sensor in self.world.scene.sensors])
        self.tracker = ObstacleTracker()

    def step(self, time: float) -> TrackedScene:
        """Measure and track."""
        for device in self.devices:
            self.fusion.add_scan(device.sensor.id, device.scan(time))
        return self.tracker.update(time, self.fusion.returns(time), self.fusion.area(time))


def test_velocities_of_a_disk_and_a_box() -> None:
    movers = [
        {"id": "disk", "circle": [0, 0, 0.4], "start": [3, 3], "velocity": [0.3, 0.1]},
        {"id": "box", "polygon": BOX, "start": [8, 5], "velocity": [-0.2, 0.0]},
    ]
    hall = Hall(movers, [{"circle": [6, 7, 0.5]}], 4, 1)
    scene = [hall.step(INTERVAL * k) for k in range(5)][-1]
    moving = [body for body in scene.obstacles if body.speed > 0.0]
    assert (len(scene.obstacles), len(moving)) == (3, 2)
    for mover in hall.world.scene.movers:
        place = shapely.Point(mover_positions(mover, scene.stamp)[0])
        body = next(body for body in moving if shapely.Polygon(body.outline).contains(place))
        error = np.hypot(*(body.velocity - np.array(mover.velocity)))
        assert error < 0.05 * mover.top_speed
        assert error < 5.0 * body.velocity_deviation


def test_time_goes_on() -> None:
    hall = Hall([], [], 1, 1)
    hall.step(1.0)
    with pytest.raises(InvalidInput, match="reset"):
        hall.step(1.0)
    hall.tracker.reset()
    hall.step(1.0)
