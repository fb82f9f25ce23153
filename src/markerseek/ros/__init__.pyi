from . import messages, topics
from .messages import MAX_AGE_S, MAX_AHEAD_S, StampedCommands, degrees, joint_angle_deg
from .node import Network, RosNode, require_middleware, set_up_discovery

__all__ = [
    "MAX_AGE_S",
    "MAX_AHEAD_S",
    "Network",
    "RosNode",
    "StampedCommands",
    "degrees",
    "joint_angle_deg",
    "messages",
    "require_middleware",
    "set_up_discovery",
    "topics",
]
