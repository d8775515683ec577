"""Campaigns: many random scenes, run in the closed loop without ROS and judged against ground truth."""
