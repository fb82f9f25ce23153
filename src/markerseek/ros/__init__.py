"""ROS 2 for drivers and bridges: a node over rclpy, the messages of a rig, and the names of its topics.

The nodes that users start are in `markerseek.bridges.ros2`.

rclpy is imported by `markerseek.ros.node` alone, when a node is made; `messages` works without it, for exports.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
