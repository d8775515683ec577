"""The subcommands of ``snnav`` that work on recordings: import-carmen, network, evaluate-logs."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
from rich.console import Console

from snnav_ros.bag.carmen import read_carmen
from snnav_ros.bag.carmen_import import POSE_TOPIC, SCAN_TOPIC, write_carmen_bag
from snnav_ros.bag.evaluation import EvaluationSettings, evaluate
from snnav_ros.bag.evaluation_report import MARK, evaluation_table, is_accepted, write_evaluation
from snnav_ros.bag.files import check_directory, write_text
from snnav_ros.bag.network import (
    NetworkSettings,
    SensorNetwork,
    build_network,
    choose_evenly,
    read_posed_scans,
)
from snnav_ros.bag.progress import counter
from snnav_ros.bag.routes import LEAST_ROUTE, Route, pick_routes, robots_on_routes
from snnav_sim.scene import dump_scene, parse_scene

__all__ = ["add_parser"]

_TABLE_WIDTH = 160  # columns, when the output is not a terminal


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the subcommands; each sets ``func`` to a function of the parsed arguments that returns the exit status."""
    _add_import(subparsers)
    _add_network(subparsers)
    _add_evaluation(subparsers)


def _number(least: float, above: bool = False) -> Callable[[str], float]:
    """Return an argparse type: a finite number from `least` on (or above it)."""

    def parse(text: str) -> float:
        value = float(text)
        if not math.isfinite(value) or value < least or (above and value == least):
            raise argparse.ArgumentTypeError(f"{text} must be {'above' if above else 'at least'} {least:g}")
        return value

    parse.__name__ = "number"
    return parse


def _whole(least: int) -> Callable[[str], int]:
    """Return an argparse type: a whole number from `least` on."""

    def parse(text: str) -> int:
        value = int(text)
        if value < least:
            raise argparse.ArgumentTypeError(f"{text} must be at least {least}")
        return value

    parse.__name__ = "whole number"
    return parse


def _add_import(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    parser = subparsers.add_parser(
        "import-carmen",
        help="turn a CARMEN log into a bag of scans and poses",
        description="Turn a CARMEN log (FLASER or ROBOTLASER1 lines, plain or gzip) into a rosbag2 bag: "
        f"{SCAN_TOPIC} (LaserScan) and {POSE_TOPIC} (PoseStamped, the laser in the map) with equal stamps.",
    )
    parser.add_argument("log", metavar="LOG", type=Path, help="CARMEN log, .log or .log.gz")
    parser.add_argument("bag", metavar="BAG", type=Path, help="bag to make; must not exist")
    parser.set_defaults(func=run_import)


def run_import(arguments: argparse.Namespace) -> int:
    """Run ``snnav import-carmen``."""
    with counter("reading scans") as progress:
        log = read_carmen(arguments.log, progress)
    for warning in log.warnings:
        print(f"warning: {warning}", file=sys.stderr)
    with counter("writing scans", len(log.scans)) as progress:
        summary = write_carmen_bag(log, arguments.bag, progress)
    beams = " or ".join(map(str, summary.beams))
    width, height = summary.extent
    print(f"{summary.scans} {log.kind} scans of {beams} beams, {log.no_return}")
    print(f"{width:.1f} x {height:.1f} m, path {summary.path_length:.1f} m, {summary.duration:.1f} s")
    print(f"written: {arguments.bag} (topics {SCAN_TOPIC}, {POSE_TOPIC})")
    return 0


def _add_network(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    defaults = {field.name: field.default for field in fields(NetworkSettings)}
    parser = subparsers.add_parser(
        "network",
        help="turn posed scans of a bag into a scene of fixed sensor nodes",
        description="Take posed scans of a bag, spread evenly over it, as the fixed nodes of a sensor network "
        "and write a scene with robots whose starts and targets lie in the largest connected free part.",
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    parser.add_argument("bag", metavar="BAG", type=Path, help="rosbag2 directory, .mcap, .db3 or ROS 1 .bag")
    count = parser.add_mutually_exclusive_group(required=True)
    count.add_argument(
        "--nodes", metavar="N", type=_whole(1), help="number of nodes", default=argparse.SUPPRESS
    )
    count.add_argument(
        "--every", metavar="K", type=_whole(1), help="every K-th scan", default=argparse.SUPPRESS
    )
    parser.add_argument("--out", metavar="SCENE.yaml", type=Path, required=True, help="scene file to write")
    parser.add_argument("--topic", default=SCAN_TOPIC, help="the scans (LaserScan)")
    parser.add_argument("--pose-topic", default=POSE_TOPIC, help="the scanner's pose in the map")
    parser.add_argument("--robots", metavar="R", type=_whole(0), default=1, help="number of robots")
    parser.add_argument(
        "--seed", type=_whole(0), default=defaults["seed"], help="of starts, targets and the run"
    )
    for flag, name, text in (
        ("--range-cut", "range_cut", "longer readings are free only up to this range [m]"),
        ("--speed", "speed", "of the robots [m/s]"),
        ("--max-turn-rate", "max_turn_rate", "of the robots [rad/s]"),
        ("--radius", "radius", "of the robots [m]"),
        ("--safety-margin", "safety_margin", "from a robot's centre to any obstacle [m]"),
        ("--sampling-interval", "sampling_interval", "between two decisions [s]"),
    ):
        parser.add_argument(flag, type=_number(0.0, above=True), default=defaults[name], help=text)
    parser.set_defaults(func=run_network)


def run_network(arguments: argparse.Namespace) -> int:
    """Run ``snnav network``."""
    names = [field.name for field in fields(NetworkSettings) if field.name in arguments]
    settings = NetworkSettings(**{name: getattr(arguments, name) for name in names})
    scans, left_out = read_posed_scans(arguments.bag, arguments.topic, arguments.pose_topic)
    if left_out:
        print(f"warning: {arguments.bag}: {left_out} scans without a usable pose left out", file=sys.stderr)
    nodes, every = getattr(arguments, "nodes", None), getattr(arguments, "every", None)
    chosen = choose_evenly(len(scans), nodes, every)
    description = f"{len(chosen)} of {len(scans)} scans of {arguments.bag.stem} as fixed sensor nodes"
    network = build_network([scans[index] for index in chosen], arguments.out.stem, description, settings)
    routes = _routes(network, arguments.robots, settings)
    scene = replace(network.scene, robots=robots_on_routes(routes, settings))
    text = dump_scene(scene)
    parse_scene(text, str(arguments.out))  # what is written can be run
    write_text(arguments.out, text)
    _print_network(network, routes)
    print(f"written: {arguments.out} (snnav run {arguments.out})")
    return 0


def _routes(network: SensorNetwork, robots: int, settings: NetworkSettings) -> list[Route]:
    if not robots:
        return []
    generator = np.random.default_rng(settings.seed)
    separation = settings.safety_margin + 2.0 * settings.radius
    return pick_routes(network.largest_component, robots, generator, separation)


def _print_network(network: SensorNetwork, routes: list[Route]) -> None:
    margin = network.scene.safety_margin
    reduced = sum(part.area for part in network.components)
    share = network.components[0].area / reduced if network.components else 0.0
    print(
        f"{len(network.scene.sensors)} nodes see {network.area.region.area:.1f} m2 free; at {margin:g} m from "
        f"everything {reduced:.1f} m2, {100 * share:.0f} % of them connected"
    )
    print(
        f"{100 * network.contradiction_share:.1f} % of {network.return_count} returns lie where another node saw "
        "free space (they count as obstacles)"
    )
    for index, route in enumerate(routes, start=1):
        (x0, y0), (x1, y1) = route.start, route.target
        print(f"robot_{index}: ({x0:.1f}, {y0:.1f}) -> ({x1:.1f}, {y1:.1f}), {route.distance:.1f} m")
        if route.distance < LEAST_ROUTE:
            print(f"warning: robot_{index} has no target {LEAST_ROUTE:g} m away", file=sys.stderr)


def _add_evaluation(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    parser = subparsers.add_parser(
        "evaluate-logs",
        help="drive ten routes through each of some real buildings and check every margin",
        description="For each corrected CARMEN log: import it, make a sensor network of it, drive seeded routes in "
        "the largest connected free part in a closed loop without ROS, and check every drive against the fused area "
        "and every measured return. Exit status 1 when fewer than 95 % of the targets are reached or a margin is "
        "violated.",
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    defaults = EvaluationSettings()
    parser.add_argument("logs", metavar="LOG", type=Path, nargs="+", help="CARMEN log, .log or .log.gz")
    parser.add_argument(
        "--nodes", metavar="N", type=_whole(1), default=defaults.nodes, help="nodes a building"
    )
    parser.add_argument(
        "--pairs", metavar="P", type=_whole(1), default=defaults.pairs, help="routes a building"
    )
    parser.add_argument("--seed", type=_whole(0), default=defaults.network.seed, help="of starts and targets")
    parser.add_argument("--out", metavar="DIR", type=Path, default=Path("runs/evaluate-logs"), help="results")
    parser.add_argument("--jobs", metavar="J", type=_whole(1), default=2, help="processes")
    parser.set_defaults(func=run_evaluation)


def run_evaluation(arguments: argparse.Namespace) -> int:
    """Run ``snnav evaluate-logs``."""
    check_directory(arguments.out, MARK)
    settings = EvaluationSettings(arguments.nodes, arguments.pairs, NetworkSettings(seed=arguments.seed))
    with counter("routes", len(arguments.logs) * (1 + arguments.pairs)) as progress:
        results = evaluate(arguments.logs, settings, arguments.jobs, progress)
    for result in results:
        for warning in result.building.warnings:
            print(f"warning: {warning}", file=sys.stderr)
    console = Console()
    if not console.is_terminal:
        console = Console(width=_TABLE_WIDTH)
    console.print(evaluation_table(results, settings.network.safety_margin))
    write_evaluation(arguments.out, results, settings)
    print(f"written: {arguments.out} (tables, figures, scenes of failed routes)")
    return 0 if is_accepted(results) else 1
