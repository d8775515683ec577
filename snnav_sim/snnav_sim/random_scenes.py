"""Random halls whose sensors fail: what a campaign of faulty runs is made of."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from snnav_sim.scene_faults import FAULT_KINDS
from snnav_sim.scene_types import Circle, Fault, Mover, Point, Polygon, RobotScene, Scene, SensorScene, Shape
from snnav_sim.world import World, mover_positions

__all__ = ["faulty_scene"]

_STREAM = 0x5CE4E  # keeps these random numbers apart from those of the devices
_TRIES = 500
_RESERVE = 0.4  # [m] that the way of the robot is wider than it must be
_WAY = 6.0  # [m] from start to target at least
_WALKER = 0.25  # [m], radius
_AHEAD = 0.02  # [m] that a walker keeps more than it must
_SHORTEST_WALK = 2.0  # [s]
_LONGEST_FAULT = 9.0  # [s]
_WHILE_SOMEBODY_COMES = 0.8  # share of faults at that time
_FOR_EVER = 0.1  # share of faults that do not end
_SEVERE = 0.5  # share of kinds that meet all sensors at once
_RECOVERY = 1.0  # [s] that a sensor works after it was frozen, before something else happens to it

Draws = np.random.Generator


def faulty_scene(seed: int, kinds: Sequence[str] | None = None) -> Scene:
    """Return a random hall that a robot can cross while everything works, and sensors that fail on the way.

    Parameters
    ----------
    seed : int
        The scene depends on it and on `kinds` only; it is the seed of the scene too.
    kinds : sequence of str, optional
        Kinds of faults, see `snnav_sim.scene_faults.FAULT_KINDS`; each of them happens. All of them when left out.

    Returns
    -------
    Scene
        12 to 20 m wide and long, with two to four noisy range finders at rates of their own, up to four obstacles,
        up to two walkers no faster than V_max, and one robot. In every fifth scene V_max is 0, and nobody walks.

    Raises
    ------
    ValueError
        If a kind is not known.

    Notes
    -----
    What the scenes leave out, because no navigator can answer for it:

    - *Walkers do not see the robot.* One would walk into a robot that has stopped, and nothing is promised to a robot
      that stands longer than its window. So walkers move only where the robot, at full speed from its first decision
      that knows of any scan, cannot yet be within the safety margin of them. They are aimed at its way and then stand
      in it, from the latest moment that this allows: who trusts a scan older than it says drives into them.
    - *A frozen device whose last good scan is lost too* cannot be told from a working one: nothing else happens to a
      sensor while it is frozen or just before.
    - *A clock that is ahead by less than its scans are old when they are taken* cannot be noticed. Clocks are ahead by
      more than a sampling interval, and scans of such a sensor are not delayed meanwhile; behind, by anything.
    """
    kinds = tuple(FAULT_KINDS) if kinds is None else tuple(kinds)
    for kind in kinds:
        if kind not in FAULT_KINDS:
            raise ValueError(f"kind {kind!r} is not known; give some of {', '.join(FAULT_KINDS)}")
    draws = np.random.default_rng([_STREAM, seed])
    scene = replace(_hall(draws), name=f"faulty_{seed}", seed=seed)
    scene = replace(scene, movers=_walkers(draws, scene))
    plans = _fault_plan(draws, kinds, scene)
    sensors = tuple(replace(sensor, faults=plan) for sensor, plan in zip(scene.sensors, plans, strict=True))
    return replace(scene, sensors=sensors, description=f"Random hall, faults: {', '.join(kinds)}")


def _between(draws: Draws, low: float, high: float, digits: int = 2) -> float:
    return round(float(draws.uniform(low, high)), digits)


def _hall(draws: Draws) -> Scene:
    """A hall whose robot has a way while all sensors work, the speed of the boundary taken into account."""
    for _ in range(_TRIES):
        width, depth = _between(draws, 12.0, 20.0, 1), _between(draws, 12.0, 20.0, 1)
        still = draws.random() < 0.2
        speed = _between(draws, 0.6, 1.0)
        scene = Scene(
            name="hall",
            sampling_interval=float(draws.choice([0.25, 0.5])),
            border=Polygon(((0.0, 0.0), (width, 0.0), (width, depth), (0.0, depth))),
            safety_margin=0.5,
            sensors=_sensors(draws, width, depth),
            obstacles=_obstacles(draws, width, depth),
            boundary_speed=0.0 if still else _between(draws, 0.15, min(0.5, 0.6 * speed)),
            time_limit=150.0,
        )
        ends = _way(draws, scene)
        if ends is not None:
            start, target = ends
            heading = math.atan2(target[1] - start[1], target[0] - start[0])
            heading += float(draws.choice([0.0, draws.uniform(-math.pi, math.pi)], p=(0.7, 0.3)))
            heading = math.radians(round(math.degrees(heading)) % 360)
            robot = RobotScene("robot_1", start, heading, target, speed, 2.0 * speed, 0.25)
            return replace(scene, robots=(robot,))
    raise RuntimeError(f"no hall with a way for the robot in {_TRIES} tries")


def _sensors(draws: Draws, width: float, depth: float) -> tuple[SensorScene, ...]:
    """Two to four devices on different walls, or in corners, looking inwards."""
    sides = draws.permutation(4)[: int(draws.integers(2, 5))].tolist()
    return tuple(_sensor(draws, f"lms_{number}", side, width, depth) for number, side in enumerate(sides, 1))


def _sensor(draws: Draws, name: str, side: int, width: float, depth: float) -> SensorScene:
    along = float(draws.choice([0.02, _between(draws, 0.2, 0.8), 0.98]))
    x, y = [(along, 0.01), (0.99, along), (1.0 - along, 0.99), (0.01, 1.0 - along)][side]
    turn = {0.02: -45.0, 0.98: 45.0}.get(along, 0.0)  # out of a corner, along its diagonal
    heading = (90.0 * (side + 1) + turn) % 360.0
    period = _between(draws, 0.1, 0.5)
    view = math.radians(180.0)
    return SensorScene(
        id=name,
        device="lms200",
        position=(round(x * width, 2), round(y * depth, 2)),
        heading=math.radians(heading),
        field_of_view=view,
        resolution=math.radians(0.5),
        range_max=30.0,
        angle_min=-view / 2.0,
        noise="lms200",
        scan_period=period,
        scan_offset=_between(draws, 0.001, 0.9 * period, 3),
    )


def _obstacles(draws: Draws, width: float, depth: float) -> tuple[Shape, ...]:
    shapes: list[Shape] = []
    for _ in range(int(draws.integers(0, 5))):
        x, y = _between(draws, 2.0, width - 2.0), _between(draws, 2.0, depth - 2.0)
        if draws.random() < 0.5:
            shapes.append(Circle(x, y, _between(draws, 0.2, 0.8)))
        else:
            half_x, half_y = _between(draws, 0.2, 1.0), _between(draws, 0.2, 1.0)
            corners = ((-half_x, -half_y), (half_x, -half_y), (half_x, half_y), (-half_x, half_y))
            shapes.append(Polygon(tuple((round(x + dx, 2), round(y + dy, 2)) for dx, dy in corners)))
    return tuple(shapes)


def _safe_region(scene: Scene) -> BaseGeometry:
    """Where a robot is safe for a whole window, and a little more [m, map]."""
    reach = scene.boundary_speed * scene.time_window * scene.sampling_interval
    return World(scene).true_unoccupied_area().buffer(-(scene.safety_margin + reach + _RESERVE))


def _way(draws: Draws, scene: Scene) -> tuple[Point, Point] | None:
    """Start and target in one piece of what can safely be driven on, or None."""
    parts = [part for part in shapely.get_parts(_safe_region(scene)) if part.area > 1.0]
    if not parts:
        return None
    part = max(parts, key=shapely.area)
    shapely.prepare(part)
    low_x, low_y, high_x, high_y = part.bounds
    for _ in range(20):
        ends = [(_between(draws, low_x, high_x), _between(draws, low_y, high_y)) for _ in range(2)]
        if math.dist(*ends) >= _WAY and all(part.contains(shapely.Point(end)) for end in ends):
            return ends[0], ends[1]
    return None


def _walkers(draws: Draws, scene: Scene) -> tuple[Mover, ...]:
    if scene.boundary_speed == 0.0:
        return ()
    walkers: list[Mover] = []
    for number in range(1, int(draws.choice(3, p=(0.2, 0.4, 0.4))) + 1):
        tries = (_walker(draws, scene, f"walker_{number}") for _ in range(_TRIES))
        found = next((walker for walker in tries if walker is not None), None)
        if found is not None and _target_is_free(scene, [*walkers, found]):
            walkers.append(found)
    return tuple(walkers)


def _target_is_free(scene: Scene, walkers: Sequence[Mover]) -> bool:
    """Whether the target is as safe as the halls demand it while walkers stand where they end, shadows included."""
    bodies = tuple(Circle(*walker.waypoints[-1], _WALKER) for walker in walkers)
    safe = _safe_region(replace(scene, obstacles=scene.obstacles + bodies))
    return bool(safe.contains(shapely.Point(scene.robots[0].target)))


def _walker(draws: Draws, scene: Scene, name: str) -> Mover | None:
    """Somebody who walks to the way of the robot, by a bend perhaps, and arrives just in time; None if that fails."""
    (robot,) = scene.robots
    start, way = np.array(robot.start), np.array(robot.target) - np.array(robot.start)
    meeting = start + draws.uniform(0.25, 0.95) * way + draws.normal(0.0, 0.2, 2)
    apart = _WALKER + scene.safety_margin + _AHEAD
    walked = scene.sampling_interval + (float(np.hypot(*(meeting - start))) - apart) / robot.speed  # [s]
    speed = float(draws.choice([1.0, draws.uniform(0.5, 1.0)])) * scene.boundary_speed
    length, share = walked * speed, draws.choice([1.0, draws.uniform(0.3, 0.9)])
    first = draws.uniform(0.0, 2.0 * math.pi)
    turned = first + draws.uniform(-2.0, 2.0)
    bend = meeting + share * length * np.array([math.cos(first), math.sin(first)])
    begin = bend + (1.0 - share) * length * np.array([math.cos(turned), math.sin(turned)])
    corners = np.array([begin, bend, meeting] if share < 1.0 else [bend, meeting])
    points = tuple((float(x), float(y)) for x, y in corners.round(3))
    inside = np.clip(corners, 0.3, scene.workspace.max(axis=0) - 0.3) == corners
    if walked < _SHORTEST_WALK or not inside.all():
        return None
    walker = Mover(name, Circle(0.0, 0.0, _WALKER), points, math.floor(1e4 * speed) / 1e4)
    legs = np.hypot(*np.diff(np.array(points), axis=0).T)
    times = np.linspace(0.0, legs.sum() / walker.speed, 400)
    driven = robot.speed * np.maximum(0.0, times - scene.sampling_interval)
    gap = np.hypot(*(mover_positions(walker, times) - start).T) - _WALKER - driven
    return walker if legs.min() > 0.1 and gap.min() > scene.safety_margin else None


def _stop_time(walker: Mover) -> float:
    """When a walker stands [s]."""
    return float(np.hypot(*np.diff(np.array(walker.waypoints), axis=0).T).sum()) / walker.speed


@dataclass
class _Plan:
    """What happens to one sensor."""

    faults: list[Fault]
    frozen_until: float = 0.0
    delayed: bool = False

    def add(self, fault: Fault) -> None:
        self.faults.append(fault)
        self.delayed |= fault.kind in ("delay", "reorder")
        if fault.kind == "frozen":
            self.frozen_until = fault.end + _RECOVERY


def _fault_plan(draws: Draws, kinds: Sequence[str], scene: Scene) -> list[tuple[Fault, ...]]:
    """Faults of every kind on random sensors at random times."""
    sensors = len(scene.sensors)
    plans = [_Plan([]) for _ in range(sensors)]
    for kind in sorted(kinds, key=lambda kind: (kind != "frozen", kind == "clock_offset")):
        severe = draws.random() < _SEVERE
        count = sensors if severe else int(draws.integers(1, max(2, sensors // 2 + 1)))
        window = _window(draws, scene)
        for index in draws.permutation(sensors)[:count].tolist():
            begin, end = window if severe else _window(draws, scene)
            if kind == "frozen" and len(kinds) > 1:
                end = min(end, begin + _LONGEST_FAULT)  # something else shall happen to the sensor afterwards
            plan = plans[index]
            begin = max(begin, plan.frozen_until)
            end = max(end, begin + 1.0)
            plan.add(_fault(draws, kind, round(begin, 2), round(end, 2), plan, scene.sampling_interval))
    return [tuple(plan.faults) for plan in plans]


def _window(draws: Draws, scene: Scene) -> tuple[float, float]:
    """Begin while the robot drives, if somebody walks often while that one comes; end a little later, or never [s]."""
    (robot,) = scene.robots
    begin = float(draws.uniform(0.3, math.dist(robot.start, robot.target) / robot.speed))
    if scene.movers and draws.random() < _WHILE_SOMEBODY_COMES:
        stops = _stop_time(scene.movers[int(draws.integers(len(scene.movers)))])
        begin = max(0.3, stops - float(draws.uniform(0.5, 5.0)))
    return begin, math.inf if draws.random() < _FOR_EVER else begin + float(
        draws.uniform(1.0, _LONGEST_FAULT)
    )


def _fault(draws: Draws, kind: str, begin: float, end: float, plan: _Plan, interval: float) -> Fault:
    # a device that is frozen now and then is told by the scan before, which is another one: it stays frozen
    sometimes = kind != "frozen" and draws.random() < 0.4
    fault = Fault(kind, begin, end, _between(draws, 0.2, 0.9) if sometimes else 1.0)
    if kind == "delay":
        return replace(fault, seconds=_between(draws, 0.1, 2.0), jitter=_between(draws, 0.0, 1.0))
    if kind in ("nan", "zero"):
        return replace(fault, share=_between(draws, 0.05, 1.0))
    if kind == "beam_count":
        return replace(fault, change=int(draws.choice([-1, 1]) * draws.integers(1, 100)))
    if kind == "clock_offset":
        ahead = not plan.delayed and draws.random() < 0.5
        seconds = _between(draws, interval + 0.05, 3.0) if ahead else -_between(draws, 0.05, 3.0)
        return replace(fault, seconds=seconds)
    return fault
