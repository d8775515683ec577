"""How far robots were from each other all the time, along their motion and not at samples alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from snnav_core.types import FloatArray
from snnav_sim.report.record import RunRecord
from snnav_sim.scene_types import RobotScene, Scene

__all__ = ["Separations", "separations"]

_PIECES = 4  # chords of an arc that is driven between two samples
_REACH = 1.0  # [m]; how far beyond the margin distances are told along the motion, farther ones at samples


@dataclass(frozen=True)
class Separations:
    """Distances from the centre of each robot to the nearest disk of another one, or to the nearest centre.

    Parameters
    ----------
    times : ndarray, shape (M,)
        Samples [s].
    least : ndarray, shape (N, M)
        For every robot of the scene the least distance from a sample until the next one [m], never more than it was;
        inf while it or all others are not there.
    nearest : ndarray of int, shape (N, M)
        Number of the other robot in the scene; -1 where `least` is inf.
    """

    times: FloatArray
    least: FloatArray
    nearest: NDArray[np.int64]

    def at(self, robot: int, times: FloatArray) -> FloatArray:
        """Return `least` of a robot, by its number, at some of the samples (K,) [s]."""
        return np.asarray(self.least[robot, np.searchsorted(self.times, times)])


def separations(scene: Scene, record: RunRecord) -> Separations:
    """Measure separations of all robots of a run.

    Parameters
    ----------
    scene : Scene
    record : RunRecord

    Notes
    -----
    With the global planner distances are those between centres (Ch. 2, third simulation).

    Between two samples a robot drives an arc: its chords are taken, and what the arc may be nearer is taken off (less
    than 0.1 mm at usual turn rates). Where the disk of the other is farther away than the margin and 1 m, distances are
    those at the sample.
    """
    robots = scene.robots
    stamps = [row[0] for rows in record.samples.values() for row in rows]
    times = np.unique(np.array(stamps or [0.0], dtype=np.float64))
    poses = np.stack([_poses(robot, record, times) for robot in robots]) if robots else np.zeros((0, 1, 3))
    ways, bulges = _ways(poses)
    least = np.full((len(robots), len(times)), np.inf)
    nearest = np.full((len(robots), len(times)), -1, dtype=np.int64)
    for index, robot in enumerate(robots):
        for other in range(index):
            gap = np.hypot(*(poses[index, :, :2] - poses[other, :, :2]).T)
            reach = scene.safety_margin + _REACH + max(robot.radius, robots[other].radius)
            near = np.flatnonzero(gap < reach)
            between = ways[index, near] - ways[other, near]
            gap[near] = _approach(between) - bulges[index, near] - bulges[other, near]
            for one, two in ((index, other), (other, index)):
                distance = gap if scene.plans_globally else gap - robots[two].radius
                nearer = distance < least[one]
                nearest[one, nearer] = two
                np.fmin(least[one], distance, out=least[one])
    return Separations(times, least, nearest)


def _poses(robot: RobotScene, record: RunRecord, times: FloatArray) -> FloatArray:
    """Return x, y, heading at the times, shape (M, 3) [m, rad]; NaN while the robot is not there."""
    rows = record.trajectory(robot.id)
    if len(rows) == 0:
        return np.full((len(times), 3), np.nan)
    columns = (rows[:, 1], rows[:, 2], np.unwrap(rows[:, 3]))
    absent = {"left": np.nan, "right": np.nan}
    return np.stack([np.interp(times, rows[:, 0], column, **absent) for column in columns], axis=-1)


def _ways(poses: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return points of the arcs after all samples, (N, M, pieces + 1, 2), and how far arcs leave their chords [m]."""
    change = np.nan_to_num(np.diff(poses, axis=1, append=poses[:, -1:]))
    sagitta = 0.5 * np.tan(0.25 * change[..., 2])  # of the arc, over the length of its chord
    across = np.stack((change[..., 1], -change[..., 0]), axis=-1)
    share = np.linspace(0.0, 1.0, _PIECES + 1)[:, None]
    along = poses[:, :, None, :2] + share * change[:, :, None, :2]
    ways = along + 4.0 * share * (1.0 - share) * (sagitta[..., None] * across)[:, :, None]
    bulges = np.abs(sagitta) * np.hypot(change[..., 0], change[..., 1]) / _PIECES**2
    return ways, bulges


def _approach(between: FloatArray) -> FloatArray:
    """Return the least distance from the origin to each chain of points, shape (K, P, 2) -> (K,)."""
    begin, change = between[:, :-1], np.diff(between, axis=1)
    squared = np.einsum("kpi,kpi->kp", change, change)
    share = np.clip(-np.einsum("kpi,kpi->kp", begin, change) / np.maximum(squared, 1e-300), 0.0, 1.0)
    nearest = begin + share[..., None] * change
    return np.asarray(np.hypot(nearest[..., 0], nearest[..., 1]).min(axis=1))
