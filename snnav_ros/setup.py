"""Packaging of snnav_ros for colcon, ament and pip."""

from pathlib import Path

from setuptools import find_packages, setup

PACKAGE = "snnav_ros"
NODES = [
    "lms200_node",
    "tof_node",
    "fusion_node",
    "planner_node",
    "tracker_node",
    "global_planner_node",
    "robot_node",
    "clock_node",
    "operator_node",
]
SHARED_FOLDERS = ["launch", "config", "rviz"]

setup(
    name=PACKAGE,
    version="0.1.0",
    description="Sensor-network navigation: ROS 2 nodes and the snnav command",
    license="Apache-2.0",
    author="snnav maintainers",
    maintainer="snnav maintainers",
    maintainer_email="snnav-maintainers@example.org",
    python_requires=">=3.11",
    package_dir={"": "."},  # said in so many words, pip links an editable installation by a plain .pth
    packages=find_packages(),
    package_data={PACKAGE: ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        *[
            (f"share/{PACKAGE}/{folder}", sorted(map(str, Path(folder).glob("*.*"))))
            for folder in SHARED_FOLDERS
        ],
    ],
    install_requires=["setuptools", "snnav_core", "snnav_sim", "numpy>=1.26", "PyYAML>=6", "rosbags", "rich"],
    extras_require={"test": ["pytest", "pytest-timeout", "hypothesis"]},
    entry_points={
        "console_scripts": [
            "snnav = snnav_ros.cli:main",
            *[f"{node} = {PACKAGE}.nodes.{node}:main" for node in NODES],
        ]
    },
    zip_safe=False,
)
