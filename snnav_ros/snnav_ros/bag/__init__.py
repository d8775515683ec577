"""Bags and real logs: read and write rosbag2, import CARMEN logs, make sensor networks of them, replay runs.

Nothing here needs rclpy: bags go through ``rosbags``, with the message definitions of ROS 2 Jazzy.
"""
