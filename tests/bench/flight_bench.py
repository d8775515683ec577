"""Flying robots: what a decision takes, and the free region of 12 cameras, beside numpy and scipy alone."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from harness import Row, limited, milliseconds, repeat
from numpy.typing import NDArray
from scipy import ndimage
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from snnav_core.area.grid import Grid
from snnav_core.area.spatial_fusion import SpatialFusion
from snnav_core.sensing.depth import DepthImage
from snnav_core.types import FloatArray
from snnav_sim.configure_flight import spatial_fusion_settings
from snnav_sim.devices.tof import DepthDevice
from snnav_sim.scene import find_scene, load_any_scene
from snnav_sim.simulation_flight import FlightSimulation
from snnav_sim.space_types import DepthSensor, SpaceScene
from snnav_sim.space_world import SpaceWorld

SCENE = "thesis_ch4_four_robots"
DECISION_MS, CARVING_MS = 200.0, 60.0
ROBOTS = np.array([[5.0, 5.0, 1.5, 0.2], [8.0, 6.0, 2.0, 0.2]])


def benches() -> dict[str, Callable[[], list[Row]]]:
    """Title -> measurement."""
    return {
        "flight: free region of 12 ToF cameras, distances and nearest cells of 784,000 cells": carving_rows,
        "flight: decision for four robots, 14 x 14 x 4 m at 0.1 m, 3 cameras, delta 0.2 s": decision_rows,
    }


def hall() -> SpaceScene:
    """Return the hall of ch. 4 with four robots and three cameras."""
    scene = load_any_scene(find_scene(SCENE))
    assert isinstance(scene, SpaceScene)
    return scene


class Library:
    """The obvious way with numpy and scipy: project the centres, compare, transform the distance.

    Which pixel a centre falls into is worked out once. It claims cells that are not seen whole.
    """

    def __init__(self, sensors: tuple[DepthSensor, ...], grid: Grid) -> None:
        self.grid = grid
        centres = grid.centres().reshape(-1, 3)
        self.views = {sensor.id: self._view(sensor, centres) for sensor in sensors}

    def _view(
        self, sensor: DepthSensor, centres: FloatArray
    ) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float32]]:
        camera, model = sensor.camera, sensor.camera.model
        x, y, z = ((centres - camera.position) @ camera.rotation).T
        level = np.hypot(x, y)
        column = np.rint(model.column_centre - np.arctan2(y, x) / model.column_step).astype(np.int64)
        row = np.rint(model.row_centre - np.arctan2(z, level) / model.row_step).astype(np.int64)
        away = np.hypot(level, z) + self.grid.half_diagonal
        inside = (column >= 0) & (column < model.columns) & (row >= 0) & (row < model.rows)
        which = np.flatnonzero(inside & (away <= model.range_max))
        return which, row[which] * model.columns + column[which], away[which].astype(np.float32)

    def distances(self, images: dict[str, DepthImage]) -> tuple[FloatArray, NDArray[np.int32]]:
        """Return distance and nearest solid cell of every cell."""
        free = np.zeros(int(np.prod(self.grid.shape)), dtype=np.bool_)
        for name, (which, flat, away) in self.views.items():
            ranges = np.asarray(images[name].ranges, dtype=np.float32).ravel()[flat]
            free[which] |= ranges >= away
        found: tuple[FloatArray, NDArray[np.int32]] = ndimage.distance_transform_edt(
            free.reshape(self.grid.shape), sampling=self.grid.spacing, return_indices=True
        )
        return found


def carving_rows() -> list[Row]:
    """Measure from nothing known, the hardest case, and with what is remembered."""
    base = hall()
    eyes = tuple(
        replace(base.sensors[0], id=f"tof_{x:g}_{y:g}", position=(x, y, 3.9), look_at=(7.0, 7.0, 0.0))
        for x in (1.5, 5.2, 8.8, 12.5)
        for y in (2.0, 7.0, 12.0)
    )
    scene = replace(base, sensors=eyes, boundary_speed=0.2)
    world = SpaceWorld(scene)
    images = {eye.id: DepthDevice(eye, world, 1, lambda time: ROBOTS).scan(0.0) for eye in eyes}
    fusion = SpatialFusion([eye.camera for eye in eyes], spatial_fusion_settings(scene))
    stamps = iter(range(1, 10_000))

    def look(forget: bool) -> FloatArray:
        if forget:
            fusion.reset()
        stamp = 0.2 * next(stamps)
        for name, image in images.items():
            fusion.add_image(name, replace(image, stamp=stamp), ROBOTS)
        return fusion.area(stamp).moving

    library = Library(eyes, scene.grid)
    ours, theirs = look(True) > 0.0, library.distances(images)[0] > 0.0
    if (ours & ~theirs).mean() > 0.01 or ours.mean() < 0.5 * theirs.mean():
        raise RuntimeError("numpy sees another room")
    return [
        limited("snnav, nothing remembered (100 x 12 images)", repeat(lambda: look(True), 100), CARVING_MS),
        limited("snnav, as in a run (100 x 12 images)", repeat(lambda: look(False), 100), CARVING_MS),
        _peer("numpy, distance_transform_edt (10)", repeat(lambda: library.distances(images), 10, 1)),
    ]


def decision_rows() -> list[Row]:
    """Measure all steps of the run, one after the other."""
    scene = hall()
    _fly(scene, 3)
    wall, processor = _fly(scene)
    library = Library(scene.sensors, scene.grid)
    simulation = FlightSimulation(scene)
    images = {sensor.id: DepthDevice(sensor, simulation.world, 1).scan(0.0) for sensor in scene.sensors}
    ends = [(robot.start, robot.target) for robot in scene.robots]

    def by_library() -> None:
        away, _ = library.distances(images)
        ways = [_shortest(away >= scene.safety_margin, scene.grid, *pair) for pair in ends]
        if not all(ways):
            raise RuntimeError("scipy finds no way")

    return [
        limited(f"snnav, images in to certified paths out ({len(wall)} steps)", wall, DECISION_MS),
        Row("   of it the processor", milliseconds(processor)),
        _peer("numpy, distance_transform_edt, dijkstra from cell to cell (2)", repeat(by_library, 2, 0)),
    ]


def _fly(scene: SpaceScene, steps: int | None = None) -> tuple[FloatArray, FloatArray]:
    """Fly to the end, or some steps; wall clock and processor time of every step [s]."""
    simulation = FlightSimulation(scene)
    spent = [0.0]

    def timed(function: Callable[..., object]) -> Callable[..., object]:
        def call(*arguments: object) -> object:
            begin = time.process_time()
            result = function(*arguments)
            spent[-1] += time.process_time() - begin
            return result

        return call

    for owner, name in (
        (simulation.fusion, "add_image"),
        (simulation.fusion, "area"),
        (simulation.navigator, "step"),
    ):
        setattr(owner, name, timed(getattr(owner, name)))

    def progress(at: float, arrived: int) -> None:
        spent.append(0.0)

    if steps is None:
        record = simulation.run(progress)
        if record.reason != "all robots arrived":
            raise RuntimeError(f"the robots did not arrive: {record.reason}")
    else:
        for _ in range(steps):
            simulation.decide()
    record = simulation.record
    return np.add(record.fusion_seconds, record.planner_seconds), np.array(spent[:-1] or spent)


def _shortest(
    region: NDArray[np.bool_], grid: Grid, start: tuple[float, ...], goal: tuple[float, ...]
) -> bool:
    """Whether scipy finds a way between six neighbours."""
    number = np.full(region.shape, -1)
    number[region] = np.arange(int(region.sum()))
    pairs = []
    for axis in range(3):
        one, other = np.delete(number, -1, axis), np.delete(number, 0, axis)
        both = (one >= 0) & (other >= 0)
        pairs.append(np.column_stack((one[both], other[both])))
    edges = np.concatenate(pairs)
    size = int(region.sum())
    graph = csr_matrix((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(size, size))
    cells = [
        number[tuple(np.floor((np.array(p) - grid.origin) / grid.spacing).astype(int))] for p in (start, goal)
    ]
    return bool(np.isfinite(dijkstra(graph, directed=False, indices=cells[0])[cells[1]]))


def _peer(what: str, times: FloatArray) -> Row:
    return Row(what, milliseconds(times), float(np.median(times)), peer=True)
