"""Every mistake in a scene file is one line with file, line, key and remedy."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from snnav_sim.scene import SceneError, find_scene, load_scene, parse_scene

# what to replace in the example, by what, the line of the error, its key, a word of the message
MISTAKES = {
    "unknown key with a near one": ("speed: 0.4", "sped: 0.4", 15, "movers[0].sped", "did you mean speed?"),
    "unknown key at the top": ("seed: 1", "sede: 1", 3, "sede", "did you mean seed?"),
    "angle without its unit": ("heading_deg: 45", "heading: 45", 18, "sensors[0].heading", "heading_deg"),
    "key given twice": ("seed: 1", "seed: 1\nseed: 2", 4, "seed", "first in line 3"),
    "missing key": ("safety_margin: 1.0\n", "", 1, "", "add safety_margin"),
    "missing key of a robot": (" target: [66, 22],", "", 21, "robots[0]", "add target"),
    "text for a number": ("time_limit: 300.0", "time_limit: 5 s", 9, "time_limit", "without unit"),
    "quoted number": ("seed: 1", 'seed: "1"', 3, "seed", "quotes"),
    "nan": ("safety_margin: 1.0", "safety_margin: .nan", 8, "safety_margin", ".nan is out of range"),
    "infinity": ("range_max: 15.0", "range_max: .inf", 19, "sensors[0].range_max", ".inf is out of range"),
    "negative": ("radius: 0.3}", "radius: -0.3}", 21, "robots[0].radius", "-0.3"),
    "zero": ("speed: 1.0", "speed: 0", 21, "robots[0].speed", "above 0"),
    "fraction for a whole number": ("time_window: 4", "time_window: 4.5", 6, "time_window", "whole number"),
    "null": ("name: factory", "name:", 1, "name", "no text"),
    "several lines": ("name: factory", 'name: "a\\nb"', 1, "name", "one line"),
    "list for a mapping": ("{circle: [40, 20, 2.5]}", "[40, 20, 2.5]", 13, "obstacles[1]", "no mapping"),
    "mapping for a list": ("robots:\n  - ", "robots:\n    a: ", 21, "robots", "a mapping is no list"),
    "obstacle without a shape": ("circle: [40, 20, 2.5]", "", 13, "obstacles[1]", "one shape"),
    "point of one number": ("start: [3, 22]", "start: [3]", 21, "robots[0].start", "expected 2"),
    "circle without radius": ("[40, 20, 2.5]", "[40, 20]", 13, "obstacles[1].circle", "expected 3"),
    "polygon of two corners": (
        "[10, 5], [14, 5], [14, 30], [10, 30]", "[1, 1], [2, 2]", 12, "obstacles[0].polygon", "three",
    ),
    "polygon on one line": (
        "[10, 5], [14, 5], [14, 30], [10, 30]", "[1, 1], [2, 2], [3, 3]", 12, "obstacles[0].polygon", "line",
    ),
    "polygon that crosses itself": (
        "[10, 5], [14, 5], [14, 30]", "[10, 5], [14, 30], [14, 5]", 12, "obstacles[0].polygon", "crosses itself",
    ),
    "corner given twice": ("[10, 5], [14, 5]", "[10, 5], [10, 5]", 12, "obstacles[0].polygon[1]", "repeats"),
    "far coordinates": ("[70, 0]", "[70000, 0]", 10, "workspace.polygon[1]", "far away"),
    "id used twice": ("id: cart_1", "id: person_1", 16, "movers[1].id", "used twice (first in line 15)"),
    "id that is no ROS name": ("id: lms_1", "id: lms-1", 18, "sensors[0].id", "no name"),
    "reserved id": ("id: robot_1", "id: sensors", 21, "robots[0].id", "reserved"),
    "unknown device": ("device: lms200", "device: lms300", 18, "sensors[0].device", "lms200, recorded"),
    "unknown noise": ("noise: none", "noise: some", 19, "sensors[0].noise", "none, lms200"),
    "resolution that does not divide": (
        "resolution_deg: 0.5", "resolution_deg: 0.7", 18, "sensors[0].resolution_deg", "179.9",
    ),
    "field of view": (
        "field_of_view_deg: 180", "field_of_view_deg: 400", 18, "sensors[0].field_of_view_deg", "at most 360",
    ),
    "loop": ("loop: true", "loop: yes", 15, "movers[0].loop", "true or false"),
    "two ways to move": ("velocity: [0.0, 0.3]", "velocity: [0, 0], speed: 1", 16, "movers[1].start", "either"),
    "no way to move": (", start: [50, 10], velocity: [0.0, 0.3]", "", 16, "movers[1]", "waypoints"),
    "one waypoint": ("[[20, 5], [20, 40]]", "[[20, 5]]", 15, "movers[0].waypoints", "at least two"),
    "start outside": ("start: [3, 22]", "start: [-3, 22]", 21, "robots[0].start", "outside the workspace"),
    "target outside": ("target: [66, 22]", "target: [66, 222]", 21, "robots[0].target", "outside the workspace"),
    "sensor outside": ("position: [2, 2]", "position: [2, 50]", 18, "sensors[0].position", "outside the workspace"),
    "blind sensor": ("position: [2, 2]", "position: [12, 10]", 18, "sensors[0].position", "inside obstacles[0]"),
    "margin below radius": ("radius: 0.3}", "radius: 1.3}", 8, "safety_margin", "centre"),
    "boundary as fast as a robot": ("boundary_speed: 0.5", "boundary_speed: 1", 7, "boundary_speed", "faster"),
    "fast mover on a way": ("speed: 0.4", "speed: 0.6", 15, "movers[0].speed", "boundary_speed"),
    "fast mover": ("[0.0, 0.3]", "[0.4, 0.4]", 16, "movers[1].velocity", "boundary_speed"),
    "control period": ("control_period: 0.05", "control_period: 0.3", 5, "control_period", "0.9"),
    "space: point": ("start: [3, 22]", "start: [3, 22, 1]", 21, "robots[0].start", "space"),
    "space: workspace": (
        "{polygon: [[0, 0], [70, 0], [70, 45], [0, 45]]}", "{box: [[0, 0, 0], [9, 9, 9]]}", 10, "workspace", "space",
    ),
    "space: obstacle": ("circle: [40, 20, 2.5]", "box: [[0, 0, 0], [1, 1, 1]]", 13, "obstacles[1]", "space"),
    "free without a return beside codes": (
        "noise: none", "no_return: free, error_codes: true", 19, "sensors[0].no_return", "unknown",
    ),
    "seed beyond what a double holds": ("seed: 1", "seed: 9007199254740994", 3, "seed", "from 0 to 9007199254740992"),
    "period below the control period": (
        "noise: none", "scan_period: 0.04", 19, "sensors[0].scan_period", "at least the control period",
    ),
    "period of zero": ("noise: none", "scan_period: 0", 19, "sensors[0].scan_period", "above 0"),
    "offset beyond the period": (
        "noise: none", "scan_period: 0.5, scan_offset: 0.5", 19, "sensors[0].scan_offset", "first scan",
    ),
    "offset beyond the sampling interval": (
        "noise: none", "scan_offset: 1.0", 19, "sensors[0].scan_offset", "not below the time 1 s",
    ),
    "sees robots": ("noise: none", "sees_robots: 1", 19, "sensors[0].sees_robots", "true or false"),
    "faults that are no list": ("noise: none", "faults: {kind: nan}", 19, "sensors[0].faults", "[{kind: ...}"),
    "fault without its kind": ("noise: none", "faults: [{share: 1}]", 19, "sensors[0].faults[0]", "add kind"),
    "unknown fault": ("noise: none", "faults: [{kind: lost}]", 19, "sensors[0].faults[0].kind", "drop_out, delay"),
    "fault without a key it needs": (
        "noise: none", "faults: [{kind: delay}]", 19, "sensors[0].faults[0]", "add seconds",
    ),
    "key of another fault": (
        "noise: none", "faults: [{kind: drop_out, share: 1}]", 19, "sensors[0].faults[0].share", "known here: kind",
    ),
    "fault that ends before it begins": (
        "noise: none", "faults: [{kind: nan, share: 1, from: 3, until: 3}]", 19, "sensors[0].faults[0].until",
        "3 is not after",
    ),
    "probability": (
        "noise: none", "faults: [{kind: drop_out, probability: 2}]", 19, "sensors[0].faults[0].probability",
        "at most 1",
    ),
    "share": ("noise: none", "faults: [{kind: nan, share: 0}]", 19, "sensors[0].faults[0].share", "above 0"),
    "delay into the past": (
        "noise: none", "faults: [{kind: delay, seconds: -1}]", 19, "sensors[0].faults[0].seconds", "at least 0",
    ),
    "no delay at all": (
        "noise: none", "faults: [{kind: delay, seconds: 0}]", 19, "sensors[0].faults[0].seconds", "changes nothing",
    ),
    "clock that is right": (
        "noise: none", "faults: [{kind: clock_offset, seconds: 0}]", 19, "sensors[0].faults[0].seconds", "remove",
    ),
    "beams neither more nor less": (
        "noise: none", "faults: [{kind: beam_count, change: 0}]", 19, "sensors[0].faults[0].change", "changes nothing",
    ),
    "too few beams left": (
        "noise: none", "faults: [{kind: beam_count, change: -360}]", 19, "sensors[0].faults[0].change", "1 of 361",
    ),
    "more beams than a turn has": (
        "noise: none", "faults: [{kind: beam_count, change: 200}, {kind: beam_count, change: 161}]", 19,
        "sensors[0].faults[0].change", "at most 721",
    ),
    "frozen without noise": (
        "noise: none", "faults: [{kind: frozen}]", 19, "sensors[0].faults[0].kind", "add noise: lms200",
    ),
    "leaves before it joins": (
        "radius: 0.3}", "radius: 0.3, joins_at: 5, leaves_at: 4.5}", 21, "robots[0].leaves_at", "give more than 5",
    ),
    "leaves at the instant at which it joins": (
        "radius: 0.3}", "radius: 0.3, joins_at: 4.2, leaves_at: 5}", 21, "robots[0].leaves_at", "more than 5",
    ),
    "joins before time begins": ("radius: 0.3}", "radius: 0.3, joins_at: -1}", 21, "robots[0].joins_at", "at least 0"),
    "leaves never": ("radius: 0.3}", "radius: 0.3, leaves_at: .inf}", 21, "robots[0].leaves_at", ".inf is out"),
    "target without its time": (
        "radius: 0.3}", "radius: 0.3, retargets: [{target: [5, 5]}]}", 21, "robots[0].retargets[0]", "add time",
    ),
    "targets in disorder": (
        "radius: 0.3}", "radius: 0.3, retargets: [{time: 9, target: [5, 5]}, {time: 8, target: [6, 5]}]}", 21,
        "robots[0].retargets[1].time", "in order",
    ),
    "target after it left": (
        "radius: 0.3}", "radius: 0.3, leaves_at: 7, retargets: [{time: 9, target: [5, 5]}]}", 21,
        "robots[0].retargets[0].time", "not before leaves_at 7",
    ),
    "later target outside": (
        "radius: 0.3}", "radius: 0.3, retargets: [{time: 9, target: [5, 555]}]}", 21,
        "robots[0].retargets[0].target", "outside the workspace",
    ),
    "broken YAML": ("seed: 1", "seed: [1", 4, "", "not valid YAML"),
}  # fmt: skip


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_named_with_line_key_and_remedy(example_text: str, mistake: str) -> None:
    old, new, line, key, word = MISTAKES[mistake]
    assert example_text.count(old) >= 1
    with pytest.raises(SceneError) as caught:
        parse_scene(example_text.replace(old, new, 1), "my.yaml")
    message = str(caught.value)
    assert message.startswith(f"my.yaml:{line}: {key}"), message
    assert word in message
    assert "\n" not in message
    assert message.count(": ") >= 2, "place, problem and remedy"


@pytest.mark.parametrize(
    "text", ["", "# nothing\n", "- a\n- b\n", "just words\n", "a: 1\n---\nb: 2\n", "{", "\x00"]
)
def test_what_is_no_scene_at_all(text: str) -> None:
    with pytest.raises(SceneError) as caught:
        parse_scene(text, "my.yaml")
    assert str(caught.value).startswith("my.yaml:")
    assert "\n" not in str(caught.value)


def test_robots_that_start_in_one_another(example_text: str) -> None:
    twin = example_text.splitlines()[-1].replace("robot_1", "robot_2").replace("[3, 22]", "[3.5, 22]")
    with pytest.raises(SceneError, match=r"my.yaml:22: robots\[1\].start: .* overlaps the disk of robot_1"):
        parse_scene(f"{example_text}{twin}\n", "my.yaml")


def test_a_scene_without_sensors(example_text: str) -> None:
    start, end = example_text.index("sensors:"), example_text.index("robots:")
    with pytest.raises(
        SceneError, match=r"my.yaml:17: sensors: an empty list: add at least one range finder"
    ):
        parse_scene(f"{example_text[:start]}sensors: []\n{example_text[end:]}", "my.yaml")


def test_recorded_and_simulated_sensors_do_not_mix(example_text: str) -> None:
    recorded = (
        "  - {id: old, device: recorded, position: [2, 2], heading_deg: 0, angle_min_deg: 0, resolution_deg: 1,"
        " range_max: 8, ranges: [1, 2]}\nrobots:"
    )
    with pytest.raises(SceneError, match=r"my.yaml:15: movers: beside recorded sensors"):
        parse_scene(example_text.replace("robots:", recorded), "my.yaml")


def test_a_negative_recorded_range() -> None:
    head = "name: n\nsampling_interval: 1\nsafety_margin: 1\nrobots: []\n"
    text = f"{head}workspace: {{polygon: [[0, 0], [1, 0], [1, 1]]}}\n"
    sensor = "{id: a, device: recorded, position: [0, 0], heading_deg: 0, angle_min_deg: 0, resolution_deg: 1"
    sensor += ", range_max: 8"
    with pytest.raises(SceneError, match=r"my.yaml:6: sensors\[0\].ranges\[1\]: -1 is negative"):
        parse_scene(f"{text}sensors: [{sensor}, ranges: [1, -1]}}]\n", "my.yaml")
    with pytest.raises(SceneError, match=r"more than one turn"):
        parse_scene(f"{text}sensors: [{sensor}, ranges: {[1] * 400}}}]\n", "my.yaml")


def test_a_file_that_is_not_there_or_no_text(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="cannot be read"):
        load_scene(tmp_path / "none.yaml")
    with pytest.raises(SceneError, match="cannot be read"):
        load_scene(tmp_path)
    file = tmp_path / "latin.yaml"
    file.write_bytes("name: x\ndescription: Gerät\n".encode("latin-1"))
    with pytest.raises(SceneError, match=r"latin.yaml:2: byte 0xe4 is no UTF-8"):
        load_scene(file)


def test_a_name_that_no_scene_has() -> None:
    with pytest.raises(SceneError, match=r"factry: no scene of this name .*did you mean factory\?"):
        find_scene("factry")
    with pytest.raises(SceneError, match="no such file"):
        find_scene("somewhere/factory.yaml")


def test_a_scene_is_frozen(example: object) -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        example.seed = 2  # type: ignore[attr-defined]
