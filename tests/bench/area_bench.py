"""Unoccupied area from twelve scanners with robots removed, against the same from shapely alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import shapely
from harness import Row, limited, milliseconds, repeat

from snnav_core.area.fusion import AreaFusion, FusionSettings
from snnav_core.area.planar import remove_disks
from snnav_core.sensing.scan import PlanarScan
from snnav_core.types import FloatArray, Pose2D
from snnav_sim.configure import fusion_settings, planar_sensor
from snnav_sim.devices.lms200 import Lms200
from snnav_sim.scene import parse_scene
from snnav_sim.scene_types import Scene
from snnav_sim.world import World

LIMIT_MS = 30.0
CYCLES = 200
ROBOTS = np.array([[20.0, 12.0], [38.0, 22.0], [52.0, 30.0]])
RADII = np.array([0.3, 0.3, 0.3])

_POSES = [
    (1, 1, 45), (24, 1, 90), (46, 1, 90), (69, 1, 135), (69, 22, 180), (69, 44, 225),
    (46, 44, 270), (24, 44, 270), (1, 44, 315), (1, 22, 0), (30, 20, 0), (42, 25, 180),
]  # fmt: skip
_SENSORS = "\n".join(
    f"  - {{id: lms_{index}, device: lms200, position: [{x}, {y}], heading_deg: {heading}, field_of_view_deg: 180, "
    f"resolution_deg: 0.5, range_max: 32.0, noise: lms200}}"
    for index, (x, y, heading) in enumerate(_POSES)
)
SCENE = f"""
name: bench
description: a hall with machines and two walking people
sampling_interval: 1.0
boundary_speed: 0.5
safety_margin: 0.5
workspace: {{polygon: [[0, 0], [70, 0], [70, 45], [0, 45]]}}
obstacles:
  - {{polygon: [[10, 6], [14, 6], [14, 28], [10, 28]]}}
  - {{polygon: [[22, 28], [34, 28], [34, 34], [28, 34], [28, 38], [22, 38]]}}
  - {{polygon: [[33, 6], [40, 6], [40, 12], [36, 15], [33, 15]]}}
  - {{polygon: [[52, 12], [60, 10], [62, 18], [54, 20]]}}
  - {{polygon: [[48, 33], [60, 33], [60, 39], [48, 39]]}}
  - {{circle: [20, 20, 2.5]}}
  - {{circle: [47, 24, 1.5]}}
movers:
  - {{id: person_1, circle: [0, 0, 0.3], waypoints: [[17, 3], [17, 40]], speed: 0.5, loop: true}}
  - {{id: person_2, circle: [0, 0, 0.3], waypoints: [[44, 40], [44, 4]], speed: 0.5, loop: true}}
sensors:
{_SENSORS}
robots:
  - {{id: robot_1, start: [3, 20], heading_deg: 0, target: [66, 22], speed: 1.0, max_turn_rate: 1.0, radius: 0.3}}
"""


def shapely_alone(scans: list[PlanarScan], poses: list[Pose2D]) -> shapely.Geometry:
    """Return the union of the scans' polygons without the robots' disks: nothing is cut, nothing remembered."""
    polygons = []
    for scan, pose in zip(scans, poses, strict=True):
        bearings = pose.heading + scan.angle_min + scan.angle_increment * np.arange(scan.ranges.size)
        reach = np.where(np.isfinite(scan.ranges), scan.ranges, scan.range_max)
        ends = pose.position + reach[:, None] * np.column_stack([np.cos(bearings), np.sin(bearings)])
        polygons.append(shapely.make_valid(shapely.Polygon(np.vstack([pose.position, ends]))))
    disks = shapely.buffer(shapely.points(ROBOTS), RADII)
    return shapely.difference(shapely.union_all(polygons), shapely.union_all(disks))


def fusion_times(scene: Scene, recorded: list[list[PlanarScan]], settings: FusionSettings) -> FloatArray:
    """Time one cycle: twelve new scans to the area without the robots."""
    fusion = AreaFusion([planar_sensor(sensor) for sensor in scene.sensors], settings)
    cycles = iter(recorded)

    def cycle() -> object:
        scans = next(cycles)
        for sensor, scan in zip(scene.sensors, scans, strict=True):
            fusion.add_scan(sensor.id, scan)
        return remove_disks(fusion.area(scans[0].stamp).region, ROBOTS, RADII)

    return repeat(cycle, CYCLES)


def rows() -> list[Row]:
    """Measure both on the same scans."""
    scene = parse_scene(SCENE, "bench")
    world = World(scene)
    devices = [Lms200(sensor, world, seed=1) for sensor in scene.sensors]
    recorded = [[device.scan(float(t)) for device in devices] for t in range(CYCLES + 3)]
    if {scan.ranges.size for scan in recorded[0]} != {361}:
        raise RuntimeError("the scanners do not have 361 beams")
    still = replace(fusion_settings(scene), boundary_speed=0.0)
    poses = [sensor.pose for sensor in scene.sensors]
    theirs = iter(recorded)
    peer = repeat(lambda: shapely_alone(next(theirs), poses), CYCLES)
    alone = fusion_times(scene, recorded, still)
    remembered = fusion_times(scene, recorded, fusion_settings(scene))
    return [
        limited(f"snnav: union, returns cut ({CYCLES} cycles)", alone, LIMIT_MS),
        limited("snnav, with the memory of what was free", remembered, LIMIT_MS),
        Row("shapely: union alone", milliseconds(peer), float(np.median(peer)), peer=True),
    ]
