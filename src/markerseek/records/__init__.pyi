from .images import ImageSeries, read_camera_images, read_image_sequence, read_images
from .replay import ReplayLaser, ReplayReceiver, ReplayStage
from .result import Answer, ReplayedSearch, SampleRow, SearchResult, answer_name, answer_reason

__all__ = [
    "Answer",
    "ImageSeries",
    "ReplayLaser",
    "ReplayReceiver",
    "ReplayStage",
    "ReplayedSearch",
    "SampleRow",
    "SearchResult",
    "answer_name",
    "answer_reason",
    "read_camera_images",
    "read_image_sequence",
    "read_images",
]
