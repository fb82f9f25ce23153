from . import messages, topics
from .node import Network, RosNode, local_transport, require_keys
from .stamps import MAX_AGE_S, MAX_AHEAD_S, StampedCommands, degrees, joint_angle_deg

__all__ = [
    "MAX_AGE_S",
    "MAX_AHEAD_S",
    "Network",
    "RosNode",
    "StampedCommands",
    "degrees",
    "joint_angle_deg",
    "local_transport",
    "messages",
    "require_keys",
    "topics",
]
