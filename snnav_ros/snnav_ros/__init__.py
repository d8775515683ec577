"""Thin ROS 2 nodes around snnav_core and snnav_sim: convert a message, call the core, publish."""

__version__ = "0.1.0"
