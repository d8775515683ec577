"""The adjustment loop A1-A3: a candidate path becomes a short path of its homotopy class (Ch. 3, Ch. 4 alike)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from snnav_core.planning.adjustment_kernel import adjust_in_plane
from snnav_core.planning.adjustment_space import adjust_in_space
from snnav_core.planning.fields import Barrier, interval_field, pull_field
from snnav_core.types import FloatArray

__all__ = ["AdjustmentResult", "AdjustmentSettings", "adjust", "resample"]


@dataclass(frozen=True, slots=True)
class AdjustmentSettings:
    """Gains of the loop; none is given in the thesis (C0-12).

    Parameters
    ----------
    interval_gain, barrier_gain : float
        G_I, and G_R = G_C (used by the spring form only).
    pull : float
        G_P as a share of the link length.
    attenuation : float
        G_N.
    rest_threshold : float
        F_th as a share of G_P.
    shortest_end, longest_end : float
        The thresholds on the distance of the last point to the target, as shares of the link length (C0-13).
    exact_barriers : bool
        Project violating points instead of pushing them by a spring (C0-5).
    cold_passes, warm_passes : int
        Pass limits. Deviation C0-15 (3000, 300): with exact barriers and candidates that start on the reduced area all
        successful adjustments took fewer than 200 passes.
    """

    interval_gain: float = 0.4
    barrier_gain: float = 0.4
    pull: float = 0.1
    attenuation: float = 0.9
    rest_threshold: float = 0.03
    shortest_end: float = 0.3
    longest_end: float = 1.5
    exact_barriers: bool = True
    cold_passes: int = 300
    warm_passes: int = 150


@dataclass(frozen=True)
class AdjustmentResult:
    """Adjusted points (n + 1, D) [m], whether they came to rest, and after how many passes."""

    points: FloatArray
    settled: bool
    passes: int


def resample(polyline: FloatArray, spacing: float) -> FloatArray:
    """Points at equal distance along a polygonal chain.

    Parameters
    ----------
    polyline : ndarray, shape (M, D)
        Vertices [m].
    spacing : float
        Distance along the chain [m].

    Returns
    -------
    ndarray, shape (N, D)
        The first vertex, then a point every `spacing`; the rest at the end is shorter than `spacing` and left out.
    """
    steps = np.sqrt(np.einsum("ij,ij->i", np.diff(polyline, axis=0), np.diff(polyline, axis=0)))
    along = np.concatenate(([0.0], np.cumsum(steps)))
    stations = np.arange(int(along[-1] / spacing + 1e-9) + 1) * spacing
    return np.stack(
        [np.interp(stations, along, polyline[:, axis]) for axis in range(polyline.shape[1])], axis=-1
    )


def adjust(
    points: FloatArray,
    target: FloatArray,
    link_length: float,
    barriers: Sequence[Barrier],
    settings: AdjustmentSettings,
    max_passes: int,
    max_points: int,
) -> AdjustmentResult:
    """Adjust a path until its points rest (Ch. 3, A1-A3).

    Parameters
    ----------
    points : ndarray, shape (n + 1, D)
        p_0 .. p_n [m]; p_0 stays.
    target : ndarray, shape (D,)
        Target position [m].
    link_length : float
        L, distance from point to point [m].
    barriers : sequence of Barrier
        F_R, F_C and other robots.
    settings : AdjustmentSettings
    max_passes : int
        Give up (`settled` false) after so many passes.
    max_points : int
        Give up when the path grows beyond this number of points.

    Notes
    -----
    Deviations: v first, then p (C0-2); rest length L - G_P / G_I (C0-3); exact barriers with the inward part of the
    force ignored in the exit test (C0-5); rest means that all forces and velocities are small and no point was added
    or removed in the last five passes (C0-1); a new point goes min(L, d) towards the target (C0-14).

    With exact barriers the same loop runs compiled: in the plane for a `ClearanceField`, disks and circles, in space
    for a `SpatialArea`, spheres and the torus.
    """
    pull = settings.pull * link_length
    rest_length = link_length - pull / settings.interval_gain
    threshold = settings.rest_threshold * pull
    speed_threshold = threshold / (1.0 - settings.attenuation)
    if settings.exact_barriers:
        gains = (link_length, pull, rest_length, settings.interval_gain, settings.attenuation)
        limits = (threshold, speed_threshold, settings.shortest_end, settings.longest_end)
        within = adjust_in_plane if points.shape[1] == 2 else adjust_in_space
        result = within(points, target, barriers, gains, limits, (max_passes, max_points))
        if result is not None:
            return AdjustmentResult(*result)
    first, moving = points[:1], points[1:].copy()
    velocity = np.zeros_like(moving)
    quiet = 0
    for barrier in barriers:
        barrier.reset()
    for passes in range(1, max_passes + 1):
        force = interval_field(np.concatenate((first, moving)), rest_length, settings.interval_gain)
        if len(moving):
            force[-1] += pull_field(moving[-1], target, pull)
        if not settings.exact_barriers:
            _add_springs(force, moving, barriers, settings.barrier_gain)
        velocity = settings.attenuation * velocity + force
        moving = moving + velocity
        if settings.exact_barriers:
            _project(moving, velocity, force, barriers)
        moving, velocity, changed = _change_end(first[0], moving, velocity, target, link_length, settings)
        if len(moving) > max_points:
            return AdjustmentResult(np.concatenate((first, moving)), False, passes)
        if changed:
            quiet = 0
            for barrier in barriers:
                barrier.reset()
            continue
        quiet += 1
        if quiet > 5 and _is_small(force, threshold) and _is_small(velocity, speed_threshold):
            return AdjustmentResult(np.concatenate((first, moving)), True, passes)
    return AdjustmentResult(np.concatenate((first, moving)), False, max_passes)


def _is_small(vectors: FloatArray, threshold: float) -> bool:
    return len(vectors) == 0 or float(np.einsum("ij,ij->i", vectors, vectors).max()) < threshold * threshold


def _add_springs(force: FloatArray, points: FloatArray, barriers: Sequence[Barrier], gain: float) -> None:
    for barrier in barriers:
        depth, outward = barrier.violation(points)
        force += gain * np.maximum(depth, 0.0)[:, None] * outward


def _project(
    points: FloatArray, velocity: FloatArray, force: FloatArray, barriers: Sequence[Barrier]
) -> None:
    """Move violating points onto the barriers; take the inward parts out of velocity and force, in place."""
    for barrier in barriers:
        depth, outward = barrier.violation(points)
        touching = np.flatnonzero(depth > -1e-9)
        if len(touching) == 0:
            continue
        normal = outward[touching]
        points[touching] += np.maximum(depth[touching], 0.0)[:, None] * normal
        for vectors in (velocity, force):
            inward = np.minimum(np.einsum("ij,ij->i", vectors[touching], normal), 0.0)
            vectors[touching] -= inward[:, None] * normal


def _change_end(
    first: FloatArray,
    points: FloatArray,
    velocity: FloatArray,
    target: FloatArray,
    link_length: float,
    settings: AdjustmentSettings,
) -> tuple[FloatArray, FloatArray, bool]:
    """Add or remove the last point (Ch. 3, A2.3)."""
    last = points[-1] if len(points) else first
    gap = target - last
    distance = float(np.sqrt(gap @ gap))
    if distance < settings.shortest_end * link_length and len(points) > 1:
        return points[:-1], velocity[:-1], True
    if distance > settings.longest_end * link_length:
        added = last + gap * (min(link_length, distance) / distance)
        return np.vstack((points, added)), np.vstack((velocity, np.zeros_like(added))), True
    return points, velocity, False
