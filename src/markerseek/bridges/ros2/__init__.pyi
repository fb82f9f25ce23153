from .acquisition_node import AcquisitionNode
from .player import play
from .sample_topics import publish_registration
from .search_node import SearchNode
from .serving import Beat, Interrupted, Served, serve
from .stage_node import PlainTopics, StageNode

__all__ = [
    "AcquisitionNode",
    "Beat",
    "Interrupted",
    "PlainTopics",
    "SearchNode",
    "Served",
    "StageNode",
    "play",
    "publish_registration",
    "serve",
]
