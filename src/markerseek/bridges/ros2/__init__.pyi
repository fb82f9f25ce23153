from .acquisition_node import AcquisitionNode
from .follow_node import FollowNode
from .sample_topics import RegistrationTopics
from .search_node import SearchNode
from .serving import MessagePump, Served, Serving, StepEnded, serve_nodes
from .stage_node import StageNode

__all__ = [
    "AcquisitionNode",
    "FollowNode",
    "MessagePump",
    "RegistrationTopics",
    "SearchNode",
    "Served",
    "Serving",
    "StageNode",
    "StepEnded",
    "serve_nodes",
]
