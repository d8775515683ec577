"""Bags in other formats than snnav writes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from rosbags.convert.converter import convert
from rosbags.typesys import Stores, get_typestore

Convert = Callable[[Path, Path], Path]


@pytest.fixture
def convert_bag() -> Convert:
    """Return a function that writes a bag again: for ROS 1 where the target ends in .bag, else SQLite (.db3)."""

    def converted(source: Path, target: Path) -> Path:
        store = get_typestore(Stores.ROS1_NOETIC if target.suffix == ".bag" else Stores.ROS2_JAZZY)
        convert(
            srcs=[source],
            dst=target,
            dst_storage="sqlite3",
            dst_version=8,
            compress=None,
            compress_mode="message",
            default_typestore=get_typestore(Stores.ROS2_JAZZY),
            typestore=store,
            exclude_topics=[],
            include_topics=[],
            exclude_msgtypes=[],
            include_msgtypes=[],
        )
        return target

    return converted
