from .curve_svg import DrawnCurve, Mark, as_html, errors_svg
from .images import ImageSeries, read_image_sequence, read_images
from .replay import ReplayLaser, ReplayReceiver, ReplayStage
from .result import NAME_WITHOUT_CLAIM, Answer, SampleRow, SearchResult
from .words import (
    NO_CLAIM,
    acquisitions_text,
    angle_text,
    answer_line,
    answer_name,
    answer_reason,
    digits_of,
    interval_text,
    others_rows,
    outliers_rows,
    sigma_text,
    time_text,
    with_minus,
)

__all__ = [
    "NAME_WITHOUT_CLAIM",
    "NO_CLAIM",
    "Answer",
    "DrawnCurve",
    "ImageSeries",
    "Mark",
    "ReplayLaser",
    "ReplayReceiver",
    "ReplayStage",
    "SampleRow",
    "SearchResult",
    "acquisitions_text",
    "angle_text",
    "answer_line",
    "answer_name",
    "answer_reason",
    "as_html",
    "digits_of",
    "errors_svg",
    "interval_text",
    "others_rows",
    "outliers_rows",
    "read_image_sequence",
    "read_images",
    "sigma_text",
    "time_text",
    "with_minus",
]
