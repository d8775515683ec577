"""Simulated devices: planar range finders and robot bases."""

from snnav_sim.devices.factory import RangeFinder, make_device
from snnav_sim.devices.feed import SensorFeed

__all__ = ["RangeFinder", "SensorFeed", "make_device"]
