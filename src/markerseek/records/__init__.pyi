from .curve_svg import DrawnCurve, Mark, as_html, tracks_svg
from .images import ImageSeries, read_camera_images, read_image_sequence, read_images
from .replay import ReplayLaser, ReplayReceiver, ReplayStage
from .result import Answer, ReplayedSearch, SampleRow, SearchResult
from .words import angle_text, answer_name, answer_reason, digits_of, interval_text, sigma_text, with_minus

__all__ = [
    "Answer",
    "DrawnCurve",
    "ImageSeries",
    "Mark",
    "ReplayLaser",
    "ReplayReceiver",
    "ReplayStage",
    "ReplayedSearch",
    "SampleRow",
    "SearchResult",
    "angle_text",
    "answer_name",
    "answer_reason",
    "as_html",
    "digits_of",
    "interval_text",
    "read_camera_images",
    "read_image_sequence",
    "read_images",
    "sigma_text",
    "tracks_svg",
    "with_minus",
]
