"""Compile the numerical kernels once, so that no decision has to wait for the compiler."""

from __future__ import annotations

from snnav_sim.report.metrics import compute_metrics
from snnav_sim.scene import find_scene, load_scene
from snnav_sim.simulation import Simulation

__all__ = ["warm_up"]


def warm_up() -> None:
    """Take two scenes through a few decisions; what is compiled stays on disk beside the modules.

    Notes
    -----
    The small scene has circles and a single robot, the large one moving bodies, a memory and several robots:
    together they call every kernel. A few seconds when nothing is compiled yet, about one second afterwards.
    """
    for name, decisions in (("hello", 2), ("factory", 2)):
        simulation = Simulation(load_scene(find_scene(name)))
        for _ in range(decisions):
            simulation.decide()
            for _ in range(simulation.scene.ticks_per_sample):
                simulation.move()
        compute_metrics(simulation.scene, simulation.record)


if __name__ == "__main__":
    warm_up()
