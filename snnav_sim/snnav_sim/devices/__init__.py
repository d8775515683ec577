"""Simulated devices: planar range finders and robot bases."""

from snnav_sim.devices.factory import RangeFinder, make_device

__all__ = ["RangeFinder", "make_device"]
