"""From YAML fields to the values of a scene in space: keys, units, shapes and ranges of single entries."""

from __future__ import annotations

import math
from pathlib import Path

from snnav_sim.scene_faults import read_fault
from snnav_sim.scene_read import LARGEST_SEED, read_circle, read_id, read_polygon
from snnav_sim.scene_types import Circle, Polygon
from snnav_sim.scene_yaml import Field
from snnav_sim.space_types import (
    Body,
    Box,
    DepthSensor,
    FlyerScene,
    Mesh,
    Point3,
    Prism,
    Solid,
    SpaceMover,
    SpaceScene,
)

__all__ = ["SPACE_OPTIONAL", "SPACE_REQUIRED", "SPACE_SENSOR", "is_in_space", "read_space_scene"]

SPACE_REQUIRED = ("name", "sampling_interval", "workspace", "safety_margin", "sensors", "robots")
SPACE_OPTIONAL = (
    "description",
    "seed",
    "control_period",
    "time_window",
    "boundary_speed",
    "time_limit",
    "grid_spacing",
    "obstacles",
    "movers",
)
SPACE_SENSOR = (
    "columns",
    "rows",
    "field_of_view_deg",
    "range_min",
    "range_max",
    "noise",
    "wrap",
    "no_return",
    "drop_out",
    "scan_period",
    "scan_offset",
    "faults",
)
_LARGEST = 1e4  # [m]
_MOST_PIXELS = 4096
_MESHES = (".stl", ".obj")
_SPINNING = {"columns": 720, "rows": 64, "width": 360.0, "height": 90.0, "range_max": 30.0}
_TOF = {"columns": 128, "rows": 128, "width": 135.0, "height": 135.0, "range_max": 9.0}


def is_in_space(root: Field) -> bool:
    """Whether the workspace of a scene is a box."""
    workspace = root.children().get("workspace")
    return workspace is not None and "box" in workspace.children()


def read_space_scene(root: Field) -> SpaceScene:
    """Read a scene in space from the root of a document; cross-checks between entries are made elsewhere.

    Raises
    ------
    SceneError
        For the first entry that is not as docs/scenes-in-space.md says.
    """
    entries = root.mapping(SPACE_REQUIRED, SPACE_OPTIONAL)

    def listed(key: str, form: str) -> list[Field]:
        return entries[key].items(form) if key in entries else []

    workspace = entries["workspace"].mapping(("box",), ("known_static",))
    low, high = _corners(workspace["box"])
    return SpaceScene(
        name=entries["name"].text(),
        description=entries["description"].text(may_be_empty=True) if "description" in entries else "",
        seed=entries["seed"].whole(0, LARGEST_SEED) if "seed" in entries else 0,
        sampling_interval=entries["sampling_interval"].number("s", 0.0, 60.0, above=True),
        control_period=_number(entries, "control_period", 0.05, "s", 0.0, 1.0, above=True),
        time_window=entries["time_window"].whole(1, 1000) if "time_window" in entries else 6,
        boundary_speed=_number(entries, "boundary_speed", 0.0, "m/s", 0.0, 100.0),
        safety_margin=entries["safety_margin"].number("m", 0.0, 100.0, above=True),
        time_limit=_number(entries, "time_limit", 300.0, "s", 0.0, 1e5, above=True),
        grid_spacing=_number(entries, "grid_spacing", 0.1, "m", 0.01, 1.0),
        low=low,
        high=high,
        known_border=workspace["known_static"].flag() if "known_static" in workspace else True,
        obstacles=tuple(_obstacle(item) for item in listed("obstacles", "[{box: ...}, ...]")),
        movers=tuple(_mover(item) for item in listed("movers", "[{id: ...}, ...]")),
        sensors=tuple(_sensor(item) for item in listed("sensors", "[{id: ...}, ...]")),
        robots=tuple(_robot(item) for item in listed("robots", "[{id: ...}, ...]")),
    )


def _number(
    entries: dict[str, Field],
    key: str,
    default: float,
    unit: str,
    least: float,
    most: float,
    above: bool = False,
) -> float:
    return entries[key].number(unit, least, most, above) if key in entries else default


def _point(field: Field) -> Point3:
    items = field.items("[x, y, z]")
    if len(items) != 3:
        field.fail(f"{field.quoted()}, expected 3", "write [x, y, z]: this scene is in space")
    x, y, z = (item.number("m", -_LARGEST, _LARGEST) for item in items)
    return x, y, z


def _corners(field: Field) -> tuple[Point3, Point3]:
    form = "[[x0, y0, z0], [x1, y1, z1]]"
    items = field.items(form)
    if len(items) != 2:
        field.fail(f"{field.quoted()}, expected 2", f"write {form}")
    low, high = _point(items[0]), _point(items[1])
    for axis, least, most in zip("xyz", low, high, strict=True):
        if most - least < 1e-6:
            items[1].fail(
                f"{axis} {most:g} is not above {axis} {least:g} of the first corner",
                "give the lowest corner, then the highest one",
            )
    return low, high


def _shape(field: Field, entries: dict[str, Field]) -> Box | Prism:
    shapes = [key for key in ("box", "polygon", "circle") if key in entries]
    if len(shapes) != 1:
        field.fail("needs one shape", "give box: ..., or polygon: ... or circle: ... with height: [z0, z1]")
    if shapes[0] == "box":
        if "height" in entries:
            entries["height"].fail("given beside box", "remove it: a box has its own")
        holes = entries["holes"].items("[[[x0, y0, z0], [x1, y1, z1]], ...]") if "holes" in entries else []
        return Box(*_corners(entries["box"]), holes=tuple(_corners(hole) for hole in holes))
    if "holes" in entries:
        entries["holes"].fail("given beside a prism", "holes are cut into a box")
    if "height" not in entries:
        field.fail("key height is missing", "add height: [z0, z1]")
    heights = entries["height"].items("[z0, z1]")
    if len(heights) != 2:
        entries["height"].fail(f"{entries['height'].quoted()}, expected 2", "write [z0, z1]")
    bottom, top = (item.number("m", -_LARGEST, _LARGEST) for item in heights)
    if top - bottom < 1e-6:
        heights[1].fail(f"{top:g} is not above the bottom {bottom:g}", "give bottom, then top")
    outline: Polygon | Circle = (
        read_polygon(entries["polygon"]) if shapes[0] == "polygon" else read_circle(entries["circle"])
    )
    return Prism(outline, bottom, top)


def _obstacle(field: Field) -> Body:
    if "mesh" in field.children():
        entries = field.mapping(("mesh",), ("known_static",))
        solid: Solid = Mesh(_mesh(entries["mesh"]))
    else:
        entries = field.mapping((), ("box", "holes", "polygon", "circle", "height", "known_static"))
        solid = _shape(field, entries)
    return Body(solid, entries["known_static"].flag() if "known_static" in entries else False)


def _mesh(field: Field) -> str:
    """Return the file of a mesh, found from the folder of the scene."""
    path = Path(field.text())
    if path.suffix.lower() not in _MESHES:
        field.fail(f"{path}", "give a file of triangles: .stl or .obj")
    if not path.is_absolute():
        path = (Path(field.source).parent / path).absolute()
    if not path.is_file():
        field.fail(f"{path} does not exist", "give a path from the folder of this scene")
    return str(path)


def _mover(field: Field) -> SpaceMover:
    entries = field.mapping(("id", "waypoints", "speed"), ("box", "polygon", "circle", "height", "loop"))
    items = entries["waypoints"].items("[[x, y, z], [x, y, z], ...]")
    points = [_point(item) for item in items]
    if len(points) < 2:
        entries["waypoints"].fail(f"{len(points)} waypoints", "give at least two")
    for item, before, after in zip(items[1:], points, points[1:], strict=False):
        if math.dist(before, after) < 1e-6:
            item.fail("repeats the waypoint before it", "remove it")
    return SpaceMover(
        read_id(entries["id"]),
        _shape(field, entries),
        tuple(points),
        entries["speed"].number("m/s", 0.0, 100.0, above=True),
        entries["loop"].flag() if "loop" in entries else False,
    )


def _sensor(field: Field) -> DepthSensor:
    if "device" not in field.children():
        field.fail("key device is missing", "add device: tof or spinning")
    device = field.children()["device"].choice(("tof", "spinning"))
    aim = ("look_at",) if device == "tof" else ()
    entries = field.mapping(
        ("id", "device", "position", *aim), (*(() if aim else ("heading_deg",)), *SPACE_SENSOR)
    )
    default = _TOF if device == "tof" else _SPINNING
    position = _point(entries["position"])
    look_at = _point(entries["look_at"]) if aim else None
    if look_at is not None and math.dist(look_at, position) < 1e-6:
        entries["look_at"].fail("is the position of the camera", "give another point")
    width, height = _view(entries, default)
    range_max = _number(entries, "range_max", default["range_max"], "m", 0.0, 1000.0, above=True)
    range_min = _number(entries, "range_min", 0.05, "m", 0.0, 1000.0)
    if range_min >= range_max:
        entries.get("range_min", entries.get("range_max", field)).fail(
            f"range_min {range_min:g} is not below range_max {range_max:g}", "give a smaller range_min"
        )
    return DepthSensor(
        id=read_id(entries["id"]),
        device=device,
        position=position,
        look_at=look_at,
        heading=math.radians(_number(entries, "heading_deg", 0.0, "degrees", -360.0, 360.0)),
        columns=entries["columns"].whole(2, _MOST_PIXELS)
        if "columns" in entries
        else int(default["columns"]),
        rows=entries["rows"].whole(2, _MOST_PIXELS) if "rows" in entries else int(default["rows"]),
        width=math.radians(width),
        height=math.radians(height),
        range_min=range_min,
        range_max=range_max,
        noise=entries["noise"].choice(("none", "tof")) if "noise" in entries else "none",
        wrap=entries["wrap"].number("m", 0.0, 1000.0, above=True) if "wrap" in entries else None,
        no_return=entries["no_return"].choice(("free", "unknown")) if "no_return" in entries else "unknown",
        drop_out=_number(entries, "drop_out", 0.0, "probability", 0.0, 1.0),
        scan_period=entries["scan_period"].number("s", 0.0, 60.0, above=True)
        if "scan_period" in entries
        else None,
        scan_offset=_number(entries, "scan_offset", 0.0, "s", 0.0, 60.0),
        faults=tuple(read_fault(item) for item in entries["faults"].items("[{kind: ...}, ...]"))
        if "faults" in entries
        else (),
    )


def _view(entries: dict[str, Field], default: dict[str, float]) -> tuple[float, float]:
    """Return width and height of the field of view [degrees]."""
    if "field_of_view_deg" not in entries:
        return default["width"], default["height"]
    items = entries["field_of_view_deg"].items("[width, height]")
    if len(items) != 2:
        entries["field_of_view_deg"].fail(
            f"{entries['field_of_view_deg'].quoted()}, expected 2", "write [width, height]"
        )
    width = items[0].number("degrees", 0.0, 360.0, above=True)
    return width, items[1].number("degrees", 0.0, 180.0, above=True)


def _robot(field: Field) -> FlyerScene:
    entries = field.mapping(
        ("id", "start", "heading_deg", "speed", "max_turn_rate", "radius"), ("pitch_deg", "target", "curve")
    )
    if ("target" in entries) == ("curve" in entries):
        field.fail("needs a target or a curve", "give target: [x, y, z], or curve: [[x, y, z], ...]")
    curve: tuple[Point3, ...] = ()
    if "curve" in entries:
        curve = tuple(_point(item) for item in entries["curve"].items("[[x, y, z], [x, y, z], ...]"))
        if len(curve) < 2:
            entries["curve"].fail(f"{len(curve)} points", "give at least two")
    return FlyerScene(
        id=read_id(entries["id"]),
        start=_point(entries["start"]),
        heading=math.radians(entries["heading_deg"].number("degrees", -360.0, 360.0)),
        pitch=math.radians(_number(entries, "pitch_deg", 0.0, "degrees", -90.0, 90.0)),
        target=curve[-1] if curve else _point(entries["target"]),
        speed=entries["speed"].number("m/s", 0.0, 100.0, above=True),
        max_turn_rate=entries["max_turn_rate"].number("rad/s", 0.0, 100.0, above=True),
        radius=entries["radius"].number("m", 0.0, 100.0, above=True),
        curve=curve,
    )
