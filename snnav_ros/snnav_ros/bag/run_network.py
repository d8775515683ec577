"""What ``snnav network`` does."""

from __future__ import annotations

import argparse
import sys
from dataclasses import fields, replace

import numpy as np

from snnav_ros.bag.files import write_text
from snnav_ros.bag.network import SensorNetwork, build_network, choose_evenly, read_posed_scans
from snnav_ros.bag.routes import LEAST_ROUTE, Route, pick_routes, robots_on_routes
from snnav_ros.bag.settings import NetworkSettings
from snnav_sim.scene import dump_scene, parse_scene

__all__ = ["run"]


def run(arguments: argparse.Namespace) -> int:
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
