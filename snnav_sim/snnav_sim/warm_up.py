"""Compile the numerical kernels once, so that no decision has to wait for the compiler."""

from __future__ import annotations

import gc

import numpy as np

from snnav_core.obstacles import MovingObstacle
from snnav_core.planning.spacetime import plan_in_spacetime
from snnav_core.planning.spacetime_problem import SpacetimeProblem, SpacetimeSettings
from snnav_core.types import Pose2D, RobotSpec
from snnav_sim.report.metrics import compute_metrics
from snnav_sim.scene import find_scene, load_scene
from snnav_sim.simulation import Simulation

__all__ = ["warm_up"]


def warm_up() -> None:
    """Take two scenes through a few decisions; what is compiled stays on disk beside the modules.

    Notes
    -----
    The small scene has circles and a single robot, the large one moving bodies, a memory and several robots:
    together they call every kernel but those of the global planner, which plans a path of its own. A few seconds when
    nothing is compiled yet, about one second afterwards.
    """
    for name, decisions in (("hello", 2), ("factory", 2)):
        simulation = Simulation(load_scene(find_scene(name)))
        for _ in range(decisions):
            simulation.decide()
            for _ in range(simulation.scene.ticks_per_sample):
                simulation.move()
        compute_metrics(simulation.scene, simulation.record)
    _warm_up_global_planner()
    del simulation
    gc.collect()
    # All that numba has made stays: else every search for garbage, in the middle of a decision, takes 0.1 s.
    gc.freeze()


def _warm_up_global_planner() -> None:
    """Plan once in space-time around a body in a hall."""
    hall = np.array([[-2.0, -4.0], [8.0, -4.0], [8.0, 4.0], [-2.0, 4.0]])
    body = MovingObstacle("body", np.array([[3.0, 0.0]]), radius=0.3, velocity=np.array([0.0, 0.05]))
    robot = RobotSpec("robot", radius=0.3, speed=0.5, max_turn_rate=2.0)
    start, target = Pose2D(0.0, 0.0, 0.0), np.array([6.0, 0.0])
    problem = SpacetimeProblem(robot, start, 0.0, target, (body,), workspace=(hall,))
    plan_in_spacetime(problem, SpacetimeSettings(), np.random.default_rng(0))


if __name__ == "__main__":
    warm_up()
