"""From the images of all cameras, and where the robots were, to the unoccupied region of space: inputs lie."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from snnav_core.area.intake import check_clock, image_intake
from snnav_core.area.robots import RobotTrack
from snnav_core.area.spatial import SpatialArea
from snnav_core.area.spatial_fusion import SpatialFusion, SpatialFusionSettings
from snnav_core.errors import InvalidInput
from snnav_core.flight_types import FlyerState
from snnav_core.sensing.depth import DepthCamera, DepthImage
from snnav_core.types import TIME_TOLERANCE, FloatArray, RobotSpec

__all__ = ["CameraNetwork", "spheres_at"]


def spheres_at(tracks: Collection[RobotTrack], time: float, most_slack: float = 0.0) -> FloatArray:
    """Return the spheres of robots at a time.

    Parameters
    ----------
    tracks : collection of RobotTrack
    time : float
        [s]
    most_slack : float
        A robot that may be farther than this from where it is taken to be is left out [m].

    Returns
    -------
    ndarray, shape (K, 4)
        Centres and radii [m, map], of the robots whose place is known.
    """
    spheres = []
    for track in tracks:
        found = track.place(time)
        if found is not None and max(found[1], track.astray(time)) <= most_slack:
            spheres.append((*found[0].tolist(), track.robot.radius))
    return np.array(spheres, dtype=np.float64).reshape(-1, 4)


class CameraNetwork:
    """Takes images and states of robots in, refuses those that lie, and fuses the rest.

    Parameters
    ----------
    cameras : sequence of DepthCamera
    settings : SpatialFusionSettings
        An image may be stamped ahead of the clock by `clock_tolerance`.
    robots : sequence of RobotSpec
        Those that the cameras see; `add_state` says where they are.
    never_repeats : collection of str
        Ids of the cameras that have noise: two equal images come from one that froze.

    Raises
    ------
    InvalidInput
        If two cameras or two robots have the same name.

    Notes
    -----
    Deviation (C4-23): what cameras saw of a robot is taken out where its states say that it was. Up to 0.2 s after the
    last state it is taken to have gone on, and between two states to have flown straight, as long as it cannot be
    farther than half of `robot_pad` from there. Where its place is unknown its returns stay obstacles.
    """

    def __init__(
        self,
        cameras: Sequence[DepthCamera],
        settings: SpatialFusionSettings,
        robots: Sequence[RobotSpec] = (),
        never_repeats: Collection[str] = (),
    ) -> None:
        self.settings = settings
        self._fusion = SpatialFusion(cameras, settings)
        self._models = {camera.id: camera.model for camera in cameras}
        self._intakes = {camera.id: image_intake(camera, camera.id in never_repeats) for camera in cameras}
        self._tracks: dict[str, RobotTrack] = {}
        for robot in robots:
            self.add_robot(robot)
        self.reset()

    def reset(self) -> None:
        """Forget all images, states of robots and the memory, as after a jump of time."""
        self._fusion.reset()
        for track in self._tracks.values():
            track.clear()
        self._latest: dict[str, DepthImage] = {}
        self._waiting: list[tuple[str, DepthImage]] = []

    def add_robot(self, robot: RobotSpec) -> None:
        """Know one more robot.

        Raises
        ------
        InvalidInput
            If there is one of this name.
        """
        if robot.id in self._tracks:
            raise InvalidInput(f"robot {robot.id} is known already; robot ids must be different")
        self._tracks[robot.id] = RobotTrack(robot)

    def remove_robot(self, robot_id: str) -> None:
        """Forget a robot that was taken out of the workspace; a name that is not known is no fault."""
        self._tracks.pop(robot_id, None)

    def add_state(self, state: FlyerState, now: float | None = None) -> None:
        """Take where a robot is; before the `area` of the time at which cameras see it there.

        Parameters
        ----------
        state : FlyerState
        now : float, optional
            Time at its arrival [s]: a stamp ahead of it lies.

        Raises
        ------
        InvalidInput
            If the robot is unknown, a number is not finite, or the state is older than the last one or ahead of `now`
            by more than `clock_tolerance`.
        """
        check_clock(f"state of robot {state.id!r}", state.stamp, now, self.settings.clock_tolerance)
        if state.id not in self._tracks:
            raise InvalidInput(f"state of unknown robot {state.id!r}; known: {sorted(self._tracks)}")
        self._tracks[state.id].add_flyer(state)

    def add_image(self, camera_id: str, image: DepthImage, now: float | None = None) -> None:
        """Take an image; it counts from the first `area` of its stamp or later on.

        One that is refused leaves everything as it was, one that came before is taken for it.

        Parameters
        ----------
        camera_id : str
        image : DepthImage
        now : float, optional
            Time at its arrival [s]: a stamp ahead of it lies.

        Raises
        ------
        InvalidInput
            If the camera is unknown, the stamp is ahead of `now` by more than `clock_tolerance`, older than the last
            one, or that of other ranges, or if a device that never repeats itself froze.
        ScanError
            If the image has not the size of the camera.
        """
        intake = self._intakes.get(camera_id)
        if intake is None:
            raise InvalidInput(f"image of unknown camera {camera_id!r}; known: {sorted(self._intakes)}")
        image.check_size(self._models[camera_id])
        if intake.is_repeated(image, self._latest.get(camera_id), now, self.settings.clock_tolerance):
            return
        self._latest[camera_id] = image
        self._waiting.append((camera_id, image))

    def latest_stamp(self, camera_id: str) -> float | None:
        """Stamp of the latest image of a camera [s], or None."""
        latest = self._latest.get(camera_id)
        return None if latest is None else latest.stamp

    @property
    def contradictions(self) -> dict[str, int]:
        """How many points each camera measured where nothing should be, in the images of the last area."""
        return self._fusion.contradictions

    def area(self, time: float) -> SpatialArea:
        """Return what is proved free at a time [s].

        Raises
        ------
        InvalidInput
            If the time is not finite, or before the last one.
        """
        later = []
        for camera_id, image in self._waiting:
            if image.stamp > time + TIME_TOLERANCE:
                later.append((camera_id, image))
                continue
            spheres = spheres_at(self._tracks.values(), image.stamp, 0.5 * self.settings.pad)
            self._fusion.add_image(camera_id, image, spheres)
        self._waiting = later
        return self._fusion.area(time)
