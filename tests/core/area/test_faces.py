"""Motion told by faces, and hits that are found to go along with a body."""

from __future__ import annotations

import numpy as np
import pytest

from snnav_core.area.drift import Drift
from snnav_core.area.faces import face_information, on_faces
from snnav_core.area.laying import densest
from snnav_core.area.parting import Measurements
from snnav_core.area.returns import FusedReturns
from snnav_core.area.sightings import Sightings
from snnav_core.area.track import Track
from snnav_core.types import FloatArray

NOISE = 0.005
TIMES = 0.3 * np.arange(5)


def corner(velocity: FloatArray, side_hits: int) -> tuple[FloatArray, ...]:
    """Hits on a face of 1 m, and on a side that a scanner at the origin grazes: points, normals, beams, times."""
    rng = np.random.default_rng(3)
    points, normals, times = [], [], []
    for time in TIMES:
        face = np.column_stack((np.full(20, 4.0), np.linspace(0.5, 1.5, 20)))
        along = np.sort(rng.uniform(0.1, 1.0, side_hits))
        side = np.column_stack((4.0 + along, np.full(side_hits, 0.5)))
        noisy = np.concatenate((face, side)) + time * velocity
        ways = noisy / np.hypot(*noisy.T)[:, None]
        points.append(noisy + NOISE * rng.standard_normal(len(noisy))[:, None] * ways)
        normals.append(np.concatenate((np.tile([-1.0, 0.0], (20, 1)), np.zeros((side_hits, 2)))))
        times.append(np.full(len(noisy), time))
    found = np.concatenate(points)
    beams = found / np.hypot(*found.T)[:, None]
    return found, np.concatenate(normals), beams, np.concatenate(times)


def test_few_hits_on_a_grazed_side_tell_the_motion_square_to_it() -> None:
    velocity = np.array([0.3, 0.4])
    points, normals, beams, times = corner(velocity, 2)
    start = velocity + np.array([0.01, -0.02])
    information, pull = face_information(points, normals, beams, times, start, NOISE, 0.03)
    across, along = np.sqrt(np.diag(np.linalg.inv(information)))
    found = np.linalg.solve(information, pull)
    assert across < along < 0.02
    assert found == pytest.approx(velocity, abs=4.0 * along)


def test_a_single_face_says_nothing_of_a_motion_along_it() -> None:
    velocity = np.array([0.2, 0.3])
    points, normals, beams, times = corner(velocity, 0)
    information, _ = face_information(points, normals, beams, times, velocity, NOISE)
    assert np.linalg.eigvalsh(information)[0] < 1e-3 * np.linalg.eigvalsh(information)[1]


def test_hits_of_one_time_tell_no_motion() -> None:
    points, normals, beams, times = corner(np.zeros(2), 3)
    now = times == 0.0
    information, pull = face_information(
        points[now], normals[now], beams[now], times[now], np.zeros(2), NOISE
    )
    assert not information.any()
    assert not pull.any()


def test_hits_that_are_not_in_line_are_on_no_face() -> None:
    points, normals, beams, _ = corner(np.zeros(2), 0)
    points, normals = np.vstack((points, [[4.3, 0.5]])), np.vstack((normals, [[0.0, 0.0]]))
    beams = points / np.hypot(*points.T)[:, None]
    numbers = on_faces(points, normals, beams, NOISE)
    assert (numbers[:-1] == numbers[0]).all()
    assert numbers[-1] != numbers[0]


def test_the_motion_at_which_hits_lie_over_each_other_is_found_from_afar() -> None:
    velocity = np.array([0.6, -0.5])
    angles = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)
    normals = np.column_stack((np.cos(angles), np.sin(angles)))
    points = np.concatenate([0.4 * normals + time * velocity for time in TIMES])
    offsets = 12 * np.arange(6)
    found = densest(points, np.tile(normals, (5, 1)), np.repeat(TIMES, 12), offsets, np.zeros(2))
    assert found == pytest.approx(velocity, abs=0.11)


def scan(points: FloatArray, beams: FloatArray, time: float) -> FusedReturns:
    count = len(points)
    zeros = np.zeros(count, dtype=np.int64)
    return FusedReturns(points, np.full(count, time), zeros, beams, np.zeros((1, 2)), np.array([0.01]))


def test_hits_that_go_along_with_a_body_are_added_to_it() -> None:
    """A face whose other half was another track at first, a single hit in line with it, and a post beside it."""
    velocity, post = np.array([0.0, 0.4]), np.array([[3.0, 2.2], [3.0, 2.25], [3.0, 2.3]])
    measurements, sightings = Measurements(1.5), Sightings(1.5, 0.04)
    track = Track(1)
    rows = np.linspace(0.0, 0.9, 19)
    for step, time in enumerate((0.0, 0.3, 0.6)):
        face = np.column_stack((np.full(19, 3.0), rows)) + time * velocity
        points = np.concatenate((face, post))
        beams = np.concatenate((10 + 13 * step + np.arange(19), [200, 201, 202]))
        returns = scan(points, beams, time)
        sightings.take(time, returns)
        half = np.arange(22) < (9 if step == 0 else 19)
        single = np.arange(22) == 18 if step == 0 else np.zeros(22, dtype=np.bool_)
        fresh = np.ones(22, dtype=np.bool_)
        measurements.take(time, returns, single, np.where(np.arange(22) >= 19, 5, -1), fresh)
        track.take(measurements.sample(half), 1.5)
    track.moving, track.drift = True, Drift(velocity, 1e-4 * np.eye(2), 1.0)
    assert measurements.gather(track, [5], sightings, NOISE)
    assert [len(sample.points) for sample in track.samples] == [19, 19, 19]
    assert not measurements.gather(track, [5], sightings, NOISE)  # nothing is left
