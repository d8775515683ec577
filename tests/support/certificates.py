"""Paths and areas to certify, at random and by hand."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import shapely
from hypothesis import strategies as st
from shapely.geometry import MultiPolygon

from snnav_core.area.planar import as_multipolygon
from snnav_core.planning.boundary_index import BoundaryIndex
from snnav_core.planning.certificate import (
    CertificateSettings,
    certify,
)
from snnav_core.planning.separation import OtherRobot
from snnav_core.types import Certificate, FloatArray, Pose2D, RobotSpec, TimedPath

ROBOT = RobotSpec("robot_1", 0.3, 1.0, 0.5)  # R_min = 2 m
SETTINGS = CertificateSettings(1.0, 0.0, 1.0, 4)
HALL = shapely.box(-5.0, -10.0, 40.0, 10.0)
START, STEP = 7.0, 0.5

seeds = st.integers(0, 2**32 - 1)


def straight(links: int = 20) -> FloatArray:
    return np.column_stack((STEP * np.arange(links + 1), np.zeros(links + 1)))


def hall_without(*obstacles: shapely.Geometry) -> MultiPolygon:
    return as_multipolygon(shapely.difference(HALL, shapely.union_all(obstacles)))


def check(
    points: FloatArray | TimedPath,
    region: shapely.Geometry = HALL,
    pose: Pose2D | None = None,
    others: Sequence[OtherRobot] = (),
    robot: RobotSpec = ROBOT,
    least_window: int = 4,
    **changes: Any,
) -> Certificate:
    path = points if isinstance(points, TimedPath) else TimedPath(START, STEP, points)
    x, y = path.points[0]
    return certify(
        path,
        robot,
        pose or Pose2D(float(x), float(y), 0.0),
        BoundaryIndex(as_multipolygon(region)),
        6.5,
        others,
        replace(SETTINGS, **changes),
        least_window,
    )


def refused(certificate: Certificate, reason: str) -> bool:
    return not certificate.accepted and reason in certificate.reason


def box_at(x: float, y: float, half: float = 0.2) -> shapely.Polygon:
    return shapely.box(x - half, y - half, x + half, y + half)


def other(points: Any, step: float = STEP, start: float = START, radius: float = 0.3) -> OtherRobot:
    return OtherRobot("robot_2", radius, TimedPath(start, step, np.array(points, dtype=np.float64)))


def random_path(generator: np.random.Generator, links: int) -> FloatArray:
    """Return a path that the robot can drive: even links, turns within the radius."""
    largest = 2.0 * math.asin(STEP / (2.0 * 2.0))
    turns = generator.uniform(-largest, largest) + 0.3 * generator.uniform(-largest, largest, links)
    heading = np.cumsum(np.clip(turns, -largest, largest)) - turns[0]
    steps = STEP * np.column_stack((np.cos(heading), np.sin(heading)))
    return np.vstack((np.zeros(2), np.cumsum(steps, axis=0)))


def random_area(generator: np.random.Generator, points: FloatArray, least: float) -> MultiPolygon:
    """Return a hall with obstacles at random distances from a path, mostly near the demanded one."""
    obstacles = []
    for _ in range(int(generator.integers(1, 6))):
        centre = points[int(generator.integers(0, len(points)))] + generator.normal(0.0, 2.5, 2)
        shape = shapely.Point(centre).buffer(
            generator.uniform(0.05, 0.5), quad_segs=int(generator.integers(1, 4))
        )
        gap = shapely.distance(shape, shapely.LineString(points))
        if gap > least:
            obstacles.append(shape)
    return as_multipolygon(shapely.difference(shapely.box(-40, -40, 40, 40), shapely.union_all(obstacles)))


def dense(points: FloatArray, until: float) -> tuple[FloatArray, FloatArray]:
    """Return times and positions every millimetre of the way up to a time."""
    times = np.arange(0.0, min(until, STEP * (len(points) - 1)) + 1e-12, 0.001)
    index = np.minimum((times / STEP).astype(np.int64), len(points) - 2)
    share = (times / STEP - index)[:, None]
    return times, points[index] * (1.0 - share) + points[index + 1] * share
