"""`snnav import-depth` and `snnav free-space`: from depth images to a flight through what was really free."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from snnav_core.sensing.depth import DepthCamera, looking_at, pinhole
from snnav_ros.bag.cameras_file import OPTICAL
from snnav_ros.bag.messages import camera_info, organized_cloud, static_transforms
from snnav_ros.bag.recorded_depth import read_depth_recording
from snnav_ros.bag.writer import BagWriter
from snnav_ros.cli import main
from support.box_world import image

DATA = Path(__file__).parents[4] / "shared" / "data"
OFFICE = DATA / "depth_two_cameras_office"
ROOM = np.array([[0.0, 0.0, 0.0], [4.0, 3.0, 2.4]])
BOXES = np.array([[[2.0, 1.0, 0.0], [2.4, 1.5, 1.2]]])
SIZE, FOCAL, CENTRE = (160, 120), (140.0, 140.0), (79.5, 59.5)
PLACES = {"left": ([0.2, 2.7, 1.5], [3.0, 1.0, 0.9]), "right": ([0.2, 0.3, 1.2], [3.0, 2.0, 1.0])}


def camera(name: str) -> DepthCamera:
    position, aim = (np.array(point) for point in PLACES[name])
    return DepthCamera(name, position, looking_at(position, aim), pinhole(*SIZE, FOCAL, CENTRE))


def pose_of(one: DepthCamera) -> list[list[float]]:
    return np.column_stack((one.rotation @ OPTICAL, one.position)).tolist()


def room(place: Path, images: int = 2, **changes: Any) -> Path:
    """Write depth images of two cameras in a room with a box, and the file of cameras."""
    cameras: dict[str, dict[str, Any]] = {}
    for name in PLACES:
        one = camera(name)
        (place / name).mkdir(parents=True)
        depth = image(one, BOXES, ROOM).ranges * (one.model.rays() @ OPTICAL)[..., 2]
        for number in range(images):
            counts = np.rint(1000.0 * depth).astype(np.uint16)
            counts[10:14, 20 + number] = 0  # no reading
            Image.fromarray(counts).save(place / name / f"{number:02d}.png")
        cameras[name] = {
            "files": f"{name}/*.png",
            "size": list(SIZE),
            "focal": list(FOCAL),
            "centre": list(CENTRE),
            "pose": pose_of(one),
        }
    cameras["left"].update(changes)
    path = place / "cameras.json"
    path.write_text(json.dumps({"frame": "map", "cameras": cameras}), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("depth")
    assert main(["import-depth", str(room(place)), str(place / "room")]) == 0
    return place / "room"


def told(capsys: pytest.CaptureFixture[str]) -> str:
    text = capsys.readouterr().err.strip()
    assert text.startswith("snnav: ")
    assert "\n" not in text
    return text


def test_a_bag_gives_back_cameras_and_images(bag: Path) -> None:
    recording = read_depth_recording(bag, 9.0)
    assert [one.id for one in recording.cameras] == ["left", "right"]
    assert not recording.warnings
    for one in recording.cameras:
        true = camera(one.id)
        assert one.position == pytest.approx(true.position, abs=1e-9)
        assert one.rotation == pytest.approx(true.rotation, abs=1e-9)
        images = recording.images[one.id]
        assert [each.stamp for each in images] == [0.0, 1.0]
        exact = image(true, BOXES, ROOM).ranges
        for number, each in enumerate(images):
            lost = np.zeros(exact.shape, dtype=bool)
            lost[10:14, 20 + number] = True
            assert np.array_equal(np.isnan(each.ranges), lost)
            assert (
                np.abs(each.ranges - exact)[~lost].max() < 0.00085
            )  # half a count along the ray at the corner


def test_the_free_space_of_a_room_is_found_and_flown_through(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    options = ["--spacing", "0.08", "--margin", "0.2", "--range-growth", "0", "--pose-accuracy", "0.03"]
    ends = ["--robot", "1.3,1.5,1.3", "--goal", "3,1.6,1.4"]
    assert main(["free-space", str(bag), "--out", str(out), *options, *ends]) == 0
    capsys.readouterr()
    metrics = json.loads((out / "metrics.json").read_text(encoding="utf-8"))
    assert metrics["hits_in_free_region"] == 0
    assert [view["claims"] for view in metrics["views"]] == ["left", "right"]
    assert all(view["hits"] > 10_000 and view["carved"] == 0 for view in metrics["views"])
    flight = metrics["flight"]
    assert flight["reached"]
    assert flight["margin_violations"] == 0
    assert flight["least_certified_clearance"] >= 0.2
    assert min(flight["least_clearance"], flight["nearest_hit"]) >= 0.2
    rows = list(csv.DictReader((out / "trajectories.csv").open(encoding="utf-8")))
    assert [float(rows[0][name]) for name in "xyz"] == [1.3, 1.5, 1.3]
    assert np.linalg.norm([float(rows[-1][name]) for name in "xyz"] - np.array([3.0, 1.6, 1.4])) < 0.1
    for name in ("false_free.png", "scene.png", "cuts.png", "clearance.png", "view.html"):
        assert (out / "figures" / name).stat().st_size > 10_000
    views = list(csv.DictReader((out / "cross_views.csv").open(encoding="utf-8")))
    assert {row["false_free"] for row in views} == {"0"}


def test_a_wrong_pose_is_told_by_the_exit_status(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    wrong = np.array(pose_of(camera("left")))
    wrong[0, 3] -= 0.6
    source = room(tmp_path / "wrong", images=1, pose=wrong.tolist())
    assert main(["import-depth", str(source), str(tmp_path / "bag")]) == 0
    options = ["--spacing", "0.08", "--margin", "0.12", "--no-figures", "--out", str(tmp_path / "out")]
    assert main(["free-space", str(tmp_path / "bag"), *options]) == 1
    metrics = json.loads((tmp_path / "out" / "metrics.json").read_text(encoding="utf-8"))
    assert (
        max(row["share"] for view in metrics["views"] for row in view["by_margin"] if row["margin"] == 0.1)
        > 0.01
    )
    assert not (tmp_path / "out" / "figures").exists()


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"size": [160, 121]}, "has 160 x 120 pixels, the size of left is [160, 121]"),
        ({"size": [160]}, "write [columns, rows]"),
        ({"focal": [0, 140]}, "give two positive numbers"),
        ({"centre": [79.5]}, "write [column, row] in pixels"),
        ({"files": "nothing/*.png"}, "no file is named"),
        ({"pose": [[1, 0, 0, 0], [0, 1, 0, 0]]}, "write three rows of four numbers"),
        ({"pose": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, -1, 0]]}, "are no rotation"),
        ({"pose": [[1, 0, 0, 0], [0, 1, 0.1, 0], [0, 0, 1, 0]]}, "are no rotation"),
        ({"unit": 0}, "out of range"),
        ({"fokal": [1, 1]}, "did you mean focal?"),
    ],
)
def test_a_wrong_file_of_cameras_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], changes: dict[str, Any], said: str
) -> None:
    source = room(tmp_path / "room", images=1, **changes)
    assert main(["import-depth", str(source), str(tmp_path / "bag")]) == 2
    assert said in told(capsys)
    assert not (tmp_path / "bag").exists()


@pytest.mark.parametrize("damage", ["cut", "grey", "empty", "colour"])
def test_a_damaged_image_is_one_line_and_leaves_no_bag(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], damage: str
) -> None:
    source = room(tmp_path / "room", images=1)
    file = tmp_path / "room" / "right" / "00.png"
    if damage == "cut":
        file.write_bytes(file.read_bytes()[:3000])
    elif damage == "grey":
        Image.fromarray(np.zeros((120, 160), dtype=np.uint8)).save(file)
    elif damage == "colour":
        Image.fromarray(np.zeros((120, 160, 3), dtype=np.uint8)).save(file)
    else:
        Image.fromarray(np.zeros((120, 160), dtype=np.uint16)).save(file)
    assert main(["import-depth", str(source), str(tmp_path / "bag")]) == 2
    text = told(capsys)
    assert str(file) in text
    assert {"cut": "copy it again", "grey": "16-bit", "colour": "16-bit", "empty": "no reading"}[
        damage
    ] in text
    assert not (tmp_path / "bag").exists()


def test_a_cloud_off_its_rays_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source = room(tmp_path / "room", images=1, files="left.pcd")
    rays = (camera("left").model.rays() @ OPTICAL).reshape(-1, 3).astype("<f4")
    lines = "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 160\nHEIGHT 120\nDATA binary\n"
    (tmp_path / "room" / "left.pcd").write_bytes(lines.encode() + (2.0 * rays).tobytes())
    assert main(["import-depth", str(source), str(tmp_path / "good")]) == 0
    capsys.readouterr()
    (tmp_path / "room" / "left.pcd").write_bytes(lines.encode() + (2.0 * rays[:, [1, 0, 2]]).tobytes())
    assert main(["import-depth", str(source), str(tmp_path / "bag")]) == 2
    assert "pixels off where focal and centre of left say" in told(capsys)


def tiny(path: Path, cloud_frame: str = "eye_optical", parent: str = "map", info: bool = True) -> Path:
    """Write a bag as another driver would: clouds in the optical frame, its tree of frames in two steps."""
    one = DepthCamera("eye", np.array([0.0, 0.0, 1.0]), np.eye(3), pinhole(4, 3, (4.0, 4.0), (1.5, 1.0)))
    points = 2.0 * one.model.rays() @ OPTICAL
    points[0, 0] = np.nan
    frames = [
        (parent, "stand", np.array([0.0, 0.0, 0.4]), np.eye(3)),
        ("stand", "eye_optical", np.array([0.0, 0.0, 0.6]), OPTICAL),
        ("map", "aside", np.array([5.0, 0.0, 0.0]), np.eye(3)),
    ]
    with BagWriter(path) as bag:
        bag.write("tf_static", static_transforms(0, frames), 0)
        for stamp in (5_000_000_000, 5_100_000_000):
            bag.write("eye/depth/points", organized_cloud(stamp, cloud_frame, points), stamp)
            if info:
                message = camera_info(stamp, "eye_optical", (4, 3), (4.0, 4.0), (1.5, 1.0))
                bag.write("eye/depth/camera_info", message, stamp)
    return path


def test_bags_of_other_drivers_are_read(tmp_path: Path) -> None:
    recording = read_depth_recording(tiny(tmp_path / "bag"), 9.0)
    (one,) = recording.cameras
    assert one.id == "depth"
    assert one.position == pytest.approx([0.0, 0.0, 1.0])
    assert one.rotation == pytest.approx(np.eye(3))
    first, second = recording.images["depth"]
    assert (first.stamp, second.stamp) == (0.0, pytest.approx(0.1))
    assert np.isnan(first.ranges[0, 0])
    assert np.nanmin(first.ranges) == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"parent": "odom"}, "does not say where frame 'eye_optical' is in 'map' (it ends at 'odom')"),
        ({"cloud_frame": "aside"}, "publish the cloud in the frame of its camera_info"),
        ({"cloud_frame": "moon"}, "does not say where frame 'moon' is"),
        ({"info": False}, "has no depth camera"),
    ],
)
def test_bags_that_lack_something_are_told_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: dict[str, Any], said: str
) -> None:
    assert main(["free-space", str(tiny(tmp_path / "bag", **options)), "--out", str(tmp_path / "out")]) == 2
    assert said in told(capsys)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--robot", "1,1,1"], "--robot and --goal go together"),
        (["--margin", "1.5", "--radius", "0.1"], "nowhere is room for a robot"),
        (["--margin", "0.05"], "safety_margin 0.05 m is below"),
        (["--spacing", "0.001"], "choose another spacing"),
        (["--range-max", "0.1"], "no reading within the range"),
    ],
)
def test_options_that_cannot_be_are_told_in_one_line(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], said: str
) -> None:
    coarse = [] if "--spacing" in options else ["--spacing", "0.1"]
    assert main(["free-space", str(bag), "--out", str(tmp_path / "out"), *coarse, *options]) == 2
    assert said in told(capsys)
    assert not (tmp_path / "out").exists()


@pytest.mark.skipif(not OFFICE.is_dir(), reason=f"no recorded images in {OFFICE}")
def test_the_free_space_of_a_real_office_holds_less_than_one_percent_of_the_other_cameras_hits(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lens = json.loads((OFFICE / "intrinsics.json").read_text(encoding="utf-8"))
    poses = json.loads((OFFICE / "poses_derived.json").read_text(encoding="utf-8"))
    cameras = {
        f"cam{number}": {
            "files": str(OFFICE / f"cam{number}" / "depth_0[1-3].png"),
            "size": [lens["width"], lens["height"]],
            "unit": lens["depth_unit_m"],
            "focal": [lens["fx"], lens["fy"]],
            "centre": [lens["cx"], lens["cy"]],
            "pose": poses[f"T_world_cam{number}"],
        }
        for number in (1, 2)
    }
    (tmp_path / "office.json").write_text(json.dumps({"cameras": cameras}), encoding="utf-8")
    assert main(["import-depth", str(tmp_path / "office.json"), str(tmp_path / "office")]) == 0
    assert "90.3 %" in capsys.readouterr().out
    out = tmp_path / "out"
    assert main(["free-space", str(tmp_path / "office"), "--out", str(out), "--no-figures"]) == 0
    metrics = json.loads((out / "metrics.json").read_text(encoding="utf-8"))
    for view in metrics["views"]:
        assert view["pairs"] == 3
        assert view["hits"] > 300_000
        (row,) = (row for row in view["by_margin"] if row["margin"] == 0.1)
        assert row["open_share"] < 0.001  # ten times below what is asked for
        assert view["carved_share"] > 0.02  # what errors of the poses do, without the margin
    assert metrics["flight"]["reached"]
    assert metrics["flight"]["margin_violations"] == 0
