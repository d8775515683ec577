"""The subcommands of ``snnav`` that work on recordings: import-carmen, network, evaluate-logs, ..."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable, Sequence
from dataclasses import fields
from importlib import import_module
from pathlib import Path

from snnav_ros.argument_types import labelled, number, whole
from snnav_ros.bag.settings import (
    POSE_TOPIC,
    SCAN_TOPIC,
    EvaluationSettings,
    FreeSpaceSettings,
    NetworkSettings,
    ReplaySettings,
    TracksSettings,
)

__all__ = ["add_parser"]


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the subcommands; each sets ``func`` to a function of the parsed arguments that returns the exit status."""
    _add_import(subparsers)
    _add_network(subparsers)
    _add_evaluation(subparsers)
    _add_replay(subparsers)
    _add_tracks(subparsers)
    _add_windows(subparsers)
    _add_depth_import(subparsers)
    _add_free_space(subparsers)


def _deferred(module: str, function: str = "run") -> Callable[[argparse.Namespace], int]:
    """Return a function that imports what the subcommand needs only when it is run (numba takes a second)."""

    def call(arguments: argparse.Namespace) -> int:
        status: int = getattr(import_module(f"snnav_ros.bag.{module}"), function)(arguments)
        return status

    return call


def _add_sensors_file(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--sensors",
        metavar="FILE",
        type=Path,
        required=True,
        default=argparse.SUPPRESS,
        help="topics and poses, YAML or JSON",
    )


def _add_part(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--start", type=number(0.0), default=0.0, help="from the start of the recording [s]")
    parser.add_argument("--duration", type=number(0.0, above=True), help="so much of it [s] (default: all)")


def _add_settings(parser: argparse.ArgumentParser, kind: type, rows: Sequence[tuple[str, str, str]]) -> None:
    """Add positive numbers, (option, name in the settings, help) each; the defaults are those of the settings."""
    defaults = {field.name: field.default for field in fields(kind)}
    for flag, name, text in rows:
        parser.add_argument(flag, dest=name, type=number(0.0, above=True), default=defaults[name], help=text)


def _add_import(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    parser = subparsers.add_parser(
        "import-carmen",
        help="turn a CARMEN log into a bag of scans and poses",
        description="Turn a CARMEN log (FLASER or ROBOTLASER1 lines, plain or gzip) into a rosbag2 bag: "
        f"{SCAN_TOPIC} (LaserScan) and {POSE_TOPIC} (PoseStamped, the laser in the map) with equal stamps.",
    )
    parser.add_argument("log", metavar="LOG", type=Path, help="CARMEN log, .log or .log.gz")
    parser.add_argument("bag", metavar="BAG", type=Path, help="bag to make; must not exist")
    parser.set_defaults(func=_deferred("run_import"))


def _add_network(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    defaults = {field.name: field.default for field in fields(NetworkSettings)}
    parser = subparsers.add_parser(
        "network",
        help="turn posed scans of a bag into a scene of fixed sensor nodes",
        description="Take posed scans of a bag, spread evenly over it, as the fixed nodes of a sensor network "
        "and write a scene with robots whose starts and targets lie in the largest connected free part.",
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    parser.add_argument("bag", metavar="BAG", type=Path, help="rosbag2 directory, .mcap, .db3 or ROS 1 .bag")
    count = parser.add_mutually_exclusive_group(required=True)
    count.add_argument(
        "--nodes", metavar="N", type=whole(1), help="number of nodes", default=argparse.SUPPRESS
    )
    count.add_argument(
        "--every", metavar="K", type=whole(1), help="every K-th scan", default=argparse.SUPPRESS
    )
    parser.add_argument("--out", metavar="SCENE.yaml", type=Path, required=True, help="scene file to write")
    parser.add_argument("--topic", default=SCAN_TOPIC, help="the scans (LaserScan)")
    parser.add_argument("--pose-topic", default=POSE_TOPIC, help="the scanner's pose in the map")
    parser.add_argument("--robots", metavar="R", type=whole(0), default=1, help="number of robots")
    parser.add_argument(
        "--seed", type=whole(0), default=defaults["seed"], help="of starts, targets and the run"
    )
    rows = (
        ("--range-cut", "range_cut", "longer readings are free only up to this range [m]"),
        ("--speed", "speed", "of the robots [m/s]"),
        ("--max-turn-rate", "max_turn_rate", "of the robots [rad/s]"),
        ("--radius", "radius", "of the robots [m]"),
        ("--safety-margin", "safety_margin", "from a robot's centre to any obstacle [m]"),
        ("--sampling-interval", "sampling_interval", "between two decisions [s]"),
    )
    _add_settings(parser, NetworkSettings, rows)
    parser.set_defaults(func=_deferred("run_network"))


def _add_evaluation(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    parser = subparsers.add_parser(
        "evaluate-logs",
        help="drive ten routes through each of some real buildings and check every margin",
        description="For each corrected CARMEN log: import it, make a sensor network of it, drive seeded routes in "
        "the largest connected free part in a closed loop without ROS, and check every drive against the fused area "
        "and every measured return. Exit status 1 when fewer than 95 % of the targets are reached or a margin is "
        "violated.",
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    defaults = EvaluationSettings()
    parser.add_argument("logs", metavar="LOG", type=Path, nargs="+", help="CARMEN log, .log or .log.gz")
    parser.add_argument(
        "--nodes", metavar="N", type=whole(1), default=defaults.nodes, help="nodes a building"
    )
    parser.add_argument(
        "--pairs", metavar="P", type=whole(1), default=defaults.pairs, help="routes a building"
    )
    parser.add_argument("--seed", type=whole(0), default=defaults.network.seed, help="of starts and targets")
    parser.add_argument("--out", metavar="DIR", type=Path, default=Path("runs/evaluate-logs"), help="results")
    parser.add_argument("--jobs", metavar="J", type=whole(1), default=2, help="processes")
    parser.set_defaults(func=_deferred("run_evaluation"))


def _add_replay(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    defaults = {field.name: field.default for field in fields(ReplaySettings)}
    parser = subparsers.add_parser(
        "replay",
        help="drive simulated robots among recorded people",
        description="Feed the scans of a recording at their own time to fusion and planner while simulated robots "
        "drive among the people that were recorded, and measure how near these came. Exit status 1 when a robot drove "
        "into a measured return.",
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    parser._negative_number_matcher = re.compile(r"-[\d.]")  # type: ignore[attr-defined] # "-1,2" is no option
    suppress = argparse.SUPPRESS
    parser.add_argument("bag", metavar="BAG", type=Path, help="ROS 1 .bag, rosbag2 directory, .mcap or .db3")
    _add_sensors_file(parser)
    for option, form, text in (
        ("--robot", "X,Y,HEADING_DEG", "where a robot starts [m, degrees]; repeat for more"),
        ("--goal", "X,Y", "where it shall go [m], in the order of the robots or by id"),
    ):
        parser.add_argument(
            option,
            metavar=f"[ID=]{form}",
            type=labelled(form),
            action="append",
            required=True,
            default=suppress,
            help=text,
        )
    then = parser.add_mutually_exclusive_group()
    then.add_argument(
        "--to-and-fro", action="store_true", help="turn back at the goal, until the recording ends"
    )
    then.add_argument("--stay", action="store_true", help="stand at the goal until the recording ends")
    rows = (
        ("--radius", "radius", "of the robots [m]"),
        ("--speed", "speed", "of the robots [m/s]"),
        ("--turn-rate", "max_turn_rate", "of the robots [rad/s]"),
        ("--boundary-speed", "boundary_speed", "nobody is faster; robots must be [m/s]"),
        ("--margin", "safety_margin", "from a robot's centre to what is not known to be free [m]"),
        ("--interval", "sampling_interval", "between two decisions [s]"),
    )
    _add_settings(parser, ReplaySettings, rows)
    parser.add_argument(
        "--window", dest="time_window", type=whole(1), default=defaults["time_window"], help="in intervals"
    )
    _add_part(parser)
    parser.add_argument("--out", metavar="DIR", type=Path, help="run directory (default: runs/BAG-DATE-TIME)")
    parser.add_argument("--no-figures", action="store_true", help="draw nothing")
    parser.set_defaults(func=_deferred("run_replay"), control_period=defaults["control_period"])


def _add_tracks(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    parser = subparsers.add_parser(
        "tracks",
        help="track whoever moves in recorded scans",
        description="Feed the scans of a recording at their own time to the fusion and follow the bodies that move: "
        "where they are, how fast they are, and how sure that is.",
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    parser.add_argument("bag", metavar="BAG", type=Path, help="ROS 1 .bag, rosbag2 directory, .mcap or .db3")
    _add_sensors_file(parser)
    rows = (
        ("--interval", "sampling_interval", "between two measurements [s]"),
        ("--window", "window", "a velocity is fitted to so long [s]"),
        ("--top-speed", "top_speed", "nobody is faster [m/s]"),
        ("--range-noise", "range_noise", "standard deviation of a range [m]"),
        ("--free-depth", "free_depth", "deeper in what was free before, a return is a sign of motion [m]"),
    )
    _add_settings(parser, TracksSettings, rows)
    _add_part(parser)
    parser.add_argument(
        "--out", metavar="DIR", type=Path, help="directory of results (default: runs/BAG-tracks)"
    )
    parser.add_argument("--no-figures", action="store_true", help="draw nothing")
    parser.set_defaults(func=_deferred("run_tracks"))


def _add_windows(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    parser = subparsers.add_parser(
        "windows",
        help="check in a recording that a robot never drove without a certificate",
        description="Compare every motion in a robot's odometry with the windows of the certificates that had been "
        "heard by then, and draw its speed above what was left of its window. Needs ROBOT/odom and ROBOT/certificate; "
        "uses /clock and events (std_msgs/String) where there are any. Exit status 1 when the robot drove outside "
        "its windows.",
    )
    parser.add_argument("bag", metavar="BAG", type=Path, help="rosbag2 directory, .mcap, .db3 or ROS 1 .bag")
    parser.add_argument("--robot", metavar="ID", required=True, help="its name")
    _add_part(parser)
    parser.add_argument("--out", metavar="FILE.png", type=Path, help="draw (default: nothing is drawn)")
    parser.set_defaults(func=_deferred("run_windows"))


def _add_depth_import(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    parser = subparsers.add_parser(
        "import-depth",
        help="turn depth images or PCD files of fixed cameras into a bag of clouds",
        description="Turn 16-bit depth images or organized PCD files of fixed cameras into a rosbag2 bag: for every "
        "camera sensors/ID/points (PointCloud2) and sensors/ID/camera_info, and their poses on tf_static.",
    )
    parser.add_argument(
        "cameras",
        metavar="CAMERAS.yaml",
        type=Path,
        help="files, models and poses of the cameras, YAML or JSON",
    )
    parser.add_argument("bag", metavar="BAG", type=Path, help="bag to make; must not exist")
    parser.set_defaults(func=_deferred("run_import", "run_depth"))


def _add_free_space(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    defaults = {field.name: field.default for field in fields(FreeSpaceSettings)}
    parser = subparsers.add_parser(
        "free-space",
        help="find the free space of recorded depth cameras, test it by each other's hits, fly through it",
        description="Carve free space out of the images of fixed depth cameras, count how many hits of every other "
        "camera lie in what one camera alone calls free, and let a simulated robot fly through what all show. Exit "
        "status 1 when 1 % or more of the hits of a camera lie in free space, or the robot does not reach its "
        "target or its margin is violated.",
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    parser._negative_number_matcher = re.compile(r"-[\d.]")  # type: ignore[attr-defined] # "-1,2" is no option
    parser.add_argument("bag", metavar="BAG", type=Path, help="rosbag2 directory, .mcap, .db3 or ROS 1 .bag")
    for option, text in (
        ("--robot", "where the robot starts [m] (default: chosen, far from its goal)"),
        ("--goal", "where it shall go [m] (default: chosen where there is most room)"),
    ):
        parser.add_argument(option, metavar="X,Y,Z", type=_point, default=argparse.SUPPRESS, help=text)
    for flag, name, text in (
        ("--range-accuracy", "range_accuracy", "ranges are wrong by no more than this [m]"),
        ("--range-growth", "range_growth", "and this times the range squared [1/m]"),
        ("--pose-accuracy", "pose_accuracy", "what a camera sees may be shifted by so much in the map [m]"),
    ):
        parser.add_argument(flag, type=number(0.0), default=defaults[name], help=text)
    rows = (
        ("--range-max", "range_max", "longer readings are no measurement [m]"),
        ("--spacing", "grid_spacing", "edge of the cells in which the free region is known [m]"),
        ("--radius", "radius", "of the robot [m]"),
        ("--speed", "speed", "of the robot [m/s]"),
        ("--turn-rate", "max_turn_rate", "of the robot [rad/s]"),
        ("--margin", "safety_margin", "from the robot's centre to what is not known to be free [m]"),
    )
    _add_settings(parser, FreeSpaceSettings, rows)
    parser.add_argument("--seed", type=whole(0), default=defaults["seed"], help="of the roadmaps")
    parser.add_argument(
        "--out", metavar="DIR", type=Path, help="directory of results (default: runs/BAG-free-space)"
    )
    parser.add_argument("--no-figures", action="store_true", help="draw nothing")
    parser.set_defaults(func=_deferred("run_free_space"))


def _point(text: str) -> tuple[float, ...]:
    name, values = labelled("X,Y,Z")(text)
    if name:
        raise argparse.ArgumentTypeError(f"{text!r} is not X,Y,Z with finite numbers")
    return values
