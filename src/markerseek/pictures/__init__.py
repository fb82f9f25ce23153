"""Pictures of searches and frames, as files. Matplotlib is imported when the first one is drawn."""

from markerseek.pictures.bank_picture import bank_figure
from markerseek.pictures.canvas import png_data_uri, require_room_for_pictures, save_png, save_svg
from markerseek.pictures.frame_picture import frame_figure
from markerseek.pictures.heat_map import HeatMap, heat_maps_figure
from markerseek.pictures.machine_picture import b_mode_figure, rf_figure
from markerseek.pictures.page import write_page
from markerseek.pictures.panels import Line, Panel, panels_figure
from markerseek.pictures.search_picture import search_figure

__all__ = [
    "HeatMap",
    "Line",
    "Panel",
    "b_mode_figure",
    "bank_figure",
    "frame_figure",
    "heat_maps_figure",
    "panels_figure",
    "png_data_uri",
    "require_room_for_pictures",
    "rf_figure",
    "save_png",
    "save_svg",
    "search_figure",
    "write_page",
]
