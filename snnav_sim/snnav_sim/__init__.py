"""A world to test the navigator in: scenes, simulated devices, closed loop without ROS, reports."""

__version__ = "0.1.0"
