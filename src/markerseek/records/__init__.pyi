from .images import IMAGE_SUFFIXES, ImageSeries, read_camera_images, read_images
from .replay import ReplayLaser, ReplayReceiver, ReplayStage
from .result import Recorder, SampleRow, SearchResult, answer_name

__all__ = [
    "IMAGE_SUFFIXES",
    "ImageSeries",
    "Recorder",
    "ReplayLaser",
    "ReplayReceiver",
    "ReplayStage",
    "SampleRow",
    "SearchResult",
    "answer_name",
    "read_camera_images",
    "read_images",
]
