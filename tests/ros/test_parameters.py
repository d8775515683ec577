"""Parameters: declared from dataclasses, checked at the start."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import Any, Literal, get_type_hints

import pytest
from rcl_interfaces.msg import ParameterType
from rclpy.node import Node
from rclpy.parameter import Parameter

from snnav_core.area.fusion import FusionSettings
from snnav_core.area.spatial_fusion import SpatialFusionSettings
from snnav_core.errors import InvalidInput
from snnav_core.navigator.flight_settings import FlightSettings
from snnav_core.navigator.settings import NavigatorSettings
from snnav_core.planning.adjustment import AdjustmentSettings
from snnav_core.planning.roadmap import RoadmapSettings
from snnav_core.sensing.scan import ScanSettings
from snnav_core.tracking.planar import TrackerSettings
from snnav_core.tracking.spatial import SpatialTrackerSettings
from snnav_ros.nodes.cameras import CameraParameters
from snnav_ros.nodes.clock import ClockParameters
from snnav_ros.nodes.fusion import FusionParameters
from snnav_ros.nodes.fusion_plane import PlaneParameters
from snnav_ros.nodes.fusion_space import SpaceParameters
from snnav_ros.nodes.planner import PlannerParameters
from snnav_ros.nodes.range_finder import RangeFinderParameters
from snnav_ros.nodes.robot import RobotParameters
from snnav_ros.parameter_files import ParameterFileError, check_parameter_files
from snnav_ros.parameter_ranges import RANGES
from snnav_ros.parameters import ParameterError, ParameterReader, field_texts

ALL = [
    FusionSettings, NavigatorSettings, AdjustmentSettings, ScanSettings, TrackerSettings,
    FlightSettings, RoadmapSettings, SpatialTrackerSettings,
    ClockParameters, FusionParameters, PlaneParameters, SpaceParameters, SpatialFusionSettings, CameraParameters,
    RangeFinderParameters, PlannerParameters, RobotParameters,
]  # fmt: skip


@dataclass(frozen=True)
class Inner:
    """Inner.

    Parameters
    ----------
    pull : float
        How strong.
    """

    pull: float = 0.5


@dataclass(frozen=True)
class Example:
    """Example.

    Parameters
    ----------
    safety_margin : float
        Distance to keep,
        in metres.
    time_window, count : int
        How many.
    law : {"a", "b"}
        Which.
    weights : tuple of float
        Some numbers.
    limit : float or None
        At most this.
    on : bool
        Whether.
    inner : Inner
        A group.
    """

    safety_margin: float
    time_window: int = 4
    count: int = 1
    law: Literal["a", "b"] = "a"
    weights: tuple[float, ...] = ()
    limit: float | None = None
    on: bool = True
    inner: Inner = field(default_factory=Inner)

    def __post_init__(self) -> None:
        if self.limit is not None and self.limit < self.safety_margin:
            raise InvalidInput(f"limit {self.limit} is below safety_margin {self.safety_margin}")


def reader_of(graph: Any, **given: Any) -> tuple[Node, ParameterReader]:
    node = Node(
        "site",
        context=graph.context,
        start_parameter_services=False,
        automatically_declare_parameters_from_overrides=True,
        parameter_overrides=[Parameter(name, value=value) for name, value in given.items()],
    )
    graph.nodes.append(node)
    return node, ParameterReader(node)


def test_values_come_from_overrides_defaults_and_the_dataclass(graph: Any) -> None:
    given = {"time_window": 7, "weights": [1, 2], "limit": 3, "inner.pull": 0.25, "law": "b"}
    node, reader = reader_of(graph, **given)
    settings = reader.settings(Example, safety_margin=1.5)
    reader.finish()
    assert settings == Example(1.5, 7, 1, "b", (1.0, 2.0), 3.0, True, Inner(0.25))
    assert node.get_parameter("limit").value == 3.0
    assert list(node.get_parameter("weights").value) == [1.0, 2.0]


def test_descriptor_has_text_range_and_is_read_only(graph: Any) -> None:
    node, reader = reader_of(graph, safety_margin=0.7)
    reader.settings(Example)
    descriptor = node.describe_parameter("safety_margin")
    assert descriptor.description == "Distance to keep, in metres."
    assert descriptor.type == ParameterType.PARAMETER_DOUBLE
    low, high = RANGES["safety_margin"]
    (limits,) = descriptor.floating_point_range
    assert (limits.from_value, limits.to_value) == (low, high)
    assert node.describe_parameter("time_window").integer_range[0].from_value == 1
    assert node.describe_parameter("count").description == "How many."
    (result,) = node.set_parameters([Parameter("safety_margin", value=0.1)])
    assert not result.successful


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({}, "/site: parameter safety_margin: is not given"),
        ({"safety_margin": "wide"}, "safety_margin: value 'wide' is no number"),
        ({"safety_margin": True}, "safety_margin: value True is no number"),
        ({"safety_margin": 0.0}, r"safety_margin: value 0.0 lies outside \[0.001, 1000\]"),
        ({"safety_margin": math.nan}, "safety_margin: value nan lies outside"),
        ({"safety_margin": 1.0, "time_window": 1.5}, "time_window: value 1.5 is no whole number"),
        ({"safety_margin": 1.0, "law": "c"}, "law: value 'c' must be one of 'a', 'b'"),
        ({"safety_margin": 1.0, "weights": 3.0}, "weights: value 3.0 is no list"),
        ({"safety_margin": 1.0, "on": 1}, "on: value 1 is no truth value"),
        ({"safety_margin": 1.0, "limit": 0.5}, "limit 0.5 is below safety_margin 1.0"),
        ({"safety_margin": 1.0, "inner.pull": -1.0}, "inner.pull: value -1.0 lies outside"),
        (
            {"safety_margin": 1.0, "safty_margin": 2.0},
            r"safty_margin: is unknown \(value 2.0\); did you mean safety_margin",
        ),
        ({"safety_margin": 1.0, "inner.push": 2.0}, "inner.push: is unknown"),
    ],
)
def test_mistakes_are_one_line_with_key_and_value(graph: Any, given: dict[str, Any], text: str) -> None:
    _, reader = reader_of(graph, **given)

    def read() -> None:
        reader.settings(Example)
        reader.finish()

    with pytest.raises(ParameterError, match=text) as caught:
        read()
    assert "\n" not in str(caught.value)


def test_parameters_of_ros_itself_are_no_mistakes(graph: Any) -> None:
    _, reader = reader_of(graph, safety_margin=1.0, use_sim_time=True)
    reader.settings(Example)
    reader.finish()


@pytest.mark.parametrize("kind", ALL)
def test_every_field_has_a_text(kind: type) -> None:
    texts, hints = field_texts(kind), get_type_hints(kind)
    plain = [one.name for one in fields(kind) if one.init and not is_dataclass(hints[one.name])]
    missing = [name for name in plain if not texts.get(name)]
    assert not missing, f"{kind.__name__}: describe {missing} in the docstring"


@pytest.mark.parametrize("kind", ALL)
def test_every_number_has_a_range(kind: type) -> None:
    numbers = [one.name for one in fields(kind) if str(one.type).startswith(("float", "int"))]
    free = {"heading_deg"}
    missing = [name for name in numbers if name not in RANGES and name not in free]
    assert not missing, f"{kind.__name__}: give {missing} a range in parameter_ranges.py"


def test_no_time_out_can_be_switched_off() -> None:
    for name in ("max_scan_age", "max_area_age", "max_odometry_age", "sampling_interval", "control_period"):
        assert RANGES[name][0] > 0.0
        assert math.isfinite(RANGES[name][1])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: [1,", r"site.yaml:2: is no YAML"),
        ("just words", "holds no nodes"),
        ("a: {ros__parameters: {position: [0, 0.5]}}", r"a.ros__parameters.position: \[0, 0.5\] mixes"),
        ("a: {ros__parameters: {sensors: []}}", "a.ros__parameters.sensors: has no value"),
        ("a: {ros__parameters: {scene: }}", "a.ros__parameters.scene: has no value"),
        ("a: {ros__parameters: {points: [[1.0, 2.0]]}}", "list of one kind"),
    ],
)
def test_parameter_files_are_checked_before_ros_reads_them(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "site.yaml"
    file.write_text(text + "\n", encoding="utf-8")
    with pytest.raises(ParameterFileError, match=message) as caught:
        check_parameter_files(["node", "--ros-args", "--params-file", str(file)])
    assert "\n" not in str(caught.value)
    with pytest.raises(ParameterFileError, match="cannot be read"):
        check_parameter_files(["node", "--params-file", str(tmp_path / "none.yaml")])
