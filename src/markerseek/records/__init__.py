"""What was seen, on disk: frame files, banks and their replay, and the result of a search."""

from markerseek.records.replay import ReplayLaser, ReplayReceiver, ReplayStage
from markerseek.records.result import Recorder, SearchResult, answer_name

__all__ = [
    "Recorder",
    "ReplayLaser",
    "ReplayReceiver",
    "ReplayStage",
    "SearchResult",
    "answer_name",
]
