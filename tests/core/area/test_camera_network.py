"""The network of cameras takes what is new, refuses what lies and says why, and takes robots out by their states."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from snnav_core.area.camera_network import CameraNetwork, spheres_at
from snnav_core.area.grid import Grid
from snnav_core.area.robots import LONGEST_EXTRAPOLATION, RobotTrack
from snnav_core.area.spatial_fusion import SpatialFusion, SpatialFusionSettings
from snnav_core.errors import InvalidInput
from snnav_core.flight_types import FlyerState
from snnav_core.sensing.depth import DepthCamera, DepthImage, equal_angle, looking_at
from snnav_core.types import FloatArray, RobotSpec
from support.box_world import image

ROOM = np.array([[0.0, 0.0, 0.0], [4.0, 3.0, 2.0]])
SETTINGS = SpatialFusionSettings(Grid.covering(ROOM[0], ROOM[1], 0.1), boundary_speed=0.1)
PLACES = {"low": np.array([0.1, 0.1, 0.3]), "high": np.array([3.9, 2.9, 1.9])}
EYES = {
    name: DepthCamera(name, place, looking_at(place, ROOM.mean(axis=0)), equal_angle(48, 48))
    for name, place in PLACES.items()
}
BEE = RobotSpec("bee", 0.2, 0.7, 2.0)
MIDDLE = np.array([2.0, 1.5, 1.0])
AHEAD = np.array([1.0, 0.0, 0.0])


def network(**changes: Any) -> CameraNetwork:
    return CameraNetwork(list(EYES.values()), SETTINGS, **{"robots": [BEE], **changes})


def seen(name: str, stamp: float, robot: FloatArray | None = None) -> DepthImage:
    boxes = np.empty((0, 2, 3)) if robot is None else np.array([[robot - 0.1, robot + 0.1]])
    return image(EYES[name], boxes, ROOM, stamp)


def state(stamp: float, place: FloatArray = MIDDLE, speed: float = 0.0) -> FlyerState:
    return FlyerState("bee", place, AHEAD, stamp, speed)


def test_the_area_is_that_of_the_fusion_with_the_robots_where_their_states_say() -> None:
    ours, plain = network(), SpatialFusion(list(EYES.values()), SETTINGS)
    for stamp in (1.0, 1.5):
        place = MIDDLE + 0.4 * (stamp - 1.0) * AHEAD
        for name in EYES:
            ours.add_image(name, seen(name, stamp, place), stamp)
            plain.add_image(name, seen(name, stamp, place), np.array([[*place, 0.2]]))
        ours.add_state(state(stamp, place))  # comes after the images
        area, other = ours.area(stamp), plain.area(stamp)
        np.testing.assert_array_equal(area.moving, other.moving)
        assert area.clearance_at(place[None])[0] > 0.4
    assert ours.latest_stamp("low") == 1.5


def test_between_two_states_a_robot_is_in_between() -> None:
    ours = network()
    ours.add_state(state(1.0, MIDDLE))
    ours.add_state(state(1.2, MIDDLE + 0.14 * AHEAD))
    place = MIDDLE + 0.07 * AHEAD
    for name in EYES:
        ours.add_image(name, seen(name, 1.1, place))
    assert ours.area(1.2).clearance_at(place[None])[0] > 0.4


def test_a_robot_whose_place_is_unknown_stays_an_obstacle() -> None:
    for states in ((), (0.0,), (0.0, 5.0)):
        ours = network()
        for stamp in states:
            ours.add_state(state(stamp))
        for name in EYES:
            ours.add_image(name, seen(name, 2.5, MIDDLE))
        assert ours.area(2.5).clearance_at(MIDDLE[None])[0] <= 0.0


def test_spheres_after_the_last_state_are_known_as_far_as_they_cannot_be_wrong() -> None:
    track = RobotTrack(BEE)
    track.add_flyer(state(1.0, MIDDLE, 0.7))
    np.testing.assert_allclose(spheres_at([track], 1.1, 0.08), [[2.07, 1.5, 1.0, 0.2]])
    assert len(spheres_at([track], 1.15, 0.08)) == 0
    assert len(spheres_at([track], 1.15, math.inf)) == 1
    assert len(spheres_at([track], 1.01 + LONGEST_EXTRAPOLATION, math.inf)) == 0
    assert spheres_at([], 1.0).shape == (0, 4)


def test_the_same_image_twice_is_taken_once() -> None:
    ours = network(never_repeats=["low"])
    for _ in range(2):
        ours.add_image("low", seen("low", 1.0), 1.0)
    first = ours.area(1.0)
    ours.add_image("low", seen("low", 1.0), 1.1)
    assert np.array_equal(first.moving, ours.area(1.0).moving)


@pytest.mark.parametrize(
    ("lie", "said"),
    [
        (
            lambda it: it.add_image("west", seen("low", 1.0)),
            r"unknown camera 'west'; known: \['high', 'low'\]",
        ),
        (lambda it: it.add_image("low", DepthImage(1.0, np.ones((4, 5)))), "5 x 4 pixels"),
        (
            lambda it: it.add_image("low", seen("low", 1.2), 1.0),
            "image of low stamped 1.200 s is 0.200 s ahead",
        ),
        (
            lambda it: it.add_image("low", seen("low", 0.4), 1.0),
            r"0.400 s is older than its last \(0.500 s\)",
        ),
        (lambda it: it.add_image("low", seen("low", 0.5, MIDDLE), 1.0), "differs from its last"),
        (lambda it: it.add_image("low", seen("low", 0.9), 1.0), "image of low stamped 0.900 s is frozen"),
        (lambda it: it.add_state(state(1.2), 1.0), "state of robot 'bee' stamped 1.200 s is 0.200 s ahead"),
        (lambda it: it.add_state(state(0.4)), r"0.400 s is older than its last \(0.500 s\)"),
        (lambda it: it.add_state(state(math.nan)), "nan"),
        (lambda it: it.add_state(state(1.0, speed=math.nan)), "is not finite; check its odometry"),
        (lambda it: it.add_state(FlyerState("fly", MIDDLE, AHEAD, 1.0)), "state of unknown robot 'fly'"),
        (lambda it: it.add_robot(BEE), "robot bee is known already"),
        (lambda it: it.area(0.2), "is not after 0.5; reset after a jump back"),
    ],
)
def test_what_lies_is_refused_in_words_and_changes_nothing(
    lie: Callable[[CameraNetwork], object], said: str
) -> None:
    networks = [network(never_repeats=["low"]) for _ in range(2)]
    for one in networks:
        one.add_state(state(0.5))
        one.add_image("low", seen("low", 0.5))
        one.area(0.5)
    with pytest.raises(InvalidInput, match=said):
        lie(networks[0])
    first, second = (one.area(1.0).moving for one in networks)
    np.testing.assert_array_equal(first, second)


def test_a_camera_without_noise_may_repeat_itself() -> None:
    ours = network()
    for stamp in (0.5, 0.9):
        ours.add_image("low", seen("low", stamp))
    assert ours.latest_stamp("low") == 0.9


def test_robots_come_and_go_and_a_reset_forgets_all_but_them() -> None:
    ours = network()
    ours.add_state(state(5.0))
    ours.add_image("low", seen("low", 5.0))
    assert (ours.area(5.0).moving > 0.0).any()
    ours.reset()
    assert ours.latest_stamp("low") is None
    ours.add_state(state(0.0))
    assert not (ours.area(0.0).moving > 0.0).any()
    ours.remove_robot("bee")
    ours.remove_robot("bee")
    with pytest.raises(InvalidInput, match="unknown robot"):
        ours.add_state(state(1.0))
    ours.add_robot(BEE)
    ours.add_state(state(0.5))


def test_an_image_stamped_ahead_within_the_tolerance_counts_from_its_stamp_on() -> None:
    ahead = SpatialFusionSettings(SETTINGS.grid, boundary_speed=0.1, clock_tolerance=0.3)
    ours = CameraNetwork(list(EYES.values()), ahead)
    ours.add_image("low", seen("low", 1.2), 1.0)
    assert not (ours.area(1.0).moving > 0.0).any()
    assert (ours.area(1.2).moving > 0.0).any()


@pytest.mark.parametrize(("gap", "is_taken_out"), [(0.05, True), (0.2, True), (0.6, False), (1.9, False)])
def test_between_states_far_apart_a_robot_may_have_been_elsewhere(gap: float, is_taken_out: bool) -> None:
    ours = network()
    for stamp in (1.0, 1.0 + gap):
        ours.add_state(state(stamp))  # it may have flown away and come back
    between = 1.0 + 0.5 * gap
    for name in EYES:
        ours.add_image(name, seen(name, between, MIDDLE), between)  # the robot, or something in its place
    assert (float(ours.area(between).clearance_at(MIDDLE[None])[0]) > 0.3) == is_taken_out
