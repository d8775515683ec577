"""From YAML fields to the values of a scene: keys, units, shapes and ranges of single entries."""

from __future__ import annotations

import math
import re

import shapely

from snnav_sim.scene_faults import read_fault
from snnav_sim.scene_types import (
    Circle,
    Mover,
    Point,
    Polygon,
    Retarget,
    RobotScene,
    Scene,
    SensorScene,
    Shape,
)
from snnav_sim.scene_yaml import Field

__all__ = [
    "LARGEST_SEED",
    "OPTIONAL",
    "REQUIRED",
    "SCANNER",
    "is_name",
    "read_circle",
    "read_id",
    "read_polygon",
    "read_scene",
]

LARGEST_SEED = 2**53  # up to here every whole number is a double: YAML, JSON and ROS parameters agree

REQUIRED = ("name", "sampling_interval", "workspace", "safety_margin", "sensors", "robots")
OPTIONAL = (
    "description",
    "seed",
    "control_period",
    "time_window",
    "boundary_speed",
    "time_limit",
    "planner",
    "obstacles",
    "movers",
)
_ID = re.compile(r"[A-Za-z](_?[A-Za-z0-9])*")
_RESERVED = ("sensors", "map", "unoccupied_area", "lockstep", "clock", "diagnostics", "robots", "planners")
_LARGEST = 1e4  # [m]; coordinates beyond it are a mistake of units
_MOST_BEAMS = 100_000
_LATEST = 1e5  # [s]
SCANNER = (
    "noise",
    "range_min",
    "no_return",
    "drop_out",
    "error_codes",
    "scan_period",
    "scan_offset",
    "sees_robots",
    "faults",
)


def read_scene(root: Field) -> Scene:
    """Read a scene from the root of a document; cross-checks between entries are made elsewhere.

    Raises
    ------
    SceneError
        For the first entry that is not as docs/scene-format.md says.
    """
    entries = root.mapping(REQUIRED, OPTIONAL)

    def listed(key: str, form: str) -> list[Field]:
        return entries[key].items(form) if key in entries else []

    def number(key: str, default: float, least: float, most: float, above: bool = False) -> float:
        return entries[key].number("s", least, most, above) if key in entries else default

    return Scene(
        name=entries["name"].text(),
        description=entries["description"].text(may_be_empty=True) if "description" in entries else "",
        seed=entries["seed"].whole(0, LARGEST_SEED) if "seed" in entries else 0,
        sampling_interval=number("sampling_interval", 0.0, 0.0, 60.0, above=True),
        control_period=number("control_period", 0.05, 0.0, 1.0, above=True),
        time_window=entries["time_window"].whole(1, 1000) if "time_window" in entries else 4,
        boundary_speed=entries["boundary_speed"].number("m/s", 0.0, 100.0)
        if "boundary_speed" in entries
        else 0.0,
        safety_margin=entries["safety_margin"].number("m", 0.0, 100.0, above=True),
        time_limit=number("time_limit", 300.0, 0.0, 1e5, above=True),
        planner=entries["planner"].choice(("local", "global")) if "planner" in entries else "local",
        border=_workspace(entries["workspace"]),
        obstacles=tuple(_obstacle(item) for item in listed("obstacles", "[{polygon: ...}, ...]")),
        movers=tuple(_mover(item) for item in listed("movers", "[{id: ...}, ...]")),
        sensors=tuple(_sensor(item) for item in listed("sensors", "[{id: ...}, ...]")),
        robots=tuple(_robot(item) for item in listed("robots", "[{id: ...}, ...]")),
    )


def is_name(text: str) -> bool:
    """Whether a text can be the id of a robot or sensor: a valid ROS name that is not reserved."""
    return _ID.fullmatch(text) is not None and text not in _RESERVED


def read_id(field: Field) -> str:
    """Return a name that is also a valid ROS name."""
    value = field.text()
    if not _ID.fullmatch(value):
        field.fail(
            f"{field.quoted()} is no name", "use letters, digits and single underscores, a letter first"
        )
    if value in _RESERVED:
        field.fail(f"{value} is a reserved name", "choose another one")
    return value


def _workspace(field: Field) -> Polygon:
    return read_polygon(field.mapping(("polygon",), ())["polygon"])


def _shape(field: Field, entries: dict[str, Field]) -> Shape:
    if ("polygon" in entries) == ("circle" in entries):
        field.fail("needs one shape", "give either polygon: [[x, y], ...] or circle: [x, y, radius]")
    return read_polygon(entries["polygon"]) if "polygon" in entries else read_circle(entries["circle"])


def _obstacle(field: Field) -> Shape:
    _refuse_space(field, ("box", "mesh"))
    return _shape(field, field.mapping((), ("polygon", "circle")))


def _refuse_space(field: Field, keys: tuple[str, ...]) -> None:
    for key in field.children():
        if key in keys:
            field.fail(
                f"key {key}",
                "this scene is in the plane; one in space begins with workspace: {box: ...}",
            )


def read_circle(field: Field) -> Circle:
    """Return a disk."""
    items = field.items("[x, y, radius]")
    if len(items) != 3:
        field.fail(f"{field.quoted()}, expected 3", "write [x, y, radius]")
    x, y = (item.number("m", -_LARGEST, _LARGEST) for item in items[:2])
    return Circle(x, y, items[2].number("m", 0.0, _LARGEST, above=True))


def read_polygon(field: Field) -> Polygon:
    """Return a simple polygon of positive area; a last vertex that repeats the first one is dropped."""
    items = field.items("[[x, y], [x, y], [x, y], ...]")
    vertices = [item.point() for item in items]
    for item, vertex in zip(items, vertices, strict=True):
        if max(abs(vertex[0]), abs(vertex[1])) > _LARGEST:
            item.fail(
                f"[{vertex[0]:g}, {vertex[1]:g}] is far away", f"give coordinates within {_LARGEST:g} m"
            )
    if len(vertices) > 3 and vertices[0] == vertices[-1]:
        vertices.pop()
    if len(vertices) < 3:
        field.fail(f"{len(vertices)} vertices", "a polygon needs at least three [x, y]")
    for index, vertex in enumerate(vertices):
        if math.dist(vertex, vertices[index - 1]) < 1e-6:
            items[index].fail(f"vertex [{vertex[0]:g}, {vertex[1]:g}] repeats the one before it", "remove it")
    polygon = shapely.Polygon(vertices)
    if shapely.MultiPoint(vertices).convex_hull.area < 1e-6:
        field.fail("the polygon has no area", "its vertices must not lie on one line")
    if not polygon.is_valid or polygon.area < 1e-6:
        reason = shapely.is_valid_reason(polygon)
        field.fail(f"the border crosses itself ({reason})", "list the vertices in order round the shape")
    return Polygon(tuple(vertices))


def _mover(field: Field) -> Mover:
    _refuse_space(field, ("box",))
    entries = field.mapping(("id",), ("polygon", "circle", "waypoints", "speed", "loop", "start", "velocity"))
    name, shape = read_id(entries["id"]), _shape(field, entries)
    on_way = {"waypoints", "speed", "loop"} & entries.keys()
    straight = {"start", "velocity"} & entries.keys()
    if on_way and straight:
        first = min(straight)
        entries[first].fail("given beside waypoints", "give either waypoints, speed, loop or start, velocity")
    if straight:
        for key in ("start", "velocity"):
            if key not in entries:
                field.fail(f"key {key} is missing", f"add {key}: [x, y]")
        return Mover(
            name, shape, start=entries["start"].point(), velocity=entries["velocity"].point("[vx, vy]")
        )
    for key in ("waypoints", "speed"):
        if key not in entries:
            field.fail(f"key {key} is missing", "give waypoints and speed, or start and velocity")
    return Mover(
        name,
        shape,
        waypoints=_waypoints(entries["waypoints"]),
        speed=entries["speed"].number("m/s", 0.0, 100.0, above=True),
        loop=entries["loop"].flag() if "loop" in entries else False,
    )


def _waypoints(field: Field) -> tuple[Point, ...]:
    items = field.items("[[x, y], [x, y], ...]")
    points = [item.point() for item in items]
    if len(points) < 2:
        field.fail(
            f"{len(points)} waypoints", "give at least two, or start and velocity: [0, 0] for a body at rest"
        )
    for item, before, after in zip(items[1:], points, points[1:], strict=False):
        if math.dist(before, after) < 1e-6:
            item.fail("repeats the waypoint before it", "remove it")
    return tuple(points)


def _robot(field: Field) -> RobotScene:
    _refuse_space(field, ("pitch_deg",))
    required = ("id", "start", "heading_deg", "target", "speed", "max_turn_rate", "radius")
    entries = field.mapping(required, ("joins_at", "leaves_at", "retargets"))
    retargets = (
        entries["retargets"].items("[{time: ..., target: [x, y]}, ...]") if "retargets" in entries else []
    )
    return RobotScene(
        id=read_id(entries["id"]),
        start=entries["start"].point(),
        heading=math.radians(entries["heading_deg"].number("degrees", -360.0, 360.0)),
        target=entries["target"].point(),
        speed=entries["speed"].number("m/s", 0.0, 100.0, above=True),
        max_turn_rate=entries["max_turn_rate"].number("rad/s", 0.0, 100.0, above=True),
        radius=entries["radius"].number("m", 0.0, 100.0, above=True),
        joins_at=entries["joins_at"].number("s", 0.0, _LATEST) if "joins_at" in entries else 0.0,
        leaves_at=entries["leaves_at"].number("s", 0.0, _LATEST, above=True)
        if "leaves_at" in entries
        else math.inf,
        retargets=tuple(_retarget(item) for item in retargets),
    )


def _retarget(field: Field) -> Retarget:
    entries = field.mapping(("time", "target"), ())
    return Retarget(entries["time"].number("s", 0.0, _LATEST, above=True), entries["target"].point())


def _sensor(field: Field) -> SensorScene:
    _refuse_space(field, ("look_at",))
    if "device" not in field.children():
        field.fail("key device is missing", "add device: lms200")
    common = ("id", "device", "position", "heading_deg", "resolution_deg", "range_max")
    device = field.children()["device"].choice(("lms200", "recorded"))
    if device == "recorded":
        entries = field.mapping((*common, "angle_min_deg", "ranges"), ("range_min", "no_return", "range_cut"))
        return _recorded(entries)
    return _simulated(field.mapping((*common, "field_of_view_deg"), SCANNER))


def _range_limits(entries: dict[str, Field]) -> tuple[float, float]:
    range_max = entries["range_max"].number("m", 0.0, 1000.0, above=True)
    range_min = entries["range_min"].number("m", 0.0, 1000.0) if "range_min" in entries else 0.0
    if range_min >= range_max:
        entries["range_min"].fail(
            f"{range_min:g} is not below range_max {range_max:g}", "give a smaller range_min"
        )
    return range_min, range_max


def _simulated(entries: dict[str, Field]) -> SensorScene:
    view = entries["field_of_view_deg"].number("degrees", 0.0, 360.0, above=True)
    step = entries["resolution_deg"].number("degrees", 0.0, 90.0, above=True)
    count = view / step
    if abs(count - round(count)) > 1e-6 or round(count) < 1:
        fitting = f"{max(1, round(count)) * step:g}"
        remedy = f"give a resolution_deg that divides it, or field_of_view_deg: {fitting}"
        entries["resolution_deg"].fail(f"{step:g} does not divide field_of_view_deg {view:g}", remedy)
    if count > _MOST_BEAMS:
        entries["resolution_deg"].fail(
            f"{count:.0f} beams", f"give a coarser resolution (at most {_MOST_BEAMS} beams)"
        )
    range_min, range_max = _range_limits(entries)
    codes = entries["error_codes"].flag() if "error_codes" in entries else False
    no_return = "unknown" if codes else "free"
    if "no_return" in entries:
        no_return = entries["no_return"].choice(("free", "unknown"))
        if codes and no_return == "free":
            entries["no_return"].fail(
                "free beside error_codes: true", "an error code is unknown, write unknown"
            )
    return SensorScene(
        id=read_id(entries["id"]),
        device="lms200",
        position=entries["position"].point(),
        heading=_heading(entries["heading_deg"]),
        field_of_view=math.radians(view),
        resolution=math.radians(step),
        range_max=range_max,
        angle_min=-math.radians(view) / 2.0,
        noise=entries["noise"].choice(("none", "lms200")) if "noise" in entries else "none",
        range_min=range_min,
        no_return=no_return,
        drop_out=entries["drop_out"].number("probability", 0.0, 1.0) if "drop_out" in entries else 0.0,
        error_codes=codes,
        scan_period=entries["scan_period"].number("s", 0.0, 60.0, above=True)
        if "scan_period" in entries
        else None,
        scan_offset=entries["scan_offset"].number("s", 0.0, 60.0) if "scan_offset" in entries else 0.0,
        sees_robots=entries["sees_robots"].flag() if "sees_robots" in entries else False,
        faults=tuple(read_fault(item) for item in entries["faults"].items("[{kind: ...}, ...]"))
        if "faults" in entries
        else (),
    )


def _heading(field: Field) -> float:
    return math.radians(field.number("degrees", -360.0, 360.0))


def _recorded(entries: dict[str, Field]) -> SensorScene:
    items = entries["ranges"].items("[r1, r2, ...]")
    if len(items) < 2:
        entries["ranges"].fail(f"{len(items)} ranges", "a recorded scan needs at least 2")
    ranges = tuple(_recorded_range(item) for item in items)
    step = entries["resolution_deg"].number("degrees", 0.0, 90.0, above=True)
    view = step * (len(ranges) - 1)
    if view > 360.0 + 1.001 * step:
        entries["ranges"].fail(
            f"{len(ranges)} ranges at {step:g} degrees are more than one turn",
            "correct resolution_deg or the ranges",
        )
    range_min, range_max = _range_limits(entries)
    return SensorScene(
        id=read_id(entries["id"]),
        device="recorded",
        position=entries["position"].point(),
        heading=_heading(entries["heading_deg"]),
        field_of_view=math.radians(view),
        resolution=math.radians(step),
        range_max=range_max,
        angle_min=math.radians(entries["angle_min_deg"].number("degrees", -360.0, 360.0)),
        range_min=range_min,
        no_return=entries["no_return"].choice(("free", "unknown")) if "no_return" in entries else "unknown",
        ranges=ranges,
        range_cut=entries["range_cut"].number("m", 0.0, range_max, above=True)
        if "range_cut" in entries
        else None,
    )


def _recorded_range(field: Field) -> float:
    value = field.any_number("m")
    if value < 0.0:
        field.fail(f"{value:g} is negative", "write .nan or 0 for a beam without a valid return")
    return math.nan if math.isnan(value) else value
