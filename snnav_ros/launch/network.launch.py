"""Fusion, planner and a tracker per robot for real scanners and robots.

    ros2 launch snnav_ros network.launch.py config:=site.yaml robots:=cart_1,cart_2
    ros2 launch snnav_ros network.launch.py config:=site.yaml remap:=/front/scan=sensors/north/scan
    ros2 launch snnav_ros network.launch.py config:=site.yaml planner:=global

The configuration holds the parameters of all nodes (`config/network.yaml` is a commented example). The drivers of
scanners and bases are started elsewhere.
"""

from pathlib import Path

from launch.actions import DeclareLaunchArgument, OpaqueFunction, Shutdown
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

from launch import LaunchContext, LaunchDescription


def network_nodes(context: LaunchContext) -> list[Node]:
    """Return the nodes that the arguments ask for."""
    config = existing(LaunchConfiguration("config").perform(context))
    robots = [name for name in LaunchConfiguration("robots").perform(context).split(",") if name]
    remappings = remappings_of(LaunchConfiguration("remap").perform(context))

    def node(executable: str, name: str) -> Node:
        return Node(
            package="snnav_ros",
            executable=executable,
            name=name,
            namespace=LaunchConfiguration("namespace").perform(context),
            parameters=[config],
            remappings=remappings,
            output="screen",
            on_exit=Shutdown(reason=f"{name} ended"),
        )

    plans_globally = LaunchConfiguration("planner").perform(context) == "global"
    planners = ("tracker_node", "global_planner_node") if plans_globally else ("planner_node",)
    return [
        node("fusion_node", "fusion_node"),
        *(node(name, name) for name in planners),
        *(node("robot_node", robot) for robot in robots),
    ]


def existing(config: str) -> str:
    """Return the path of the configuration; launch itself would go on without the file.

    Raises
    ------
    ValueError
        If it is no file.
    """
    if not Path(config).is_file():
        raise ValueError(f"config:={config} is no file; give the file with the parameters of the nodes")
    return config


def remappings_of(text: str) -> list[tuple[str, str]]:
    """Return the pairs (our topic, driver topic): a node hears the driver's where it would hear its own.

    Raises
    ------
    ValueError
        If a pair is none.
    """
    pairs = [pair.partition("=") for pair in text.split(",") if pair]
    for drivers, sign, ours in pairs:
        if not (drivers and sign and ours):
            raise ValueError(f"remap:={text}: {drivers}{sign}{ours} is no pair; write driver_topic=our_topic")
    return [(ours, drivers) for drivers, _, ours in pairs]


def generate_launch_description() -> LaunchDescription:
    """Return the description for `ros2 launch`."""
    share = FindPackageShare("snnav_ros")
    rviz = Node(
        package="rviz2",
        executable="rviz2",
        arguments=["-d", PathJoinSubstitution([share, "rviz", "snnav.rviz"])],
        condition=IfCondition(LaunchConfiguration("rviz")),
    )
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "config",
                default_value=PathJoinSubstitution([share, "config", "network.yaml"]),
                description="parameters of all nodes",
            ),
            DeclareLaunchArgument(
                "robots", default_value="", description="robots that get a tracker, by commas"
            ),
            DeclareLaunchArgument(
                "planner",
                default_value="local",
                choices=["local", "global"],
                description="safe whatever moves how, or shortest among bodies that keep their velocities",
            ),
            DeclareLaunchArgument("remap", default_value="", description="driver topic=our topic, by commas"),
            DeclareLaunchArgument("namespace", default_value="", description="before all names"),
            DeclareLaunchArgument("rviz", default_value="false", description="open RViz"),
            rviz,  # before the nodes: where there is no RViz, none of them is started
            OpaqueFunction(function=network_nodes),
        ]
    )
