"""Compile the numerical kernels once, so that no decision has to wait for the compiler."""

from __future__ import annotations

import gc
from dataclasses import replace

import numpy as np

from snnav_core.obstacles import MovingObstacle
from snnav_core.planning.grid_search import GridSearch
from snnav_core.planning.spacetime import plan_in_spacetime
from snnav_core.planning.spacetime_problem import SpacetimeProblem, SpacetimeSettings
from snnav_core.types import Pose2D, RobotSpec
from snnav_sim.raycast3d import cast_triangles
from snnav_sim.report.flight_metrics import compute_flight_metrics
from snnav_sim.report.metrics import compute_metrics
from snnav_sim.scene import SpaceScene, find_scene, load_any_scene, load_scene
from snnav_sim.simulation import Simulation
from snnav_sim.simulation_flight import FlightSimulation
from snnav_sim.space_world import triangle_distance

__all__ = ["warm_up"]


def warm_up() -> None:
    """Take some scenes through a few decisions; what is compiled stays on disk beside the modules.

    Notes
    -----
    The small scene has circles and a single robot, the large one moving bodies, a memory and several robots:
    together they call every kernel but those of the tracker of bodies and of flight, which have scenes of their own,
    and those of the global planner, which plans a path of its own. Some ten seconds when nothing is compiled yet, a few
    afterwards.
    """
    for name, decisions in (("hello", 2), ("factory", 2), ("thesis_ch2_dynamic", 3)):
        simulation = Simulation(load_scene(find_scene(name)))
        for _ in range(decisions):
            simulation.decide()
            for _ in range(simulation.scene.ticks_per_sample):
                simulation.move()
        if not simulation.scene.plans_globally:
            compute_metrics(simulation.scene, simulation.record)
    _warm_up_global_planner()
    _warm_up_flight()
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


def _warm_up_flight() -> None:
    """Take two robots in space through a few decisions, past a mover, a prism and a mesh."""
    scene = load_any_scene(find_scene("hello_flight"))
    assert isinstance(scene, SpaceScene)
    robot = scene.robots[0]
    other = replace(robot, id="other", start=robot.target, target=robot.start)
    simulation = FlightSimulation(replace(scene, robots=(robot, other)))
    for _ in range(3):
        simulation.decide()
        for _ in range(scene.ticks_per_sample):
            simulation.move()
    compute_flight_metrics(scene, simulation.record)
    area = simulation.fusion.area(simulation.time)
    GridSearch(area, np.array(robot.start), np.array(robot.target), scene.safety_margin, 0.0, 0.0).way()
    origin, rays = np.zeros(3), np.eye(3)
    triangle = np.array([[[1.0, -1.0, -1.0], [1.0, 1.0, -1.0], [1.0, 0.0, 1.0]]])
    cast_triangles(origin, rays, triangle, np.full(3, np.inf))
    triangle_distance(rays, triangle)


if __name__ == "__main__":
    warm_up()
