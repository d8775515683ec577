"""After the warm-up nothing is left to compile."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Iterator

from numba.core.registry import CPUDispatcher

import snnav_core
import snnav_sim
from snnav_sim.scene import find_scene, list_scenes, load_any_scene
from snnav_sim.simulation import simulation_of
from snnav_sim.warm_up import warm_up


def kernels() -> Iterator[tuple[str, CPUDispatcher]]:
    """Yield every compiled function of core and simulation."""
    for package in (snnav_core, snnav_sim):
        for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            for name, value in vars(importlib.import_module(module.name)).items():
                if isinstance(value, CPUDispatcher):
                    yield f"{module.name}.{name}", value


def compiled() -> dict[str, int]:
    return {name: len(kernel.signatures) for name, kernel in kernels()}


def test_nothing_is_compiled_after_the_warm_up() -> None:
    warm_up()
    before = compiled()
    assert sum(count > 0 for count in before.values()) > 5
    for name in list_scenes():
        simulation = simulation_of(load_any_scene(find_scene(name)))
        for _ in range(3):
            simulation.decide()
            for _ in range(simulation.scene.ticks_per_sample):
                simulation.move()
    assert compiled() == before
