"""Random rooms for flying robots: a wall with a hole, boxes, people who walk, cameras of which some fail."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from snnav_sim.campaign.halls import Draws, between
from snnav_sim.scene_types import Circle, Fault
from snnav_sim.space_types import (
    Body,
    Box,
    DepthSensor,
    FlyerScene,
    Point3,
    Prism,
    SpaceMover,
    SpaceScene,
)
from snnav_sim.space_world import SpaceWorld

__all__ = ["draw_flight_scene"]

_SPEED, _TURN_RATE, _RADIUS = 0.7, 2.0, 0.2  # of all robots, as in ch. 4
_RESERVE = 0.15  # [m] that starts and targets keep beyond the margin: cells and rays take some
_TRIES = 300
_OFF_LANE = 0.3  # [m] that somebody walks from walls and bodies
_WITH_PEOPLE, _WITH_WALL, _WITH_FAULTS = 0.5, 0.6, 0.3


def draw_flight_scene(draws: Draws) -> SpaceScene | None:
    """Return a room with one to eight robots, or None where there was no room for them.

    Notes
    -----
    Half of the rooms have people. Starts and targets are off their lanes: nobody answers for a robot that
    hovers where somebody walks by without looking. Starts are apart from each other, targets too (C4-11).
    """
    size = np.array([between(draws, 5.0, 8.0), between(draws, 5.0, 8.0), between(draws, 2.4, 3.4)]).round(1)
    people = draws.random() < _WITH_PEOPLE
    scene = SpaceScene(
        name="flight",
        sampling_interval=0.2,
        low=(0.0, 0.0, 0.0),
        high=(float(size[0]), float(size[1]), float(size[2])),
        safety_margin=round(between(draws, 0.36, 0.5), 2),
        sensors=_cameras(draws, size),
        obstacles=_bodies(draws, size),
        time_window=int(draws.integers(4, 7)),
        boundary_speed=between(draws, 0.05, 0.2) if people else 0.0,
        time_limit=150.0,
    )
    if people:
        scene = replace(scene, movers=_walkers(draws, scene))
    robots: list[FlyerScene] = []
    world = SpaceWorld(scene)
    for number in range(1, int(draws.choice([1, 2, 3, 4, 8], p=(0.4, 0.2, 0.15, 0.15, 0.1))) + 1):
        robot = _robot(draws, scene, world, robots, f"robot_{number}")
        if robot is not None:
            robots.append(robot)
    return replace(scene, robots=tuple(robots)) if robots else None


def _cameras(draws: Draws, size: np.ndarray) -> tuple[DepthSensor, ...]:
    """Three or four cameras in the upper corners, sometimes one that fails for a while."""
    corners = [(0.1, 0.1), (size[0] - 0.1, size[1] - 0.1), (size[0] - 0.1, 0.1), (0.1, size[1] - 0.1)]
    noise = str(draws.choice(["none", "tof"]))
    faulty = int(draws.integers(4)) if draws.random() < _WITH_FAULTS else -1
    cameras = []
    for index, (x, y) in enumerate(corners[: int(draws.integers(3, 5))]):
        begin = between(draws, 0.0, 8.0)
        faults = (Fault("drop_out", begin, begin + between(draws, 0.5, 6.0)),) if index == faulty else ()
        cameras.append(
            DepthSensor(
                f"camera_{index + 1}",
                "tof",
                (float(round(x, 2)), float(round(y, 2)), float(round(size[2] - 0.1, 2))),
                look_at=(float(round(0.5 * size[0], 2)), float(round(0.5 * size[1], 2)), 0.8),
                noise=noise,
                no_return="free",
                drop_out=0.0005 if noise == "tof" else 0.0,
                faults=faults,
            )
        )
    return tuple(cameras)


def _bodies(draws: Draws, size: np.ndarray) -> tuple[Body, ...]:
    """A wall with a hole, more often than not, and up to three boxes on the floor."""
    bodies = []
    if draws.random() < _WITH_WALL:
        x = round(float(size[0]) * between(draws, 0.4, 0.6), 1)
        wide, high = between(draws, 1.5, 2.2), between(draws, 1.5, 2.0)
        left, low = (
            between(draws, 0.3, float(size[1]) - wide - 0.3),
            between(draws, 0.2, float(size[2]) - high - 0.1),
        )
        hole = ((x, round(left, 1), round(low, 1)), (x + 0.2, round(left + wide, 1), round(low + high, 1)))
        known = bool(draws.random() < 0.5)
        bodies.append(Body(Box((x, 0.0, 0.0), (x + 0.2, float(size[1]), float(size[2])), (hole,)), known))
    for _ in range(int(draws.integers(0, 4))):
        length = draws.uniform((0.3, 0.3, 0.3), (1.0, 1.0, 1.5)).round(2)
        corner = draws.uniform((0.5, 0.5), size[:2] - 1.5).round(2)
        low_corner: Point3 = (float(corner[0]), float(corner[1]), 0.0)
        top = np.append(corner, 0.0) + length
        bodies.append(Body(Box(low_corner, (float(top[0]), float(top[1]), float(top[2])))))
    return tuple(bodies)


def _walkers(draws: Draws, scene: SpaceScene) -> tuple[SpaceMover, ...]:
    """One or two people on straight lanes along the walls or through the room, clear of all bodies."""
    world = SpaceWorld(scene)
    walkers: list[SpaceMover] = []
    for number in range(1, int(draws.integers(1, 3)) + 1):
        solid = Prism(Circle(0.0, 0.0, 0.25), 0.0, between(draws, 1.5, 1.85))
        for _ in range(_TRIES):
            ends = draws.uniform((0.6, 0.6), np.array(scene.high[:2]) - 0.6, (2, 2)).round(2)
            if np.linalg.norm(ends[1] - ends[0]) < 1.5:
                continue
            way = ends[0] + np.linspace(0.0, 1.0, 40)[:, None] * (ends[1] - ends[0])
            body = np.concatenate([np.column_stack((way, np.full(40, h))) for h in (0.3, 0.9, 1.5)])
            level = np.minimum(way, np.array(scene.high[:2]) - way).min()
            if level >= 0.25 + _OFF_LANE and world.body_clearance(body).min() >= 0.25 + _OFF_LANE:
                points = tuple((float(x), float(y), 0.0) for x, y in ends)
                speed = max(0.01, math.floor(1e3 * draws.uniform(0.5, 1.0) * scene.boundary_speed) / 1e3)
                walkers.append(SpaceMover(f"walker_{number}", solid, points, speed, loop=True))
                break
    return tuple(walkers)


def _robot(
    draws: Draws, scene: SpaceScene, world: SpaceWorld, others: list[FlyerScene], name: str
) -> FlyerScene | None:
    """A robot with start and target apart from those of the others and off all lanes; None without room."""
    window = scene.boundary_speed * scene.time_window * scene.sampling_interval
    keep = scene.safety_margin + _RESERVE
    apart = 2.0 * scene.safety_margin + _RADIUS + _RESERVE
    points = draws.uniform(scene.low, scene.high, (_TRIES, 3)).round(2)
    still = np.minimum(points - scene.low, np.array(scene.high) - points).min(axis=1)
    bodies = world.body_clearance(points)
    lanes = np.full(len(points), np.inf)
    for mover in scene.movers:
        ways = mover.positions(np.linspace(0.0, 2.0 * _lane_length(mover) / mover.speed, 160))
        for place in ways:
            gap = points[:, :2] - place[:2]
            np.minimum(lanes, np.hypot(gap[:, 0], gap[:, 1]) - 0.25, out=lanes)
    good = points[(still >= keep) & (bodies >= keep + window) & (lanes >= keep + window)]
    ends: list[Point3] = []
    for kind in ("start", "target"):
        taken = [getattr(other, kind) for other in others]
        for point in good:
            place = (float(point[0]), float(point[1]), float(point[2]))
            far = not ends or math.dist(place, ends[0]) >= 2.0
            if far and all(math.dist(place, other) >= apart for other in taken):
                ends.append(place)
                break
    if len(ends) < 2:
        return None
    heading = math.radians(float(draws.integers(-180, 180)))
    return FlyerScene(name, ends[0], heading, 0.0, ends[1], _SPEED, _TURN_RATE, _RADIUS)


def _lane_length(mover: SpaceMover) -> float:
    return float(np.linalg.norm(np.diff(np.array(mover.waypoints), axis=0), axis=1).sum())
