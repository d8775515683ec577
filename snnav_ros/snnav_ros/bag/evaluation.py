"""Drive through real buildings: log -> bag -> network -> closed loop, ten routes in each building."""

from __future__ import annotations

import multiprocessing
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from shapely.geometry.base import BaseGeometry

from snnav_core.errors import PlanningError
from snnav_core.types import FloatArray, StopReason
from snnav_ros.bag.carmen import read_carmen
from snnav_ros.bag.carmen_import import write_carmen_bag
from snnav_ros.bag.errors import LogError
from snnav_ros.bag.margins import MarginCheck, recorded_returns
from snnav_ros.bag.network import (
    SensorNetwork,
    build_network,
    choose_evenly,
    read_posed_scans,
)
from snnav_ros.bag.routes import Route, pick_routes, robots_on_routes
from snnav_ros.bag.settings import POSE_TOPIC, SCAN_TOPIC, EvaluationSettings, NetworkSettings
from snnav_sim.report.optimum import reduced, shortest_path
from snnav_sim.report.record import RunRecord
from snnav_sim.scene import Scene
from snnav_sim.simulation import simulate

__all__ = ["Building", "BuildingResult", "PairResult", "evaluate", "name_of"]


@dataclass(frozen=True)
class Building:
    """A log made ready: its network, the routes, the exactly reduced area for the optimum, warnings on the way."""

    name: str
    scan_count: int
    settings: NetworkSettings
    network: SensorNetwork
    routes: tuple[Route, ...]
    reduced_area: BaseGeometry
    warnings: tuple[str, ...]

    def scene(self, pair: int) -> Scene:
        """Return the scene of one route, counted from 1."""
        robots = robots_on_routes([self.routes[pair - 1]], self.settings)
        return replace(self.network.scene, robots=robots)


@dataclass(frozen=True)
class PairResult:
    """What came of one route; lengths in m, times in s, positions in the map.

    Clearances are lower bounds along the whole motion, from the robot's centre; violations count the control periods
    during which it was nearer than the safety margin.
    """

    building: str
    pair: int
    start_x: float
    start_y: float
    heading: float
    target_x: float
    target_y: float
    straight_distance: float
    reached: bool
    reason: str
    message: str
    duration: float
    travelled_length: float
    optimum_length: float | None
    ratio: float | None
    area_clearance: float
    return_clearance: float
    area_violations: int
    return_violations: int
    step_ms: float
    rows: FloatArray = field(repr=False, compare=False)
    planner_ms: FloatArray = field(repr=False, compare=False)


@dataclass(frozen=True)
class BuildingResult:
    """All routes of one building."""

    building: Building
    pairs: tuple[PairResult, ...]

    @property
    def reached(self) -> int:
        """Number of routes whose target was reached."""
        return sum(pair.reached for pair in self.pairs)

    @property
    def failures(self) -> dict[str, int]:
        """Typed reasons of the routes that were not reached."""
        return dict(Counter(pair.reason for pair in self.pairs if not pair.reached))

    @property
    def violations(self) -> int:
        """Control periods nearer than the safety margin to the fused area or to a return, counted for both."""
        return sum(pair.area_violations + pair.return_violations for pair in self.pairs)

    @property
    def ratios(self) -> list[float]:
        """Driven length over the shortest path in the reduced area, of the routes that were reached."""
        return [pair.ratio for pair in self.pairs if pair.ratio is not None]

    @property
    def planner_ms(self) -> FloatArray:
        """Duration of every planning step but the first of each run [ms]."""
        return np.concatenate([pair.planner_ms for pair in self.pairs])


def name_of(log: Path) -> str:
    """Return the name of the building: the file name without its endings."""
    return log.name.removesuffix(".gz").removesuffix(".log").removesuffix("-corrected")


def evaluate(
    logs: Sequence[Path],
    settings: EvaluationSettings,
    jobs: int = 1,
    progress: Callable[[int], None] | None = None,
) -> list[BuildingResult]:
    """Run all routes of all logs.

    Parameters
    ----------
    logs : sequence of path
        Corrected CARMEN logs.
    settings : EvaluationSettings
    jobs : int
        Number of processes.
    progress : callable, optional
        Called with the number of steps done: one for every building made ready, one for every route.

    Returns
    -------
    list of BuildingResult
        In the order of the logs; independent of the number of processes.

    Raises
    ------
    SnnavError
        If a log cannot be used.
    """
    names = [name_of(log) for log in logs]
    for name, count in Counter(names).items():
        if count > 1:
            raise LogError(f"{name}: given {count} times; give every log once")
    results: dict[str, list[PairResult]] = {name: [] for name in names}
    buildings: dict[str, Building] = {}
    for done, item in enumerate(_work(logs, settings, jobs), start=1):
        if isinstance(item, Building):
            buildings[item.name] = item
        else:
            results[item.building].append(item)
        if progress is not None:
            progress(done)
    ordered = {name: sorted(pairs, key=lambda pair: pair.pair) for name, pairs in results.items()}
    return [BuildingResult(buildings[name], tuple(ordered[name])) for name in names]


def _work(logs: Sequence[Path], settings: EvaluationSettings, jobs: int) -> Iterator[Building | PairResult]:
    """Yield buildings and results as they are finished."""
    numbers = range(1, settings.pairs + 1)
    if jobs == 1:
        for log in logs:
            building = prepare(log, settings)
            yield building
            for pair in numbers:
                yield run_pair(building, pair)
        return
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(jobs, mp_context=context) as pool:
        try:
            runs = []
            for future in as_completed([pool.submit(prepare, log, settings) for log in logs]):
                building = future.result()
                runs += [pool.submit(run_pair, building, pair) for pair in numbers]
                yield building
            for run in as_completed(runs):
                yield run.result()
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def prepare(log: Path, settings: EvaluationSettings) -> Building:
    """Import a log, make its network, choose the routes."""
    carmen = read_carmen(log)
    with tempfile.TemporaryDirectory(prefix="snnav-") as folder:
        write_carmen_bag(carmen, Path(folder) / "bag")
        scans, _ = read_posed_scans(Path(folder) / "bag", SCAN_TOPIC, POSE_TOPIC)
    chosen = choose_evenly(len(scans), settings.nodes)
    name, values = name_of(log), settings.network
    description = f"{len(chosen)} of {len(scans)} scans of {log.name} as fixed sensor nodes"
    network = build_network([scans[index] for index in chosen], name, description, values)
    routes = []
    for pair in range(1, settings.pairs + 1):
        generator = np.random.default_rng([values.seed, pair])
        routes += pick_routes(network.largest_component, 1, generator, separation=0.0)
    margin = values.safety_margin
    area = reduced(reduced(network.area.region, 0.25 * margin), 0.75 * margin)
    return Building(name, len(scans), values, network, tuple(routes), area, carmen.warnings)


def run_pair(building: Building, pair: int) -> PairResult:
    """Drive one route, counted from 1, and check the drive."""
    scene, route = building.scene(pair), building.routes[pair - 1]
    record = simulate(scene)
    robot = scene.robots[0]
    rows = record.trajectory(robot.id)
    reason, message = _end(record)
    travelled = float(np.sum(rows[:, 4]) * scene.control_period)
    remaining = float(np.hypot(*(rows[-1, 1:3] - np.asarray(route.target))))
    reached = reason == StopReason.ARRIVED.value and remaining <= robot.speed * scene.sampling_interval
    optimum = _optimum(building.reduced_area, route)
    check = MarginCheck(building.network.area.region, recorded_returns(scene))
    to_area, to_returns = check.clearances(rows, scene.control_period)
    planner_ms = 1e3 * np.array(record.planner_seconds[1:] or record.planner_seconds)
    return PairResult(
        building=building.name,
        pair=pair,
        start_x=route.start[0],
        start_y=route.start[1],
        heading=route.heading,
        target_x=route.target[0],
        target_y=route.target[1],
        straight_distance=route.distance,
        reached=reached,
        reason=reason,
        message=message,
        duration=float(rows[-1, 0]),
        travelled_length=travelled,
        optimum_length=optimum,
        ratio=(travelled + remaining) / optimum if reached and optimum else None,
        area_clearance=float(to_area.min()),
        return_clearance=float(to_returns.min()),
        area_violations=int((to_area < scene.safety_margin).sum()),
        return_violations=int((to_returns < scene.safety_margin).sum()),
        step_ms=float(np.median(planner_ms)),
        rows=rows,
        planner_ms=planner_ms,
    )


def _end(record: RunRecord) -> tuple[str, str]:
    """Return the typed reason of the last stop and its message; for a robot still under way why the run ended."""
    last = record.decisions[-1]
    return ("time_limit", record.reason) if last.path is not None else (last.reason, last.message)


def _optimum(area: BaseGeometry, route: Route) -> float | None:
    try:
        return shortest_path(area, route.start, route.target)[0]
    except PlanningError:
        return None
