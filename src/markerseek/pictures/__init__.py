"""Figures and HTML pages of searches, banks and frames. Matplotlib and Jinja2 are imported when they are needed."""

from markerseek.pictures.files import (
    PICTURE_SUFFIXES,
    new_picture,
    png_data_uri,
    require_room_for_pictures,
    save_figure,
    write_page,
)
from markerseek.pictures.images import bank_figure, frame_figure
from markerseek.pictures.registration_picture import registration_figure
from markerseek.pictures.search_picture import ComparedSearch, Curve, comparison_figure, pictured_sample, search_figure
from markerseek.pictures.style import ERROR_BARS, new_figure, panel_grid, shared_legend
from markerseek.pictures.tip_picture import tip_figure

__all__ = [
    "ERROR_BARS",
    "PICTURE_SUFFIXES",
    "ComparedSearch",
    "Curve",
    "bank_figure",
    "comparison_figure",
    "frame_figure",
    "new_figure",
    "new_picture",
    "panel_grid",
    "pictured_sample",
    "png_data_uri",
    "registration_figure",
    "require_room_for_pictures",
    "save_figure",
    "search_figure",
    "shared_legend",
    "tip_figure",
    "write_page",
]
