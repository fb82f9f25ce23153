from .images import ImageSeries, read_camera_images, read_images
from .replay import ReplayLaser, ReplayReceiver, ReplayStage
from .result import Recorder, SampleRow, SearchResult, answer_name, answer_reason

__all__ = [
    "ImageSeries",
    "Recorder",
    "ReplayLaser",
    "ReplayReceiver",
    "ReplayStage",
    "SampleRow",
    "SearchResult",
    "answer_name",
    "answer_reason",
    "read_camera_images",
    "read_images",
]
