"""Bags: what is written reads back everywhere, and what cannot be read says why in one line."""

from __future__ import annotations

import array
import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.rosbag1 import Writer as Rosbag1Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Rosbag2Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from snnav_core.types import Pose2D
from snnav_ros.bag.errors import BagError
from snnav_ros.bag.messages import jazzy_types, laser_scan, pose_of, pose_stamped
from snnav_ros.bag.reader import BagReader
from snnav_ros.bag.writer import BagWriter
from snnav_ros.convert import nanoseconds_from_stamp

DATA = Path(__file__).parents[3].parent / "shared" / "data"
RANGES = [1.0, 2.5, float("inf"), float("nan"), 0.0]


def scan(stamp_ns: int):
    return laser_scan(stamp_ns, "laser", RANGES, -1.0, 0.5, 80.0)


def write_bag(directory: Path, count: int = 4, **options) -> Path:
    with BagWriter(directory, **options) as bag:
        for k in range(count):
            bag.write("scan", scan(k * 1000), k * 1000)
            bag.write("/pose", pose_stamped(k * 1000, "map", Pose2D(k, -k, 0.1 * k)), k * 1000)
    return directory


def error_of(path: Path, topics: list[str] | None = None) -> str:
    with pytest.raises(BagError) as caught, BagReader(path) as bag:
        list(bag.messages(topics))
    text = str(caught.value)
    assert "\n" not in text
    assert str(path) in text
    return text


@pytest.mark.parametrize("compress", [True, False])
def test_bag_reads_back_with_rosbags_mcap_and_own_reader(tmp_path: Path, compress: bool) -> None:
    path = write_bag(tmp_path / "run", compress=compress)
    with AnyReader([path]) as reader:
        assert reader.message_count == 8
        assert {c.topic for c in reader.connections} == {"/scan", "/pose"}
    with (path / "run.mcap").open("rb") as stream:
        raw = list(make_reader(stream).iter_messages(topics=["/scan"]))
    assert [message.log_time for _, _, message in raw] == [0, 1000, 2000, 3000]
    for form in (path, path / "run.mcap"):
        with BagReader(form) as bag:
            messages = list(bag.messages(["scan"]))
            poses = [pose_of(m.message.pose) for m in bag.messages(["pose"])]
        assert [nanoseconds_from_stamp(m.message.header.stamp) for m in messages] == [0, 1000, 2000, 3000]
        np.testing.assert_array_equal(messages[1].message.ranges, np.array(RANGES, dtype=np.float32))
        assert [p.heading for p in poses] == pytest.approx([0.0, 0.1, 0.2, 0.3])


def test_metadata_is_that_of_jazzy_and_latched_topics_offer_transient_local(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "run") as bag:
        for topic in ("unoccupied_area", "robot_1/map", "scan"):
            bag.write(topic, scan(5), 5)
    info = yaml.safe_load((tmp_path / "run" / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert info["version"] == 9
    assert info["storage_identifier"] == "mcap"
    assert info["relative_file_paths"] == ["run.mcap"]
    assert isinstance(info["custom_data"], dict)
    offered = {
        entry["topic_metadata"]["name"]: [
            (qos["durability"], qos["reliability"], qos["history"], qos["depth"])
            for qos in entry["topic_metadata"]["offered_qos_profiles"]
        ]
        for entry in info["topics_with_message_count"]
    }
    latched = [("transient_local", "reliable", "keep_last", 1)]
    assert offered == {"/unoccupied_area": latched, "/robot_1/map": latched, "/scan": []}


def test_rclpy_messages_are_written_like_those_of_rosbags(tmp_path: Path) -> None:
    pytest.importorskip("rclpy", reason="rclpy is not installed")
    from sensor_msgs.msg import LaserScan

    message = LaserScan()
    message.header.frame_id = "laser"
    message.header.stamp.nanosec = 77
    message.range_max = 80.0
    message.angle_min, message.angle_increment, message.angle_max = -1.0, 0.5, 1.0
    message.ranges = array.array("f", RANGES)
    with BagWriter(tmp_path / "run") as bag:
        bag.write("scan", message, 77)
        bag.write("scan", scan(77), 78)
    with BagReader(tmp_path / "run") as bag:
        first, second = (jazzy_types().serialize_cdr(m.message, m.type_name) for m in bag.messages())
    assert bytes(first) == bytes(second)


@given(stamps=st.lists(st.integers(0, 2**40), min_size=1, max_size=30), compress=st.booleans())
@settings(max_examples=15, deadline=None)
def test_messages_come_back_in_order_of_their_stamps(
    tmp_path_factory, stamps: list[int], compress: bool
) -> None:
    path = tmp_path_factory.mktemp("bag") / "run"
    with BagWriter(path, compress=compress) as bag:
        for stamp in stamps:
            bag.write("pose", pose_stamped(stamp, "map", Pose2D(0.0, 0.0, 0.0)), stamp)
    with BagReader(path) as bag:
        assert [m.stamp_ns for m in bag.messages()] == sorted(stamps)


def test_a_failed_recording_leaves_nothing_behind(tmp_path: Path) -> None:
    class Stopped(Exception):
        pass

    def record() -> None:
        with BagWriter(tmp_path / "run") as bag:
            bag.write("scan", scan(0), 0)
            raise Stopped

    with pytest.raises(Stopped):
        record()
    assert list(tmp_path.iterdir()) == []


def test_writer_names_what_is_wrong(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    with pytest.raises(BagError, match="there: exists already"), BagWriter(tmp_path / "there"):
        pass
    with pytest.raises(BagError, match="no message was written"), BagWriter(tmp_path / "empty"):
        pass
    (tmp_path / "file").write_text("")
    with pytest.raises(BagError, match="cannot be made"), BagWriter(tmp_path / "file" / "run"):
        pass
    for topic, message, stamp, text in (
        ("scan", scan(0), -1, "stamp -1 ns"),
        ("scan", object(), 0, "'scan': object is no ROS message"),
        ("scan", pose_stamped(0, "map", Pose2D(0, 0, 0)), 0, "holds sensor_msgs/msg/LaserScan, got geometry"),
    ):
        bag = BagWriter(tmp_path / "run")
        bag.open()
        bag.write("scan", scan(0), 0)
        with pytest.raises(BagError, match=text):
            bag.write(topic, message, stamp)
        bag.abort()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["file", "there"]


def test_reader_lists_the_topics_there_are(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "run")
    assert "no topic 'scna'; the bag has /pose, /scan" in error_of(path, ["scna"])
    with BagReader(path) as bag:
        assert list(bag.messages([])) == []
        with pytest.raises(BagError, match="'pose' is a geometry_msgs/msg/PoseStamped, expected sensor_msgs"):
            bag.require("pose", "sensor_msgs/msg/LaserScan")


@pytest.mark.parametrize("share", [0.0, 0.01, 0.5, 0.98])
def test_cut_short_files_are_refused(tmp_path: Path, share: float) -> None:
    path = write_bag(tmp_path / "run", count=200)
    file = path / "run.mcap"
    content = file.read_bytes()
    file.write_bytes(content[: int(share * len(content))])
    assert "damaged or cut short" in error_of(path)
    plain = error_of(file)
    assert ("the file is empty" if share == 0.0 else "damaged or cut short") in plain


@given(position=st.integers(0, 10**6), value=st.integers(0, 255))
@settings(max_examples=60, deadline=None)
def test_a_changed_byte_never_gives_another_error_than_one_line(
    tmp_path_factory, position: int, value: int
) -> None:
    path = write_bag(tmp_path_factory.mktemp("bag") / "run") / "run.mcap"
    content = bytearray(path.read_bytes())
    content[position % len(content)] = value
    path.write_bytes(content)
    stamps, text = [], ""
    try:
        with BagReader(path) as bag:
            stamps = [m.stamp_ns for m in bag.messages()]
    except BagError as error:
        text = str(error)
    assert "\n" not in text
    assert text or len(stamps) > 0


def test_what_is_no_bag_is_refused(tmp_path: Path) -> None:
    assert "does not exist" in error_of(tmp_path / "missing.mcap")
    (tmp_path / "notes.txt").write_text("hello")
    assert "is not a bag" in error_of(tmp_path / "notes.txt")
    (tmp_path / "folder").mkdir()
    assert "no metadata.yaml" in error_of(tmp_path / "folder")
    for name in ("a.mcap", "a.bag", "a.db3"):
        (tmp_path / name).write_text("this is no bag " * 20)
        assert "cannot be opened" in error_of(tmp_path / name)
    (tmp_path / "folder" / "metadata.yaml").write_text("- nothing\n- here\n")
    assert "cannot be opened" in error_of(tmp_path / "folder")


def test_an_empty_bag_and_an_unknown_type_are_named(tmp_path: Path) -> None:
    with Rosbag2Writer(tmp_path / "empty", version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        writer.add_connection("/scan", "sensor_msgs/msg/LaserScan", typestore=jazzy_types())
    assert "the bag is empty" in error_of(tmp_path / "empty")
    store = get_typestore(Stores.ROS2_JAZZY)
    store.register(get_types_from_msg("int32 value", "own_msgs/msg/Odd"))
    with Rosbag2Writer(tmp_path / "odd", version=8, storage_plugin=StoragePlugin.SQLITE3) as writer:
        connection = writer.add_connection("/odd", "own_msgs/msg/Odd", typestore=store)
        odd = store.types["own_msgs/msg/Odd"](value=3)
        writer.write(connection, 1, store.serialize_cdr(odd, "own_msgs/msg/Odd"))
    with BagReader(tmp_path / "odd") as bag:
        assert [m.message.value for m in bag.messages()] == [3]
    hide_definitions(tmp_path / "odd" / "odd.db3")
    assert "type own_msgs/msg/Odd, which neither the bag nor ROS 2 Jazzy defines" in error_of(
        tmp_path / "odd"
    )


def hide_definitions(database: Path) -> None:
    import sqlite3

    connection = sqlite3.connect(database)
    connection.execute("DELETE FROM message_definitions")
    connection.commit()
    connection.close()


def test_ros1_bags_read_the_same_way(tmp_path: Path) -> None:
    store, kind = get_typestore(Stores.ROS1_NOETIC), "geometry_msgs/msg/PoseStamped"

    def new(name: str, **fields):
        return store.types[name](**fields)

    header = new(
        "std_msgs/msg/Header",
        seq=0,
        stamp=new("builtin_interfaces/msg/Time", sec=3, nanosec=4),
        frame_id="map",
    )
    point = new("geometry_msgs/msg/Point", x=1.0, y=2.0, z=0.0)
    turn = new("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=1.0, w=0.0)
    message = new(kind, header=header, pose=new("geometry_msgs/msg/Pose", position=point, orientation=turn))
    with Rosbag1Writer(tmp_path / "old.bag") as writer:
        connection = writer.add_connection("/pose", kind, typestore=store)
        writer.write(connection, 9, store.serialize_ros1(message, kind))
    with BagReader(tmp_path / "old.bag") as bag:
        (message,) = bag.messages(["pose"])
    assert (message.type_name, message.stamp_ns, nanoseconds_from_stamp(message.message.header.stamp)) == (
        kind,
        9,
        3_000_000_004,
    )
    assert pose_of(message.message.pose) == Pose2D(1.0, 2.0, pytest.approx(np.pi))
    shutil.copy(tmp_path / "old.bag", tmp_path / "short.bag")
    content = (tmp_path / "old.bag").read_bytes()
    (tmp_path / "short.bag").write_bytes(content[: len(content) // 2])
    assert "damaged or cut short" in error_of(tmp_path / "short.bag")


@pytest.mark.skipif(not DATA.is_dir(), reason="recordings of shared/data are not there")
@pytest.mark.parametrize(
    ("name", "topic", "count", "beams"),
    [
        ("static_laser_people/positive_4.bag", "right_scan", 307, 768),
        ("static_laser_people/positive_4_ros2", "/right_scan", 307, 768),
        ("ros2_create3_olin/macfirst_floor_take_2", "scan", 357, 720),
        ("static_rplidar_a3/2019-07-31-10-32-43.bag", "hog/scan0", 97, 1440),
    ],
)
def test_real_recordings_of_all_kinds(name: str, topic: str, count: int, beams: int) -> None:
    with BagReader(DATA / name) as bag:
        bag.require(topic, "sensor_msgs/msg/LaserScan")
        lengths = [len(m.message.ranges) for m in bag.messages([topic])]
    assert lengths == [beams] * count


@pytest.mark.parametrize("name", ["run.bag", "run.mcap", "run.db3", "run"])
def test_a_directory_may_have_any_name(tmp_path: Path, name: str) -> None:
    with BagReader(write_bag(tmp_path / name)) as bag:
        assert len(list(bag.messages())) == 8


def test_what_repeats_costs_little_and_large_bags_read_back(tmp_path: Path) -> None:
    ranges = np.random.default_rng(1).uniform(1, 9, 30_000)  # 120 kB that compression can do nothing about
    with BagWriter(tmp_path / "run") as bag:
        for k in range(200):
            bag.write("scan", laser_scan(k, "laser", ranges, -1.0, 1e-4, 80.0), k)
    assert (tmp_path / "run" / "run.mcap").stat().st_size < 500_000
    with (tmp_path / "run" / "run.mcap").open("rb") as stream:
        reader = make_reader(stream)
        assert reader.get_summary().statistics.chunk_count == 2
        assert [message.log_time for _, _, message in reader.iter_messages()] == list(range(200))
    with BagReader(tmp_path / "run") as bag:
        assert [m.stamp_ns for m in bag.messages()] == list(range(200))
