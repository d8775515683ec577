"""Memory never declares free what a body no faster than V_max could have reached.

The adversary is a swarm of bodies that no scanner may see: disks that move at V_max, through walls too, and are no more
when they touch what any scan truly showed. Their way is made of exact points, so whatever they reach, a real body could
have reached. None of them may ever stand in the area, however late, unsynchronised or absent the scans are. The
scanners measure walls and walkers by a ray caster of this test's own, with finer beams for what they truly showed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import nullcontext
from dataclasses import dataclass, field

import numpy as np
import pytest
import shapely
from hypothesis import example, given
from hypothesis import strategies as st

from snnav_core.area.fusion import AreaFusion, FusionSettings, PlanarSensor
from snnav_core.area.planar import UnoccupiedArea
from snnav_core.errors import InvalidInput
from snnav_core.sensing.scan import PlanarScan, ScanSettings
from snnav_core.types import FloatArray, Pose2D

ROOM = (10.0, 7.0)
STEPS = 6  # areas of one run
FINER = 3  # true beams between two beams of a scanner
GAPS = (
    0.5  # what lies between two beams is uncertain by so many gaps (0.05 measured for walkers, 0 for walls)
)
CELL = 0.12  # [m] of the swarm
DIRECTIONS = np.column_stack(
    (np.cos(turn := np.linspace(0.0, 2.0 * math.pi, 12, endpoint=False)), np.sin(turn))
)


@dataclass(frozen=True)
class Walker:
    """A disk that goes from waypoint to waypoint, back and forth, at one speed."""

    radius: float
    speed: float
    waypoints: FloatArray

    def at(self, time: float) -> FloatArray:
        legs = np.linalg.norm(np.diff(self.waypoints, axis=0), axis=1)
        marks = np.append(0.0, np.cumsum(legs))
        way = (self.speed * (time + 100.0)) % (2.0 * marks[-1])
        way = min(way, 2.0 * marks[-1] - way)
        return np.array([np.interp(way, marks, self.waypoints[:, axis]) for axis in (0, 1)])


@dataclass(frozen=True)
class Scanner:
    """A sensor, when it measures, when it is silent, how late its scans come, and how wrong its clock is."""

    sensor: PlanarSensor
    field_of_view: float
    increment: float
    range_max: float
    period: float
    offset: float
    silent: tuple[float, float]
    delays: FloatArray
    clock_error: float

    @property
    def beams(self) -> int:
        return int(self.field_of_view / self.increment) + 1


@dataclass(frozen=True)
class Site:
    """Walls, walkers, scanners, and how fast things may be."""

    boundary_speed: float
    interval: float
    clock_tolerance: float
    boxes: list[shapely.Polygon]
    walkers: list[Walker]
    scanners: list[Scanner]
    segments: FloatArray = field(repr=False)  # (S, 2, 2)

    def ranges(self, scanner: Scanner, time: float, finer: int = 1) -> FloatArray:
        """Return exact distances along beams; infinite beyond the range, NaN from inside of a body."""
        pose = scanner.sensor.pose
        count = finer * (scanner.beams - 1) + 1
        angles = pose.heading - 0.5 * scanner.field_of_view + scanner.increment / finer * np.arange(count)
        rays = np.column_stack((np.cos(angles), np.sin(angles)))
        start, edge = self.segments[:, 0] - pose.position, self.segments[:, 1] - self.segments[:, 0]
        cross = rays[:, :1] * edge[:, 1] - rays[:, 1:] * edge[:, 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            along = (start[:, 0] * edge[:, 1] - start[:, 1] * edge[:, 0]) / cross
            share = (start[:, 0] * rays[:, 1:] - start[:, 1] * rays[:, :1]) / cross
        nearest = np.where((along > 0.0) & (share >= 0.0) & (share <= 1.0), along, np.inf).min(axis=1)
        for walker in self.walkers:
            centre = walker.at(time) - pose.position
            if np.linalg.norm(centre) <= walker.radius + 0.01:
                return np.full(count, np.nan)
            ahead = rays @ centre
            aside = walker.radius**2 - (rays[:, 0] * centre[1] - rays[:, 1] * centre[0]) ** 2
            hit = (ahead > 0.0) & (aside >= 0.0)
            nearest[hit] = np.minimum(nearest[hit], ahead[hit] - np.sqrt(aside[hit]))
        return np.where(nearest <= scanner.range_max, nearest, np.inf)

    def shown(self, scanner: Scanner, time: float, size: float) -> shapely.Polygon:
        """Return what a scan truly showed to be free, widened by the size of a body that nobody sees."""
        pose, ranges = scanner.sensor.pose, self.ranges(scanner, time, FINER)
        if np.isnan(ranges).any():
            return shapely.Polygon()
        angles = (
            pose.heading - 0.5 * scanner.field_of_view + scanner.increment / FINER * np.arange(ranges.size)
        )
        reach = np.minimum(ranges, scanner.range_max)[:, None]
        ends = pose.position + reach * np.column_stack((np.cos(angles), np.sin(angles)))
        return shapely.Polygon(np.vstack((pose.position, ends))).buffer(size, quad_segs=4)


def random_site(seed: int, boundary_speed: float, interval: float, clock_tolerance: float) -> Site:
    generator = np.random.default_rng(seed)
    room = shapely.box(0.0, 0.0, *ROOM)
    corners = generator.uniform((1.0, 1.0), (8.0, 5.0), (generator.integers(0, 4), 2))
    boxes = [shapely.box(*corner, *(corner + generator.uniform(0.5, 2.0, 2))) for corner in corners]
    rings = [shapely.get_coordinates(shape) for shape in (room, *boxes)]
    segments = np.concatenate([np.stack((ring[:-1], ring[1:]), axis=1) for ring in rings])
    walkers = [
        Walker(
            generator.uniform(0.3, 0.5),
            boundary_speed * generator.choice((0.3, 1.0)),
            generator.uniform((0.5, 0.5), (9.5, 6.5), (4, 2)),
        )
        for _ in range(generator.integers(1, 4))
    ]
    scanners = [
        _random_scanner(generator, index, boxes, interval, clock_tolerance)
        for index in range(generator.integers(2, 4))
    ]
    return Site(boundary_speed, interval, clock_tolerance, boxes, walkers, scanners, segments)


def _random_scanner(
    generator: np.random.Generator,
    index: int,
    boxes: list[shapely.Polygon],
    interval: float,
    tolerance: float,
) -> Scanner:
    while True:
        place = generator.uniform((0.2, 0.2), (9.8, 6.8))
        if all(shapely.Point(place).distance(box) > 0.05 for box in boxes):
            break
    pose = Pose2D(float(place[0]), float(place[1]), generator.uniform(-math.pi, math.pi))
    begin = generator.uniform(0.0, STEPS * interval)
    return Scanner(
        PlanarSensor(f"s{index}", pose, ScanSettings(inf_is_free=bool(generator.integers(2)))),
        field_of_view=math.radians(generator.choice((90.0, 180.0, 240.0))),
        increment=math.radians(generator.choice((0.5, 1.0))),
        range_max=generator.uniform(3.0, 8.0),
        period=interval * generator.choice((0.4, 1.0, 1.7)),
        offset=interval * generator.choice((0.0, generator.uniform(0.0, 1.0))),
        silent=(begin, begin + interval * generator.uniform(0.0, 3.0)),
        delays=interval * generator.choice((0.0, 0.6, 1.2)) * generator.uniform(size=4 * STEPS),
        clock_error=generator.choice((0.0, tolerance, generator.uniform(-0.3, tolerance))),
    )


@dataclass(frozen=True)
class Measurement:
    """One scan on its way: when it was made, and when it comes."""

    time: float
    arrival: float
    scanner: Scanner


def measurements(site: Site) -> list[Measurement]:
    """Return all scans that come, in the order in which they are made."""
    made = []
    for scanner in site.scanners:
        for index, delay in enumerate(scanner.delays):
            time = scanner.offset + index * scanner.period
            if not scanner.silent[0] <= time <= scanner.silent[1]:
                made.append(Measurement(time, time + delay, scanner))
    return sorted(made, key=lambda one: one.time)


class Swarm:
    """Bodies that nobody saw, as many as count; `places` (N, 2) are their centres [m]."""

    def __init__(self, site: Site) -> None:
        self._speed, self._time = site.boundary_speed, 0.0
        x, y = (np.arange(-0.6, high + 0.6, CELL) for high in ROOM)
        self.places = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)

    def move(self, time: float, area: UnoccupiedArea, shown: shapely.Polygon | None = None) -> None:
        """Let them go on until `time`, into the next area above all; who touches what is shown then is no more."""
        step, self._time = self._speed * (time - self._time), time
        if step > 0.0:
            eager = self.places[area.clearance(self.places) > -step - 0.3]
            moved = (eager[:, None] + step * DIRECTIONS).reshape(-1, 2)
            self.places = np.concatenate((self.places, moved))
        if shown is not None:
            shapely.prepare(shown)
            self.places = self.places[~shapely.intersects_xy(shown, self.places[:, 0], self.places[:, 1])]
        deepest = np.argsort(-area.clearance(self.places), kind="stable")
        cells = np.floor(self.places[deepest] / CELL).astype(np.int64)
        _, first = np.unique(cells, axis=0, return_index=True)
        self.places = self.places[deepest[first]]


def areas(site: Site) -> Iterator[tuple[float, UnoccupiedArea, list[Measurement]]]:
    """Yield every area, its time, and what was measured since the one before, whenever it comes."""
    settings = FusionSettings(
        boundary_speed=site.boundary_speed,
        max_scan_age=1.5 * site.interval,
        clock_tolerance=site.clock_tolerance,
    )
    fusion = AreaFusion([scanner.sensor for scanner in site.scanners], settings)
    made = measurements(site)
    last = -math.inf
    for step in range(STEPS):
        time = (step + 1) * site.interval
        for one in sorted(made, key=lambda one: one.arrival):
            if last < one.arrival <= time:
                scanner = one.scanner
                scan = PlanarScan(
                    one.time + scanner.clock_error,
                    site.ranges(scanner, one.time),
                    -0.5 * scanner.field_of_view,
                    scanner.increment,
                    0.0,
                    scanner.range_max,
                )
                overtaken = scan.stamp < (fusion.latest_stamp(scanner.sensor.id) or -math.inf)
                refusal = pytest.raises(InvalidInput, match="older than its last")
                with refusal if overtaken else nullcontext():
                    fusion.add_scan(scanner.sensor.id, scan, one.arrival)
        yield time, fusion.area(time), [one for one in made if last < one.time <= time]
        last = time


@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from((0.0, 0.4, 1.0)),
    st.sampled_from((0.2, 0.5, 1.0)),
    st.sampled_from((0.0, 0.3)),
)
# A clock is 0.25 s behind: what was seen then must not cover for what was seen before.
@example(243, 1.0, 1.0, 0.0)
def test_the_area_holds_nothing_that_a_body_could_have_reached_unseen(
    seed: int, boundary_speed: float, interval: float, clock_tolerance: float
) -> None:
    site = random_site(seed, boundary_speed, interval, clock_tolerance)
    uncertain = max(GAPS * scanner.range_max * scanner.increment for scanner in site.scanners)
    swarm = Swarm(site)
    for time, area, made in areas(site):
        for one in made:
            swarm.move(one.time, area, site.shown(one.scanner, one.time, uncertain))
        swarm.move(time, area)
        assert area.clearance(swarm.places).max(initial=-1.0) <= 1e-6, f"reached unseen at {time} s"
        for walker in site.walkers:
            within = -float(area.clearance(walker.at(time)[None])[0])
            assert within >= walker.radius - uncertain - 1e-6, f"a walker is in the area at {time} s"
        for box in site.boxes:
            assert shapely.intersection(area.region, box.buffer(-uncertain)).area < 1e-9
        outside = shapely.difference(area.region, shapely.box(0.0, 0.0, *ROOM).buffer(uncertain))
        assert outside.area < 1e-9
