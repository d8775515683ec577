"""The hits of all sensors at one instant, with what the tracker has to know of each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from snnav_core.errors import InvalidInput
from snnav_core.sensing.scan import DetectedArea
from snnav_core.types import FloatArray

__all__ = ["FusedReturns", "fused_returns"]

_JUMP_RATIO, _JUMP_DISTANCE = 5.0, 0.03  # as `ScanSettings`
_SIDE_BEAMS = 2  # neighbours on either side that a normal is fitted to
_FAR_APART = 0.05  # [m] between beams, from which a bent surface is not flat over all these neighbours
_UNEVEN = 0.012  # [m] off a line fitted to a hit and its neighbours: a corner
_LARGEST_SKIP = 2  # beams; one that was lost does not end a surface


@dataclass(frozen=True)
class FusedReturns:
    """Positions of the surfaces that the sensors measured, robots left out.

    Parameters
    ----------
    points : array_like, shape (K, 2)
        [m, map]
    times : array_like, shape (K,)
        When each was measured [s].
    sensors : array_like of int, shape (K,)
        Index of the sensor of each.
    beams : array_like of int, shape (K,)
        Its beam, ascending for every sensor; the points of one sensor follow each other.
    origins : array_like, shape (S, 2)
        Where the sensors are [m, map].
    increments : array_like, shape (S,)
        Size of the step from beam to beam [rad].

    Raises
    ------
    InvalidInput
        If shapes do not fit together, or a point or time is not finite.
    """

    points: FloatArray
    times: FloatArray
    sensors: NDArray[np.int64]
    beams: NDArray[np.int64]
    origins: FloatArray
    increments: FloatArray

    def __post_init__(self) -> None:
        points = np.array(self.points, dtype=np.float64).reshape(-1, 2)
        origins = np.array(self.origins, dtype=np.float64).reshape(-1, 2)
        fields = {
            "points": points,
            "times": np.array(self.times, dtype=np.float64),
            "sensors": np.array(self.sensors, dtype=np.int64),
            "beams": np.array(self.beams, dtype=np.int64),
            "origins": origins,
            "increments": np.abs(np.array(self.increments, dtype=np.float64)),
        }
        for name, count in (
            ("times", points),
            ("sensors", points),
            ("beams", points),
            ("increments", origins),
        ):
            if fields[name].shape != (len(count),):
                raise InvalidInput(
                    f"returns: {name} has shape {fields[name].shape}, expected ({len(count)},)"
                )
        for name in ("points", "times", "origins", "increments"):
            if not np.isfinite(fields[name]).all():
                raise InvalidInput(f"returns: {name} contain NaN or infinity; leave such beams out")
        if len(points) and not (fields["sensors"].min() >= 0 and fields["sensors"].max() < len(origins)):
            raise InvalidInput(f"returns: sensor index outside 0 .. {len(origins) - 1}")
        for name, array in fields.items():
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    def __len__(self) -> int:
        return int(self.points.shape[0])

    @cached_property
    def ranges(self) -> FloatArray:
        """Distance of each point from its sensor [m], shape (K,)."""
        distance: FloatArray = np.hypot(*(self.points - self.origins[self.sensors]).T)
        return distance

    @cached_property
    def spacing(self) -> FloatArray:
        """Distance to the next beam, square to the beam, at each point [m], shape (K,)."""
        return self.ranges * self.increments[self.sensors]

    @cached_property
    def surfaces(self) -> NDArray[np.int64]:
        """Number of the surface of each point, shape (K,): a run of beams of one sensor without a jump."""
        if len(self) == 0:
            return np.zeros(0, dtype=np.int64)
        step = np.hypot(*np.diff(self.points, axis=0).T)
        skipped = np.diff(self.beams)
        limit = _JUMP_RATIO * np.minimum(self.spacing[1:], self.spacing[:-1]) * np.maximum(skipped, 1)
        ends = (np.diff(self.sensors) != 0) | (skipped <= 0) | (skipped > _LARGEST_SKIP)
        return np.concatenate(([0], np.cumsum(ends | (step > limit + _JUMP_DISTANCE)))).astype(np.int64)

    @property
    def normals(self) -> FloatArray:
        """Unit normals of the surfaces towards the sensors, shape (K, 2); 0, 0 at corners and single points."""
        return self._surface_lines[0]

    @property
    def baselines(self) -> FloatArray:
        """What divides the noise of a range to give the deviation of a normal [m/rad], shape (K,); 0 without normal."""
        return self._surface_lines[1]

    @cached_property
    def _surface_lines(self) -> tuple[FloatArray, FloatArray]:
        """Normals and baselines; by the nearest neighbours alone where beams are far apart on a bent surface."""
        normals, baselines = self._lines_through(_SIDE_BEAMS)
        bent = (baselines == 0.0) & (self.spacing > _FAR_APART)
        if bent.any():
            near_normals, near_baselines = self._lines_through(1)
            normals[bent], baselines[bent] = near_normals[bent], near_baselines[bent]
        return normals, baselines

    def _lines_through(self, side_beams: int) -> tuple[FloatArray, FloatArray]:
        towards = self.origins[self.sensors] - self.points
        count, first, second = np.zeros(len(self)), np.zeros((len(self), 2)), np.zeros((len(self), 3))
        for offset in range(-side_beams, side_beams + 1):
            own = slice(max(0, -offset), len(self) - max(0, offset))
            other = slice(max(0, offset), len(self) + min(0, offset))
            same = (self.surfaces[own] == self.surfaces[other]).astype(np.float64)
            gap = (self.points[other] - self.points[own]) * same[:, None]
            count[own] += same
            first[own] += gap
            second[own] += np.column_stack((gap[:, 0] ** 2, gap[:, 1] ** 2, gap[:, 0] * gap[:, 1]))
        mean = first / np.maximum(count, 1.0)[:, None]
        xx, yy = (second[:, :2] / np.maximum(count, 1.0)[:, None] - mean**2).T
        xy = second[:, 2] / np.maximum(count, 1.0) - mean[:, 0] * mean[:, 1]
        along = 0.5 * np.arctan2(2.0 * xy, xx - yy)
        normals = np.column_stack((-np.sin(along), np.cos(along)))
        normals *= np.where(np.sum(normals * towards, axis=1) < 0.0, -1.0, 1.0)[:, None]
        uneven = 0.5 * (xx + yy) - np.hypot(0.5 * (xx - yy), xy)  # mean square distance from the fitted line
        none = (count < 3.0) | (uneven > _UNEVEN**2)
        normals[none] = 0.0
        baselines = np.where(none, 0.0, np.sqrt(count * (xx + yy)))
        return normals, baselines


def fused_returns(
    parts: Sequence[DetectedArea], stamps: Sequence[float] | None = None, numbers: Sequence[int] | None = None
) -> FusedReturns:
    """Put together what several sensors measured.

    Parameters
    ----------
    parts : sequence of DetectedArea
        One for every sensor that measured.
    stamps : sequence of float, optional
        When each was measured [s]; the stamps of the parts by default.
    numbers : sequence of int, optional
        The number that each sensor always has; 0, 1, ... by default.
    """
    times = [part.stamp for part in parts] if stamps is None else list(stamps)
    indices = list(range(len(parts))) if numbers is None else list(numbers)
    counts = [len(part.returns) for part in parts]
    origins, increments = np.zeros((max(indices, default=-1) + 1, 2)), np.zeros(max(indices, default=-1) + 1)
    for index, part in zip(indices, parts, strict=True):
        origins[index], increments[index] = part.pose.position, part.fan.increment
    return FusedReturns(
        np.concatenate([np.zeros((0, 2)), *(part.returns for part in parts)]),
        np.repeat(np.array(times, dtype=np.float64), counts),
        np.repeat(np.array(indices, dtype=np.int64), counts),
        np.concatenate([np.zeros(0, dtype=np.int64), *(part.return_beam for part in parts)]),
        origins,
        increments,
    )
