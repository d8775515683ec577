"""Pure algorithms of the central sensor-network navigator.

Values in, values out: no ROS, no drawing, no file formats. SI units and radians everywhere; planar
coordinates are in the ``map`` frame unless a name says otherwise.
"""

__version__ = "0.1.0"
