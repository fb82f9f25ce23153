"""ROS 2 nodes: a search, a stage, an acquisition with its laser, and a simulated rig of both."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
