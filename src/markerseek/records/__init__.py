"""Recorded data: the result of a search, and the devices that replay a bank.

Banks, journals and exports are the packages below this one.
"""

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
