"""ToF camera simulation against trimesh's rays, on the same 504 triangles from the same place."""

from __future__ import annotations

import numpy as np
import trimesh
from harness import Row, repeat

from snnav_core.area.robots import RobotTrack
from snnav_core.flight_types import FlyerState
from snnav_core.types import FloatArray, RobotSpec
from snnav_sim.devices.tof import DepthDevice
from snnav_sim.raycast3d import cast_boxes, mesh_caster
from snnav_sim.scene_types import Circle
from snnav_sim.space_types import Body, Box, DepthSensor, Prism, SpaceMover, SpaceScene
from snnav_sim.space_world import SpaceWorld

BOXES = 42  # of 12 triangles each
DEMANDED = 200
SIZE = (14.0, 14.0, 4.0)


def scene() -> SpaceScene:
    """Return a hall with boxes, two people and one camera in a corner."""
    rng = np.random.default_rng(1)
    low = rng.uniform((1.0, 1.0, 0.0), (12.0, 12.0, 2.0), (BOXES, 3))
    size = rng.uniform(0.3, 1.5, (BOXES, 3))
    boxes = [Body(Box(tuple(a.tolist()), tuple((a + b).tolist()))) for a, b in zip(low, size, strict=True)]
    people = [
        SpaceMover(
            f"person_{k}", Prism(Circle(0.0, 0.0, 0.25), 0.0, 1.8), ((3.0, y, 0.0), (9.0, y, 0.0)), 0.5
        )
        for k, y in enumerate((4.0, 9.0))
    ]
    eye = DepthSensor("eye", "tof", (0.1, 0.1, 3.9), look_at=(7.0, 7.0, 1.0), noise="tof")
    return SpaceScene(
        "bench", 0.2, (0.0, 0.0, 0.0), SIZE, 0.5, (eye,), (), tuple(boxes), tuple(people), boundary_speed=0.5
    )


def per_second(what: str, times: FloatArray, peer: bool = False) -> Row:
    """Return a row in images per second."""
    rate = 1.0 / float(np.median(times))
    limit = "" if peer else f">= {DEMANDED} images/s"
    return Row(what, f"{rate:,.0f} images/s", 1.0 / rate, limit, not peer and rate < DEMANDED, peer)


def robots() -> list[RobotTrack]:
    """Two robots that hover."""
    tracks = []
    for name, place in (("one", (5.0, 5.0, 1.5)), ("two", (8.0, 6.0, 2.0))):
        tracks.append(RobotTrack(RobotSpec(name, 0.2, 0.7, 2.0)))
        for stamp in np.arange(0.0, 200.0, 2.0).tolist():
            tracks[-1].add_flyer(FlyerState(name, np.array(place), np.array([1.0, 0.0, 0.0]), stamp))
    return tracks


def rows() -> list[Row]:
    """Measure; all must see the same."""
    world = SpaceWorld(scene())
    camera = world.scene.sensors[0].camera
    rays = np.ascontiguousarray((camera.model.rays() @ camera.rotation.T).reshape(-1, 3))
    device = DepthDevice(world.scene.sensors[0], world, 1, robots())
    stamps = iter(range(10_000))
    mesh = trimesh.util.concatenate(
        [trimesh.creation.box(bounds=[box[:3], box[3:]]) for box in world.boxes.tolist()]
    )
    embree = mesh_caster(np.asarray(mesh.triangles))
    found = {}

    def by_boxes() -> None:
        found["boxes"] = np.full(len(rays), np.inf)
        cast_boxes(camera.position, rays, world.boxes, found["boxes"])

    def by_embree() -> None:
        found["embree"] = np.full(len(rays), np.inf)
        embree(camera.position, rays, found["embree"])

    origins = np.broadcast_to(camera.position, rays.shape)

    def by_trimesh() -> None:
        found["trimesh"] = np.full(len(rays), np.inf)
        places, which, _ = mesh.ray.intersects_location(origins, rays, multiple_hits=False)
        found["trimesh"][which] = np.linalg.norm(places - camera.position, axis=1)

    result = [
        per_second("snnav, 42 boxes anew every time (100 images)", repeat(by_boxes, 100)),
        per_second("snnav, embree on 504 triangles (100 images)", repeat(by_embree, 100)),
        per_second(
            "snnav ToF camera: noise, two people, two robots, standing bodies kept (100 images)",
            repeat(lambda: device.scan(0.2 * next(stamps)), 100),
        ),
        per_second("trimesh intersects_location (10 images)", repeat(by_trimesh, 10, 1), peer=True),
    ]
    for name in ("embree", "trimesh"):
        same = np.isclose(found[name], found["boxes"], atol=1e-3)
        if (same | (found[name] == found["boxes"])).mean() < 0.999:
            raise RuntimeError(f"{name} sees another world")
    return result
