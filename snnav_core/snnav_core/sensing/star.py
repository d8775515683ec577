"""The region that a fan of beams has seen: star and sector polygons (Ch. 3, "detected area")."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numba
import numpy as np
from numpy.typing import NDArray

from snnav_core.sensing.corners import continue_surfaces
from snnav_core.types import FloatArray, Pose2D

__all__ = ["BeamFan", "shorten_fan", "star_rings"]

_TURN = 2.0 * math.pi
_SAME_BEAM = 1e-3  # fraction of an increment: a beam this close to a full turn counts as a repetition
_ALIGNED = 1e-6  # fraction of an increment: directions that coincide
_ON_OUTLINE = 1e-6  # [m]: the returns of a scan lie on its own outline, but for rounding
_NOISE = 0.5  # of the accuracy of a length: a difference that noise explains
_SAME_POINT = 1e-9  # [m]
_CLOSING_GAP = 1.5  # a gap of so many increments between the last and the first beam still closes the circle


@dataclass(frozen=True)
class BeamFan:
    """The free length along every beam of one scan, and when two neighbours belong to one surface.

    Parameters
    ----------
    free : ndarray, shape (B,)
        Length along every beam that is known to be free [m]; 0 where the beam saw nothing.
    angle_min, angle_increment : float
        Direction of the first beam and step to the next [rad, sensor]; the step may be negative.
    jump_ratio, jump_distance : float
        Limits of a difference that counts as one surface [-], [m].
    measured : ndarray, shape (B,), optional
        The free lengths before beams were shortened [m]: what jumped then is no surface now.
    surface : ndarray, shape (B,), optional
        Distance of the surface that each beam measured, infinite without one [m]: a beam that ends free, at the limit
        of the range, goes on behind no surface, however near the next return is.
    accuracy : float
        The free lengths end this far in front of the surfaces [m]; half of it explains a difference between neighbours.
    """

    free: FloatArray
    angle_min: float
    angle_increment: float
    jump_ratio: float
    jump_distance: float
    measured: FloatArray | None = None
    surface: FloatArray | None = None
    accuracy: float = 0.0

    @property
    def increment(self) -> float:
        """Size of the step from beam to beam [rad]."""
        return abs(self.angle_increment)

    @property
    def first_direction(self) -> float:
        """Direction of the first beam in counter-clockwise order [rad, sensor]."""
        return self.angle_min + min(self.angle_increment, 0.0) * (self.free.size - 1)

    def ascending(self, values: FloatArray) -> FloatArray:
        """Return values per beam in counter-clockwise order, or back from it."""
        return values if self.angle_increment > 0.0 else values[::-1]

    def is_jump(self, near: FloatArray, far: FloatArray) -> NDArray[np.bool_]:
        """Return whether neighbouring lengths [m] end on different surfaces."""
        limit = self.jump_ratio * np.minimum(near, far) * self.increment + self.jump_distance
        with np.errstate(invalid="ignore"):  # two beams without a surface do not differ
            return np.asarray(np.abs(near - far) > limit)


def star_rings(fan: BeamFan, pose: Pose2D, corners: bool = True) -> tuple[FloatArray, ...]:
    """Return the outlines of the region that neighbouring beams enclose.

    Between two neighbouring beams lies a wedge. Where their free lengths a and b differ by more than
    ``jump_ratio * min(a, b) * |angle_increment| + jump_distance``, or the distances of the surfaces that they measured
    do, the wedge ends at the shorter one, else at the chord between both; surfaces that go on between the beams cap it
    (`continue_surfaces`). A wedge beside a beam of free length 0 is not seen at all.

    Parameters
    ----------
    fan : BeamFan
    pose : Pose2D
        Pose of the sensor [map].
    corners : bool
        Whether surfaces are continued between the beams; without, chords only.

    Returns
    -------
    tuple of ndarray, each shape (N, 2)
        Open counter-clockwise rings [m, map]. A sector starts at the sensor; a full circle in which all beams
        see is one ring without the sensor.

    Notes
    -----
    Deviation (C3-7, C3-8): the thesis draws the detected area as given; here it is built from discrete beams
    with the shorter neighbour at range jumps, and a sector includes the sensor.
    """
    increment = fan.increment
    free = _fold_overlap(fan.ascending(fan.free), increment)
    measured = free if fan.measured is None else _fold_overlap(fan.ascending(fan.measured), increment)
    surface = measured if fan.surface is None else _fold_overlap(fan.ascending(fan.surface), increment)
    closed = _TURN - (free.size - 1) * increment <= _CLOSING_GAP * increment
    angles = pose.heading + fan.first_direction + increment * np.arange(free.size)
    directions = np.column_stack((np.cos(angles), np.sin(angles)))
    if closed:
        free, measured, surface = (np.append(one, one[0]) for one in (free, measured, surface))
        directions = np.vstack((directions, directions[:1]))
    near, far = free[:-1], free[1:]
    shorter = np.minimum(near, far)
    jump_measured = fan.is_jump(measured[:-1], measured[1:]) | fan.is_jump(surface[:-1], surface[1:])
    jump = fan.is_jump(near, far) | jump_measured
    lengths = np.column_stack((np.where(jump, shorter, near), np.where(jump, shorter, far)))
    middle, found = np.zeros((len(jump), 2)), np.zeros(len(jump), dtype=np.bool_)
    if corners:
        hit = np.where(measured > 0.0, np.maximum(surface - fan.accuracy, measured), 0.0)
        noise = _NOISE * fan.accuracy
        lengths, middle, found = continue_surfaces(lengths, hit, directions, jump_measured, closed, noise)
    outline = np.stack((lengths[:, :1] * directions[:-1], middle, lengths[:, 1:] * directions[1:]), axis=1)
    return _collect(outline, found, shorter > 0.0, pose.position, closed)


def _fold_overlap(free: FloatArray, increment: float) -> FloatArray:
    """Drop beams past a full turn; the beams beside their directions keep the shorter length."""
    position = np.arange(free.size) - _TURN / increment
    extra = np.flatnonzero(position >= -_SAME_BEAM)
    if extra.size == 0:
        return free
    kept = np.array(free[: extra[0]])
    for beam in extra:
        nearest = round(float(position[beam]))
        if abs(position[beam] - nearest) <= _ALIGNED:
            beside = {nearest}
        else:
            beside = {math.floor(position[beam]), math.ceil(position[beam])}
        for neighbour in beside:
            kept[neighbour % kept.size] = min(kept[neighbour % kept.size], free[beam])
    return kept


def _collect(
    outline: FloatArray,
    has_corner: NDArray[np.bool_],
    seen: NDArray[np.bool_],
    origin: FloatArray,
    closed: bool,
) -> tuple[FloatArray, ...]:
    """Join runs of seen wedges; `outline` (W, 3, 2) holds first end, corner and second end of each from the sensor."""
    whole_circle = closed and bool(seen.all())
    if closed and not whole_circle:
        shift = -int(np.argmin(seen))
        outline, seen = np.roll(outline, shift, axis=0), np.roll(seen, shift)
        has_corner = np.roll(has_corner, shift)
    # the first point of a wedge repeats the last one of the wedge before it unless there is a jump
    differs = np.any(np.abs(outline[:, 0] - np.roll(outline[:, 2], 1, axis=0)) > _SAME_POINT, axis=1)
    keep = np.column_stack((differs, has_corner, np.ones(len(seen), dtype=np.bool_)))
    points = origin + outline
    if whole_circle:
        return (points[keep],)
    edges = np.flatnonzero(np.diff(seen, prepend=False, append=False))
    keep[edges[0::2], 0] = True
    return tuple(
        np.vstack((origin, points[begin:end][keep[begin:end]]))
        for begin, end in zip(edges[0::2], edges[1::2], strict=True)
    )


def shorten_fan(
    fan: BeamFan, pose: Pose2D, obstacles: FloatArray, depth: float
) -> tuple[BeamFan, FloatArray]:
    """Shorten beams to obstacles that lie a little inside the region they enclose.

    Parameters
    ----------
    fan : BeamFan
        As measured, not shortened before.
    pose : Pose2D
        Pose of the sensor [map].
    obstacles : ndarray, shape (K, 2)
        Points that are not free [m, map].
    depth : float
        Only points up to this far, along the ray, inside the outline [m]: a point deeper inside would cost all that the
        sensor sees behind it.

    Returns
    -------
    fan : BeamFan
        Both beams beside such a point end at its distance; its rings enclose no more than before.
    inside : ndarray, shape (K,)
        How far each point lies inside, square to the outline of its wedge [m]; 0 outside.
    """
    offset = obstacles - pose.position
    distance = np.hypot(offset[:, 0], offset[:, 1])
    bearing = np.arctan2(offset[:, 1], offset[:, 0]) - pose.heading - fan.first_direction
    surface = fan.free if fan.surface is None else fan.surface
    shortened, inside = _shorten(
        np.ascontiguousarray(fan.ascending(fan.free)),
        np.ascontiguousarray(fan.ascending(surface)),
        fan.increment,
        fan.jump_ratio,
        fan.jump_distance,
        distance,
        bearing,
        depth,
    )
    return replace(fan, free=fan.ascending(shortened), measured=fan.free), inside


@numba.njit(cache=True)
def _shorten(free, surface, increment, jump_ratio, jump_distance, distance, bearing, depth):  # type: ignore[no-untyped-def]
    result = free.copy()
    inside = np.zeros(distance.shape[0])
    beams = free.shape[0]
    closed = 2.0 * math.pi - (beams - 1) * increment <= 1.5 * increment
    for i in range(distance.shape[0]):
        place = (bearing[i] % (2.0 * math.pi)) / increment
        k = int(place)
        if k >= beams or (k == beams - 1 and not closed):
            continue
        following = (k + 1) % beams
        near, far = free[k], free[following]
        shorter = min(near, far)
        if shorter <= 0.0:
            continue
        jumps = abs(near - far) > jump_ratio * shorter * increment + jump_distance
        if surface[k] != surface[following]:  # both may be infinite
            nearer = min(surface[k], surface[following])
            jumps |= abs(surface[k] - surface[following]) > jump_ratio * nearer * increment + jump_distance
        if jumps:
            near = far = shorter
        angle = (place - k) * increment
        outline = (
            near * far * math.sin(increment) / (near * math.sin(angle) + far * math.sin(increment - angle))
        )
        passed = outline - distance[i]
        if passed <= _ON_OUTLINE:
            continue
        # Sine of the angle between the ray and the chord from beam to beam.
        chord = math.sqrt(near * near + far * far - 2.0 * near * far * math.cos(increment))
        slant = near * far * math.sin(increment) / max(chord * outline, 1e-12)
        if jumps:
            # Most range jumps are walls seen at a grazing angle: the slant of the steepest surface.
            slant = 1.0 / math.sqrt(1.0 + jump_ratio * jump_ratio)
        inside[i] = passed * min(slant, 1.0)
        if passed <= depth:
            result[k] = min(result[k], distance[i])
            result[following] = min(result[following], distance[i])
    return result, inside
