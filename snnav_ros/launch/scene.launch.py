"""All nodes of a scene as separate processes.

    ros2 launch snnav_ros scene.launch.py scene:=factory
    ros2 launch snnav_ros scene.launch.py scene:=/path/hall.yaml lockstep:=true rviz:=true
    ros2 launch snnav_ros scene.launch.py scene:=ten_robots planners:=2
    ros2 launch snnav_ros scene.launch.py scene:=hello_flight

Time is simulated: by the wall clock (`rate` times as fast), or in lockstep as fast as the machine can.
"""

from launch.actions import DeclareLaunchArgument, OpaqueFunction, Shutdown
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

from launch import LaunchContext, LaunchDescription
from snnav_ros.casting import FUSION, TRACKER, device_of, every_sample, is_unplanned, share_robots
from snnav_ros.nodes.operator import needs_operator
from snnav_sim.scene import find_scene, load_any_scene


def scene_nodes(context: LaunchContext) -> list[Node]:
    """Return the nodes of the scene that the arguments name."""
    path = find_scene(LaunchConfiguration("scene").perform(context))
    scene = load_any_scene(path)
    lockstep = LaunchConfiguration("lockstep").perform(context) == "true"
    namespace = LaunchConfiguration("namespace").perform(context)
    common = {"scene": str(path), "lockstep": lockstep}

    def node(executable: str, name: str, **parameters: object) -> Node:
        return Node(
            package="snnav_ros",
            executable=executable,
            name=name,
            namespace=namespace,
            parameters=[{**common, "use_sim_time": True, **parameters}],
            output="screen",
            on_exit=Shutdown(reason=f"{name} ended"),
        )

    rate = rate_of(LaunchConfiguration("rate").perform(context))
    shares = share_robots(scene, count_of(LaunchConfiguration("planners").perform(context)))
    several = {"planners": list(shares)} if len(shares) > 1 else {}
    planner = "global_planner_node" if scene.plans_globally else "planner_node"
    device = f"{device_of(scene)}_node"
    central = [
        *(node(device, sensor.id, sensor_id=sensor.id) for sensor in scene.sensors),
        node("fusion_node", FUSION),
        *([node("tracker_node", TRACKER)] if scene.plans_globally else []),
        *(
            node(planner, name, **several, **({"serves": robots} if several else {}))
            for name, robots in shares.items()
        ),
    ]
    return [
        *([] if is_unplanned(scene) else central),
        *(node("robot_node", robot.id, robot_id=robot.id, **several) for robot in scene.robots),
        *([node("operator_node", "operator_node")] if needs_operator(scene) else []),
        node(
            "clock_node",
            "clock_node",
            use_sim_time=False,
            rate=rate,
            **({"every_sample": list(every_sample(scene, list(shares)))} if several else {}),
        ),
    ]


def rate_of(text: str) -> float:
    """Return the number in the argument `rate`.

    Raises
    ------
    ValueError
        If there is none.
    """
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"rate:={text} is no number; write one such as rate:=2.0") from None


def count_of(text: str) -> int:
    """Return the whole number in the argument `planners`.

    Raises
    ------
    ValueError
        If there is none.
    """
    if not text.isdecimal():
        raise ValueError(f"planners:={text} is no number; write one such as planners:=2")
    return int(text)


def generate_launch_description() -> LaunchDescription:
    """Return the description for `ros2 launch`."""
    rviz = Node(
        package="rviz2",
        executable="rviz2",
        arguments=["-d", PathJoinSubstitution([FindPackageShare("snnav_ros"), "rviz", "snnav.rviz"])],
        parameters=[{"use_sim_time": True}],
        condition=IfCondition(LaunchConfiguration("rviz")),
    )
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "scene", default_value="hello", description="scene file, or name of a scene"
            ),
            DeclareLaunchArgument(
                "lockstep",
                default_value="false",
                choices=["true", "false"],
                description="as fast as the machine can",
            ),
            DeclareLaunchArgument("rate", default_value="1.0", description="simulated seconds in a second"),
            DeclareLaunchArgument(
                "planners", default_value="1", description="so many planner nodes share the robots"
            ),
            DeclareLaunchArgument("namespace", default_value="", description="before all names"),
            DeclareLaunchArgument("rviz", default_value="false", description="open RViz"),
            rviz,  # before the nodes: where there is no RViz, none of them is started
            OpaqueFunction(function=scene_nodes),
        ]
    )
