"""The recorded run under bags/: small, readable by others, and repeated to the last bit by fusion and planner."""

from __future__ import annotations

from pathlib import Path

from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from snnav_ros.bag.replay import replay

RUN = Path(__file__).parents[2] / "bags" / "thesis_ch3_scene1"
TOPICS = {"/unoccupied_area", "/robot_1/odom", "/robot_1/path", "/robot_1/certificate", "/clock"}


def test_it_is_small() -> None:
    assert sum(file.stat().st_size for file in RUN.rglob("*") if file.is_file()) < 1_000_000


def test_rosbags_and_mcap_read_it_alike() -> None:
    with AnyReader([RUN / "bag"], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as bag:
        counts = {topic: bag.topics[topic].msgcount for topic in bag.topics}
    with (RUN / "bag" / "bag.mcap").open("rb") as stream:
        reader = make_reader(stream)
        statistics = reader.get_summary().statistics
        found = {name.topic: 0 for name in reader.get_summary().channels.values()}
        for _, channel, _ in reader.iter_messages():
            found[channel.topic] += 1
    assert found == counts
    assert statistics.message_count == sum(counts.values())
    assert set(counts) >= TOPICS
    assert sum("/scan" in topic for topic in counts) == 17


def test_fusion_and_planner_repeat_it() -> None:
    again = replay(RUN / "bag")
    assert again.differences == []
    assert again.path_count >= 70
