"""Fusion, planner and a tracker per robot for real scanners and robots.

    ros2 launch snnav_ros network.launch.py config:=site.yaml robots:=cart_1,cart_2
    ros2 launch snnav_ros network.launch.py config:=site.yaml remap:=/front/scan=sensors/north/scan

The configuration holds the parameters of all nodes (`config/network.yaml` is a commented example). The drivers of
scanners and bases are started elsewhere.
"""

from launch.actions import DeclareLaunchArgument, OpaqueFunction, Shutdown
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

from launch import LaunchContext, LaunchDescription


def network_nodes(context: LaunchContext) -> list[Node]:
    """Return the nodes that the arguments ask for."""
    config = LaunchConfiguration("config").perform(context)
    robots = [name for name in LaunchConfiguration("robots").perform(context).split(",") if name]
    # "driver topic=our topic": the node hears the driver's topic where it would hear its own
    pairs = [pair.split("=", 1) for pair in LaunchConfiguration("remap").perform(context).split(",") if pair]
    remappings = [(ours, drivers) for drivers, ours in pairs]

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

    return [
        node("fusion_node", "fusion_node"),
        node("planner_node", "planner_node"),
        *(node("robot_node", robot) for robot in robots),
    ]


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
            DeclareLaunchArgument("remap", default_value="", description="driver topic=our topic, by commas"),
            DeclareLaunchArgument("namespace", default_value="", description="before all names"),
            DeclareLaunchArgument("rviz", default_value="false", description="open RViz"),
            OpaqueFunction(function=network_nodes),
            rviz,
        ]
    )
