from . import messages, topics
from .node import RosNode, Security, local_transport
from .stamps import MOST_AGE_S, MOST_AHEAD_S, StampedCommands, joint_angle_deg

__all__ = [
    "MOST_AGE_S",
    "MOST_AHEAD_S",
    "RosNode",
    "Security",
    "StampedCommands",
    "joint_angle_deg",
    "local_transport",
    "messages",
    "topics",
]
