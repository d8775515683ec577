"""Messages to values of the core and back: pure functions, exact in both directions.

Readers (`..._from_message`) only read attributes, so they take messages of rclpy and of rosbags alike. Writers
import the message packages when they are called.
"""

from snnav_ros.convert.announcement import (
    Announcement,
    announcement_from_message,
    announcement_to_message,
)
from snnav_ros.convert.area import (
    area_from_message,
    area_to_message,
    rings_from_message,
    rings_to_message,
)
from snnav_ros.convert.depth_cloud import (
    image_from_message,
    image_to_message,
    is_no_cloud,
    no_cloud_to_message,
)
from snnav_ros.convert.frames import MAP_FRAME, check_frame, yaw_from_message, yaw_to_message
from snnav_ros.convert.grid import area_to_grid
from snnav_ros.convert.lost import lost_from_message, lost_to_message
from snnav_ros.convert.markers import obstacles_to_markers
from snnav_ros.convert.obstacles import OBSTACLE_FIELDS, obstacles_from_message, obstacles_to_message
from snnav_ros.convert.odometry import (
    flight_command_to_message,
    flight_to_message,
    flyer_state_from_message,
    goal_from_message,
    goal_in_space_from_message,
    odometry_to_message,
    state_from_message,
)
from snnav_ros.convert.path import path_from_message, path_to_message, stop_to_path
from snnav_ros.convert.plans import plans_from_message, plans_to_message
from snnav_ros.convert.returns import RETURN_FIELDS, returns_from_message, returns_to_message
from snnav_ros.convert.scan import is_nothing, nothing_to_message, scan_from_message, scan_to_message
from snnav_ros.convert.seen import SEEN_FIELDS, grid_points, seen_to_message
from snnav_ros.convert.spatial_area import (
    is_spatial_area,
    spatial_area_from_message,
    spatial_area_to_grid,
    spatial_area_to_message,
)
from snnav_ros.convert.stamps import (
    nanoseconds,
    nanoseconds_from_stamp,
    seconds,
    seconds_from_stamp,
    stamp_message,
)
from snnav_ros.convert.verdict import Verdict, verdict_from_message, verdict_to_message
from snnav_ros.convert.word import Word, word_from_message, word_to_message

__all__ = [
    "MAP_FRAME",
    "OBSTACLE_FIELDS",
    "RETURN_FIELDS",
    "SEEN_FIELDS",
    "Announcement",
    "Verdict",
    "Word",
    "announcement_from_message",
    "announcement_to_message",
    "area_from_message",
    "area_to_grid",
    "area_to_message",
    "check_frame",
    "flight_command_to_message",
    "flight_to_message",
    "flyer_state_from_message",
    "goal_from_message",
    "goal_in_space_from_message",
    "grid_points",
    "image_from_message",
    "image_to_message",
    "is_no_cloud",
    "is_nothing",
    "is_spatial_area",
    "lost_from_message",
    "lost_to_message",
    "nanoseconds",
    "nanoseconds_from_stamp",
    "no_cloud_to_message",
    "nothing_to_message",
    "obstacles_from_message",
    "obstacles_to_markers",
    "obstacles_to_message",
    "odometry_to_message",
    "path_from_message",
    "path_to_message",
    "plans_from_message",
    "plans_to_message",
    "returns_from_message",
    "returns_to_message",
    "rings_from_message",
    "rings_to_message",
    "scan_from_message",
    "scan_to_message",
    "seconds",
    "seconds_from_stamp",
    "seen_to_message",
    "spatial_area_from_message",
    "spatial_area_to_grid",
    "spatial_area_to_message",
    "stamp_message",
    "state_from_message",
    "stop_to_path",
    "verdict_from_message",
    "verdict_to_message",
    "word_from_message",
    "word_to_message",
    "yaw_from_message",
    "yaw_to_message",
]
