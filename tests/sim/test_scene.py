"""Reading, writing and finding scenes."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from snnav_sim.scene import (
    Circle,
    Fault,
    Mover,
    Polygon,
    RobotScene,
    Scene,
    SensorScene,
    dump_scene,
    find_scene,
    list_scenes,
    load_any_scene,
    parse_any_scene,
    parse_scene,
)
from snnav_sim.scene_faults import FAULT_KINDS


def test_the_example_of_the_contract(example: Scene) -> None:
    assert example.name == "factory"
    assert example.workspace.shape == (4, 2)
    assert example.obstacles == (
        Polygon(((10.0, 5.0), (14.0, 5.0), (14.0, 30.0), (10.0, 30.0))),
        Circle(40.0, 20.0, 2.5),
    )
    person, cart = example.movers
    assert (person.waypoints, person.speed, person.loop) == (((20.0, 5.0), (20.0, 40.0)), 0.4, True)
    assert (cart.start, cart.velocity, cart.top_speed) == ((50.0, 10.0), (0.0, 0.3), 0.3)
    (sensor,) = example.sensors
    assert sensor.beams == 361
    assert sensor.heading == math.radians(45)
    assert sensor.angle_min == -math.pi / 2
    assert example.robots[0].spec.min_turn_radius == 2.0
    assert example.ticks_per_sample == 20


def test_defaults(room: Scene) -> None:
    assert (room.seed, room.control_period, room.description, room.movers) == (0, 0.05, "", ())
    assert room.boundary_speed == 0.0
    sensor = room.sensors[0]
    assert (sensor.noise, sensor.range_min, sensor.no_return, sensor.drop_out) == ("none", 0.0, "free", 0.0)
    assert (sensor.scan_offset, sensor.sees_robots, sensor.faults) == (0.0, False, ())
    assert room.scan_period(sensor) == room.sampling_interval
    assert not room.sees_robots


@pytest.mark.parametrize(
    ("view", "step", "beams"),
    [(180, 1, 181), (179, 1, 180), (180, 0.5, 361), (179.5, 0.5, 360), (360, 0.5, 720), (270, 0.25, 1081)],
)
def test_beam_counts(example_text: str, view: float, step: float, beams: int) -> None:
    text = example_text.replace(
        "field_of_view_deg: 180, resolution_deg: 0.5", f"field_of_view_deg: {view}, resolution_deg: {step}"
    )
    assert parse_scene(text, "x").sensors[0].beams == beams


def test_a_closed_ring_and_numbers_in_any_form(example_text: str) -> None:
    closed = (
        example_text.replace("[10, 30]]", "[10, 30], [10, 5]]")
        .replace("seed: 1", "seed: 1e0")
        .replace("15.0", "1.5e+1")
    )
    assert parse_scene(closed, "x") == parse_scene(example_text, "x")


def test_recorded_scans(recorded: Scene) -> None:
    first, second = recorded.sensors
    assert first.ranges == (4.0, 5.5, 4.0)
    assert math.isnan(second.ranges[1])
    assert first.no_return == "unknown"
    assert recorded.recorded
    assert parse_scene(dump_scene(recorded), "x") == recorded


def test_shipped_scenes_have_descriptions_and_round_trip() -> None:
    scenes = list_scenes()
    assert {"hello", "factory", "thesis_ch3_scene1", "thesis_ch3_scene2"} <= set(scenes)
    for name, description in scenes.items():
        scene = load_any_scene(find_scene(name))
        assert scene.name == name
        assert description
        assert parse_any_scene(dump_scene(scene), name) == scene


def test_a_path_is_found(tmp_path: Path, example_text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text(example_text)
    assert find_scene(str(file)) == file
    monkeypatch.chdir(tmp_path)
    assert find_scene("mine.yaml") == Path("mine.yaml")


@pytest.mark.parametrize("folder", [False, True])
def test_a_name_means_the_shipped_scene_wherever_one_stands(
    tmp_path: Path, example_text: str, monkeypatch: pytest.MonkeyPatch, folder: bool
) -> None:
    """`snnav run hello --out hello`, a second time; kernels are warmed up by `hello` too, in every process."""
    before = find_scene("hello")
    monkeypatch.chdir(tmp_path)
    if folder:
        Path("hello").mkdir()
    else:
        Path("hello").write_text(example_text)
        assert find_scene("./hello") == Path("./hello")
    assert find_scene("hello") == before


coordinate = st.floats(0.5, 99.5)
point = st.tuples(coordinate, coordinate)
angle = st.floats(-360.0, 360.0).map(math.radians)
positive = st.floats(1e-3, 50.0)
circle = st.builds(Circle, coordinate, coordinate, positive)
square = st.builds(
    lambda x, y, s: Polygon(((x, y), (x + s, y), (x, y + s))), coordinate, coordinate, st.floats(0.01, 9.0)
)


@st.composite
def fault_lists(draw: st.DrawFn, noise: str) -> tuple[Fault, ...]:
    """Faults of every kind, as long as the device has noise that a frozen scan can be told by."""

    def fault(kind: str) -> Fault:
        begin = draw(st.floats(0.0, 50.0))
        return Fault(
            kind,
            begin,
            draw(st.sampled_from([math.inf, begin + 1.0])),
            draw(st.floats(1e-3, 1.0)),
            seconds=draw(st.floats(0.001, 9.0)) if kind in ("delay", "clock_offset") else 0.0,
            jitter=draw(st.floats(0.0, 9.0)) if kind == "delay" else 0.0,
            share=draw(st.floats(1e-3, 1.0)) if kind in ("nan", "zero") else 0.0,
            change=-1 if kind == "beam_count" else 0,
        )

    kinds = [kind for kind in FAULT_KINDS if kind != "frozen" or noise == "lms200"]
    return tuple(fault(kind) for kind in draw(st.lists(st.sampled_from(kinds), max_size=4)))


@st.composite
def scenes(draw: st.DrawFn) -> Scene:
    """A scene with everything in it that the format knows."""
    view, count = draw(st.floats(1.0, 360.0)), draw(st.integers(5, 720))
    interval, noise = draw(st.integers(1, 40)) * 0.05, draw(st.sampled_from(["none", "lms200"]))
    period = draw(st.none() | st.floats(0.05, 60.0))
    sensors = [
        SensorScene(
            id="s1", device="lms200", position=draw(point), heading=draw(angle), field_of_view=math.radians(view),
            resolution=math.radians(view / count), range_max=draw(positive), angle_min=-math.radians(view) / 2,
            noise=noise, no_return=draw(st.sampled_from(["free", "unknown"])),
            drop_out=draw(st.floats(0.0, 1.0)), sees_robots=draw(st.booleans()), scan_period=period,
            scan_offset=draw(st.floats(0.0, 0.99)) * (interval if period is None else period),
            faults=draw(fault_lists(noise)),
        )
    ]  # fmt: skip
    boundary_speed = draw(st.floats(0.0, 0.4))
    movers = (
        Mover(
            "m1", draw(circle), ((1.0, 1.0), (-2.0, 5.0), draw(point)), boundary_speed, draw(st.booleans())
        ),
        Mover("m2", draw(square), start=draw(point), velocity=(boundary_speed, 0.0)),
    )
    robots = (
        RobotScene(
            "r1", (1.0, 1.0), draw(angle), draw(point), draw(st.floats(0.5, 3.0)), draw(positive), 0.3
        ),
        RobotScene(
            "r2", (5.0, 1.0), draw(angle), draw(point), draw(st.floats(0.5, 3.0)), draw(positive), 0.4
        ),
    )
    return Scene(
        name=draw(st.text("abc 'äß:#-[{\"", min_size=1).filter(str.strip)),
        sampling_interval=interval,
        border=Polygon(((0.0, 0.0), (100.0, 0.0), (100.0, 100.0), (0.0, 100.0))),
        safety_margin=draw(st.floats(0.4, 5.0)),
        sensors=tuple(sensors),
        robots=robots,
        movers=movers if boundary_speed > 1e-3 else (),
        description=draw(st.text("xyz: #", max_size=5).filter(lambda text: text == "" or bool(text.strip()))),
        seed=draw(st.integers(0, 2**31 - 1)),
        boundary_speed=boundary_speed,
    )


@given(scenes())
def test_a_written_scene_reads_back_exactly(scene: Scene) -> None:
    again = parse_scene(dump_scene(scene), "again")
    assert again == scene
    assert np.array_equal(again.workspace, scene.workspace)
    assert again != replace(scene, seed=scene.seed + 1)
