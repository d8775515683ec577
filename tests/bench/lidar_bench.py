"""LMS-200 simulation against ir-sim's scanner, on the same 200 segments from the same places."""

from __future__ import annotations

import contextlib
import io
import math
import tempfile
from pathlib import Path

import numpy as np
from harness import Row, absent, repeat

from snnav_core.types import FloatArray
from snnav_sim.devices.lms200 import Lms200
from snnav_sim.raycast import cast
from snnav_sim.scene import parse_scene
from snnav_sim.scene_types import Scene
from snnav_sim.world import World

BOXES = 49  # and the border of the workspace: 200 segments
BEAMS = 361
DEMANDED = 20_000
SIZE = 40.0


def box_corners(rng: np.random.Generator) -> FloatArray:
    """Return boxes that stand at random inside the cells of a grid, shape (49, 4, 2) [m]."""
    cells = np.stack(np.meshgrid(np.arange(7), np.arange(7)), axis=-1).reshape(-1, 2)
    centres = (cells + 0.5 + rng.uniform(-0.1, 0.1, cells.shape)) * SIZE / 7
    angles = rng.uniform(0.0, np.pi, BOXES)
    half = rng.uniform(0.4, 1.2, (BOXES, 2))
    signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    local = signs * half[:, None, :]
    turn = np.stack(
        [np.stack([np.cos(angles), np.sin(angles)], -1), np.stack([-np.sin(angles), np.cos(angles)], -1)], -2
    )
    return centres[:, None, :] + local @ turn


def scene_of(boxes: FloatArray, noise: str) -> Scene:
    """Return a square hall with the boxes and one scanner in the middle of a cell corner."""
    obstacles = "\n".join(f"  - {{polygon: {np.round(box, 6).tolist()}}}" for box in boxes)
    return parse_scene(
        f"""
name: bench
description: one scanner among boxes
sampling_interval: 1.0
safety_margin: 0.5
workspace: {{polygon: [[0, 0], [{SIZE}, 0], [{SIZE}, {SIZE}], [0, {SIZE}]]}}
obstacles:
{obstacles}
sensors:
  - {{id: lms, device: lms200, position: [{SIZE * 3 / 7}, {SIZE * 3 / 7}], heading_deg: 90, field_of_view_deg: 180,
      resolution_deg: 0.5, range_max: 32.0, noise: {noise}}}
robots:
  - {{id: robot, start: [0.6, 0.6], heading_deg: 0, target: [39, 0.6], speed: 1.0, max_turn_rate: 1.0, radius: 0.3}}
""",
        "bench",
    )


def per_second(what: str, times: FloatArray, peer: bool = False) -> Row:
    """Return a row in scans per second."""
    rate = 1.0 / float(np.median(times))
    limit = "" if peer else f">= {DEMANDED:,} scans/s"
    return Row(what, f"{rate:,.0f} scans/s", 1.0 / rate, limit, not peer and rate < DEMANDED, peer)


def irsim_times(boxes: FloatArray, ours: FloatArray) -> FloatArray | None:
    """Time ir-sim's scanner; its ranges must agree with ours."""
    try:
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            import irsim  # tells at length which drawing libraries it has not found
    except ImportError:
        return None
    corners = [[0.0, 0.0], [SIZE, 0.0], [SIZE, SIZE], [0.0, SIZE], [0.0, 0.0]]
    outlines = "\n".join(
        f"  - {{shape: {{name: polygon, vertices: {np.round(box, 6).tolist()}}}, state: [0, 0, 0]}}"
        for box in boxes
    )
    world = f"""
world: {{height: {SIZE}, width: {SIZE}, collision_mode: unobstructed}}
robot:
  - {{kinematics: {{name: diff}}, shape: {{name: circle, radius: 0.01}},
     state: [{SIZE * 3 / 7}, {SIZE * 3 / 7}, {math.pi / 2}],
     sensors: [{{name: lidar2d, range_min: 0, range_max: 32, angle_range: {math.pi}, number: {BEAMS}}}]}}
obstacle:
  - {{shape: {{name: linestring, vertices: {corners}}}, state: [0, 0, 0]}}
{outlines}
"""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "world.yaml"
        path.write_text(world, encoding="utf-8")
        environment = irsim.make(str(path), headless=True, log_level="ERROR")
    lidar, state = environment.robot.lidar, environment.robot.state
    times = repeat(lambda: lidar.step(state), 300)
    off = np.abs(lidar.range_data - np.minimum(ours, 32.0))
    if np.median(off) > 1e-3:
        raise RuntimeError(f"ir-sim sees another world: median difference {np.median(off):.3f} m")
    return times


def rows() -> list[Row]:
    """Measure; the ranges of both must agree."""
    boxes = box_corners(np.random.default_rng(1))
    scene = scene_of(boxes, "none")
    world, sensor = World(scene), scene.sensors[0]
    segments, circles = world.static_segments, world.static_circles
    if segments.shape[0] != 4 * BOXES + 4 or sensor.beams != BEAMS:
        raise RuntimeError(f"{segments.shape[0]} segments and {sensor.beams} beams, expected 200 and {BEAMS}")

    def scan() -> FloatArray:
        return cast(
            sensor.position,
            sensor.heading,
            sensor.angle_min,
            sensor.resolution,
            BEAMS,
            segments,
            circles,
            sensor.range_max,
        )

    result = [per_second("snnav, all segments every time (3,000 scans)", repeat(scan, 3000))]
    noisy = scene_of(boxes, "lms200")
    device = Lms200(noisy.sensors[0], World(noisy), seed=1)
    stamps = iter(range(10_000))
    times = repeat(lambda: device.scan(float(next(stamps))), 3000)
    result.append(per_second("snnav LMS-200 with its noise, standing walls kept", times))
    peer = irsim_times(boxes, scan())
    result.append(
        absent("ir-sim") if peer is None else per_second("ir-sim lidar2d (300 scans)", peer, peer=True)
    )
    return result
