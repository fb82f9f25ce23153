"""Recorded data: the result of a search, the devices that replay a bank, and series of B-mode images.

Banks, journals and exports are the packages below this one.
"""

from markerseek.records.images import IMAGE_SUFFIXES, ImageSeries, read_images
from markerseek.records.replay import ReplayLaser, ReplayReceiver, ReplayStage
from markerseek.records.result import Recorder, SearchResult, answer_name

__all__ = [
    "IMAGE_SUFFIXES",
    "ImageSeries",
    "Recorder",
    "ReplayLaser",
    "ReplayReceiver",
    "ReplayStage",
    "SearchResult",
    "answer_name",
    "read_images",
]
