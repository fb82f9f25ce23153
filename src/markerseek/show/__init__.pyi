from .curve import NAME_WITHOUT_CLAIM, DrawnAngle, DrawnCurve, DrawnInterval, Mark, Threshold, drawn_curve, stand_in
from .curve_figure import comparison_figure, curve_figure, pictured_sample
from .curve_svg import as_html, curve_svg, errors_svg
from .document import Document, DocumentFigure, Rows, write_document_page, write_document_pdf
from .files import (
    PICTURE_SUFFIXES,
    new_picture,
    png_data_uri,
    require_room_for_pictures,
    save_figure,
    write_page,
)
from .flat import flat_answer, flat_line, flat_result
from .follow_picture import FollowedMoment, follow_figure
from .frame_picture import frame_figure, peak_figure
from .grey import RANGE_DB, grey_levels
from .log import STOPPED, event_line
from .registration_picture import registration_figure
from .result import SearchResult
from .session_picture import CameraView, errors_figure, markers_figure
from .style import ERROR_BARS, new_figure, panel_grid, shared_legend
from .time_svg import SIGMAS, DrawnMotion, follow_svg, motion_svg
from .tip_picture import tip_figure
from .verdict import Verdict, VerdictKind, numbers_of, verdict_of
from .words import (
    NO_CLAIM,
    WRONG_SOURCE,
    AnswerName,
    acquisitions_text,
    angle_text,
    answer_line,
    answer_name,
    answer_reason,
    digits_of,
    estimate_line,
    interval_text,
    others_rows,
    outliers_rows,
    sigma_text,
    time_text,
    with_minus,
)

__all__ = [
    "ERROR_BARS",
    "NAME_WITHOUT_CLAIM",
    "NO_CLAIM",
    "PICTURE_SUFFIXES",
    "RANGE_DB",
    "SIGMAS",
    "STOPPED",
    "WRONG_SOURCE",
    "AnswerName",
    "CameraView",
    "Document",
    "DocumentFigure",
    "DrawnAngle",
    "DrawnCurve",
    "DrawnInterval",
    "DrawnMotion",
    "FollowedMoment",
    "Mark",
    "Rows",
    "SearchResult",
    "Threshold",
    "Verdict",
    "VerdictKind",
    "acquisitions_text",
    "angle_text",
    "answer_line",
    "answer_name",
    "answer_reason",
    "as_html",
    "comparison_figure",
    "curve_figure",
    "curve_svg",
    "digits_of",
    "drawn_curve",
    "errors_figure",
    "errors_svg",
    "estimate_line",
    "event_line",
    "flat_answer",
    "flat_line",
    "flat_result",
    "follow_figure",
    "follow_svg",
    "frame_figure",
    "grey_levels",
    "interval_text",
    "markers_figure",
    "motion_svg",
    "new_figure",
    "new_picture",
    "numbers_of",
    "others_rows",
    "outliers_rows",
    "panel_grid",
    "peak_figure",
    "pictured_sample",
    "png_data_uri",
    "registration_figure",
    "require_room_for_pictures",
    "save_figure",
    "shared_legend",
    "sigma_text",
    "stand_in",
    "time_text",
    "tip_figure",
    "verdict_of",
    "with_minus",
    "write_document_page",
    "write_document_pdf",
    "write_page",
]
