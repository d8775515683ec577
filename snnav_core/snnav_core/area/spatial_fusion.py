"""The unoccupied region of space from several depth cameras, with memory (Ch. 4, A(t))."""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from snnav_core.area.carving import Carver
from snnav_core.area.cell_distance import distance_to_cells
from snnav_core.area.grid import Grid
from snnav_core.area.spatial import SpatialArea
from snnav_core.area.spatial_contradictions import mark_contradictions
from snnav_core.area.spatial_rays import pass_through_robots, ways_to_walls
from snnav_core.errors import InvalidInput, ScanError
from snnav_core.sensing.depth import DepthCamera, DepthImage
from snnav_core.types import FloatArray

__all__ = ["SpatialFusion", "SpatialFusionSettings"]

_SAME_STAMP = 1e-6  # [s]
_ROUNDING = 1e-4  # [m]; of ranges and of ways to walls in single precision
_APEX = 0.71  # of a pixel's width: a right-angled corner between rays is nearer than they measure by no more


@dataclass(frozen=True)
class SpatialFusionSettings:
    """What the fusion has to know of the place and of the cameras.

    Parameters
    ----------
    grid : Grid
    walls : ndarray of uint8, shape (nx, ny, nz), or None
        Nonzero where a body that is known never to move reaches into the cell.
    walled_in : bool
        Whether the outside of the grid is known never to move (the walls of a room).
    boundary_speed : float
        V_max: nothing that may move is faster [m/s].
    range_accuracy : float
        Ranges are wrong by no more than this [m]; it is taken off what they show.
    reach : float
        Clearances beyond it are not told apart [m].
    robot_pad : float or None
        By how much the sphere of a robot is grown when its returns are taken out [m]; a diagonal of a cell by default.
    clock_tolerance : float
        An image may be stamped this far ahead of the clock at its arrival [s]. Every one counts as this much older than
        its stamp says.
    contradiction_depth : float
        A point that is measured deeper than this in what was seen free is counted as a contradiction, and is an
        obstacle [m]: something is faster than `boundary_speed`, thinner than what another camera can see, or wrong.

    Raises
    ------
    InvalidInput
        If a number is out of its range or the walls have not the shape of the grid.
    """

    grid: Grid
    walls: NDArray[np.uint8] | None = None
    walled_in: bool = True
    boundary_speed: float = 0.0
    range_accuracy: float = 0.0
    reach: float = 2.0
    robot_pad: float | None = None
    clock_tolerance: float = 0.0
    contradiction_depth: float = 0.2

    def __post_init__(self) -> None:
        for name in ("boundary_speed", "range_accuracy", "reach", "clock_tolerance", "contradiction_depth"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise InvalidInput(f"spatial fusion: {name} is {value}, must be a number of at least 0")
        if self.robot_pad is not None and not (math.isfinite(self.robot_pad) and self.robot_pad >= 0.0):
            raise InvalidInput(
                f"spatial fusion: robot_pad is {self.robot_pad}, must be a number of at least 0"
            )
        if self.walls is not None and self.walls.shape != self.grid.shape:
            raise InvalidInput(f"spatial fusion: walls have shape {self.walls.shape}, not {self.grid.shape}")

    @property
    def pad(self) -> float:
        """By how much the sphere of a robot is grown when its returns are taken out [m]."""
        return 2.0 * self.grid.half_diagonal if self.robot_pad is None else self.robot_pad


@dataclass
class _Eye:
    """A camera with what is worked out once for it."""

    camera: DepthCamera
    carver: Carver
    rays: FloatArray
    walls: NDArray[np.float32]  # how far each ray goes until it enters a known wall [m]
    behind: NDArray[np.float32]  # and until it comes out again
    last_stamp: float = -math.inf


@dataclass
class _Glance:
    """One image that waits to be carved, and the robots that were in it."""

    eye: _Eye
    image: DepthImage
    spheres: FloatArray = field(default_factory=lambda: np.empty((0, 4)))


class SpatialFusion:
    """Carves free space out of the unknown, image by image, and remembers it.

    Parameters
    ----------
    cameras : sequence of DepthCamera
    settings : SpatialFusionSettings

    Raises
    ------
    InvalidInput
        If two cameras have the same name.

    Notes
    -----
    Deviations: the union of what the cameras saw, not the intersection (C4-1); memory, as in the plane (C3-5): a ball
    that was free shrinks at V_max; known walls do not grow (C4-2): where a ray reached one, nothing else is in it.
    What cannot be measured between two rays is taken off: corners of a right angle or blunter, and the accuracy of
    the ranges. An image counts for what it is worth at its own stamp, also one that comes after newer ones of other
    cameras: its balls have shrunk then.
    """

    def __init__(self, cameras: Sequence[DepthCamera], settings: SpatialFusionSettings) -> None:
        self.settings = settings
        grid = settings.grid
        known = np.zeros(grid.shape, dtype=np.uint8) if settings.walls is None else settings.walls
        self._walls = np.ascontiguousarray(known, dtype=np.uint8)
        self._eyes: dict[str, _Eye] = {}
        for camera in cameras:
            if camera.id in self._eyes:
                raise InvalidInput(f"spatial fusion: two cameras are called {camera.id!r}")
            rays = np.ascontiguousarray(camera.model.rays() @ camera.rotation.T)
            walls, behind = ways_to_walls(camera, grid, self._walls, settings.walled_in)
            self._eyes[camera.id] = _Eye(camera, Carver(camera, grid), rays, walls, behind)
        self._static = self._to_walls()
        self._marked = np.zeros(grid.shape, dtype=np.uint8)
        self.reset()

    def reset(self) -> None:
        """Forget everything that was seen."""
        self._memory = np.zeros(self.settings.grid.shape, dtype=np.float32)
        self._time = -math.inf  # of the last area
        self._seen = -math.inf  # what is remembered holds then: the newest stamp that is part of it
        self._glances: list[_Glance] = []
        self.contradictions = dict.fromkeys(self._eyes, 0)
        """How many points each camera measured in the images of the last area where nothing should be."""
        for eye in self._eyes.values():
            eye.last_stamp = -math.inf

    def add_image(self, camera_id: str, image: DepthImage, robots: FloatArray | None = None) -> None:
        """Take an image in; it counts from the next `area` on.

        Parameters
        ----------
        camera_id : str
        image : DepthImage
        robots : ndarray, shape (K, 4), optional
            Centres [m, map] and radii [m] of the robots at the time of the image; their returns are taken out.

        Raises
        ------
        InvalidInput
            If the camera is unknown, or the robots are not finite (K, 4).
        ScanError
            If the image has not the size of the camera, or is not newer than the last one of it.
        """
        eye = self._eyes.get(camera_id)
        if eye is None:
            raise InvalidInput(f"spatial fusion: no camera {camera_id!r}; there are {sorted(self._eyes)}")
        image.measured(eye.camera.model)
        if image.stamp <= eye.last_stamp:
            raise ScanError(
                f"camera {camera_id!r}: image of {image.stamp:.3f} s came after that of {eye.last_stamp:.3f} s; "
                "left out"
            )
        spheres = np.empty((0, 4)) if robots is None else np.array(robots, dtype=np.float64).reshape(-1, 4)
        if not np.isfinite(spheres).all():
            raise InvalidInput("spatial fusion: robots must be finite: x, y, z, radius")
        eye.last_stamp = image.stamp
        self._glances.append(_Glance(eye, image, spheres))

    def declare_free(self, centre: FloatArray, radius: float) -> None:
        """Take a ball for free at the time of the area, because somebody says so: where a robot is put down.

        Parameters
        ----------
        centre : ndarray, shape (3,)
            [m, map]
        radius : float
            [m]
        """
        away = np.linalg.norm(self.settings.grid.centres() - centre, axis=-1)
        np.maximum(self._memory, (radius - away).astype(np.float32), out=self._memory)

    def area(self, time: float) -> SpatialArea:
        """Return what is proved free at a time [s].

        Raises
        ------
        InvalidInput
            If the time is not finite, or before the last one.
        """
        if not math.isfinite(time) or time < self._time - _SAME_STAMP:
            raise InvalidInput(
                f"spatial fusion: time {time} is not after {self._time}; reset after a jump back"
            )
        due = sorted(
            (one for one in self._glances if one.image.stamp <= time + _SAME_STAMP),
            key=lambda one: one.image.stamp,
        )
        self._glances = [one for one in self._glances if one.image.stamp > time + _SAME_STAMP]
        self.contradictions = dict.fromkeys(self._eyes, 0)
        while due:
            stamp = due[0].image.stamp
            group = [one for one in due if one.image.stamp <= stamp + _SAME_STAMP]
            due = due[len(group) :]
            self._see(group, stamp)
        self._time = max(self._time, time)
        if not math.isfinite(self._seen):
            self._seen = time
        left = self._shrunk(time - self._seen + self.settings.clock_tolerance)
        return SpatialArea(time, self.settings.grid, left, self._static)

    def _shrunk(self, passed: float) -> NDArray[np.float32]:
        """Return what is left of the memory after a time [s]."""
        way = passed * self.settings.boundary_speed
        if not (math.isfinite(way) and way > 0.0):
            return self._memory.copy()
        left: NDArray[np.float32] = np.maximum(self._memory - np.float32(way), np.float32(0.0))
        return left

    def _see(self, glances: Sequence[_Glance], stamp: float) -> None:
        """Take the images of one instant [s] in: at its stamp, or in what is remembered of a later one."""
        half = np.float32(self.settings.grid.half_diagonal)
        if stamp >= self._seen:
            self._memory = self._shrunk(stamp - self._seen)
            self._seen = stamp
            seen = self._clearance(glances, (self._memory >= half).astype(np.uint8))
        else:  # what is free now says nothing of then: the images stand alone
            seen = self._clearance(glances, np.zeros(self._memory.shape, dtype=np.uint8))
            seen -= np.float32((self._seen - stamp) * self.settings.boundary_speed)
        self._memory = np.maximum(self._memory, seen)
        self._cut(glances)

    def _cut(self, glances: Sequence[_Glance]) -> None:
        """Let nothing be free around points that were measured deep in what is."""
        settings, grid = self.settings, self.settings.grid
        nearer, found = np.float32(settings.range_accuracy + _ROUNDING), 0
        for glance in glances:
            eye = glance.eye
            count = mark_contradictions(
                self._marked,
                self._memory,
                settings.contradiction_depth,
                grid.origin,
                grid.spacing,
                glance.image.measured(eye.camera.model),
                eye.rays,
                eye.camera.position,
                eye.walls - nearer,
                glance.spheres,
                settings.pad,
            )
            self.contradictions[eye.camera.id] += count
            found += count
        if found:
            away = distance_to_cells(self._marked, grid.spacing, settings.reach)[0]
            self._memory = np.minimum(self._memory, away)
            self._marked[:] = 0

    def _clearance(self, glances: Sequence[_Glance], free: NDArray[np.uint8]) -> NDArray[np.float32]:
        """Carve images out of the cells that are not yet `free` and measure the clearance of all that are."""
        settings, grid = self.settings, self.settings.grid

        def carve(glance: _Glance) -> None:
            glance.eye.carver.carve(self._free_up_to(glance), free)

        with ThreadPoolExecutor(2) as pool:  # cells are set free only, by whom and when does not matter
            list(pool.map(carve, glances))
        for glance in glances:
            _free_spheres(free, grid, glance.spheres, settings.pad)
        solid = ((free == 0) & (self._walls == 0)).astype(np.uint8)
        if settings.walled_in:
            return distance_to_cells(solid, grid.spacing, settings.reach)[0]
        padded = np.pad(solid, 1, constant_values=1)
        return distance_to_cells(padded, grid.spacing, settings.reach)[0][1:-1, 1:-1, 1:-1]

    def _free_up_to(self, glance: _Glance) -> NDArray[np.float32]:
        """Up to where every pixel saw nothing that may move [m]."""
        settings, eye = self.settings, glance.eye
        model = eye.camera.model
        seen = glance.image.free_up_to(model, eye.camera.inf_is_free)
        accuracy = np.float32(settings.range_accuracy)
        reached = (seen > 0.0) & (seen + accuracy >= eye.walls)
        apex = np.float32(_APEX * max(model.column_step, model.row_step))
        free: NDArray[np.float32] = np.maximum(seen * (np.float32(1.0) - apex) - accuracy, np.float32(0.0))
        if len(glance.spheres):
            measured = glance.image.measured(model)
            pass_through_robots(free, measured, eye.rays, eye.camera.position, glance.spheres, settings.pad)
        free[reached] = np.maximum(free, eye.behind)[reached]
        return free

    def _to_walls(self) -> NDArray[np.float32]:
        """Distance of every centre to the known walls, less the accuracy of the ranges that end at them [m]."""
        settings = self.settings
        padded = np.pad(self._walls, 1, constant_values=1 if settings.walled_in else 0)
        clearance, _ = distance_to_cells(padded, settings.grid.spacing, settings.reach)
        inner: NDArray[np.float32] = clearance[1:-1, 1:-1, 1:-1] - np.float32(settings.range_accuracy)
        return inner


def _free_spheres(free: NDArray[np.uint8], grid: Grid, spheres: FloatArray, pad: float) -> None:
    """Free the cells that lie in the padded sphere of a robot whole, in place."""
    for x, y, z, radius in spheres.tolist():
        centre, grown = np.array((x, y, z)), radius + pad
        low = np.floor((centre - grown - grid.origin) / grid.spacing).astype(int)
        high = np.ceil((centre + grown - grid.origin) / grid.spacing).astype(int)
        low, high = np.maximum(low, 0), np.minimum(high, grid.shape)
        if (high <= low).any():
            continue
        axes = [np.arange(low[axis], high[axis]) for axis in range(3)]
        cells = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        offset = np.abs(grid.origin + grid.spacing * (cells + 0.5) - centre) + 0.5 * grid.spacing
        inside = np.einsum("...i,...i->...", offset, offset) <= grown * grown
        block = free[low[0] : high[0], low[1] : high[1], low[2] : high[2]]
        block[inside] = 1
