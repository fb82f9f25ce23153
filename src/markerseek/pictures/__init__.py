"""Pictures of searches and frames, as files. Matplotlib is imported when the first one is drawn."""

from markerseek.pictures.canvas import png_data_uri, save_png
from markerseek.pictures.frame_picture import frame_figure
from markerseek.pictures.page import write_page
from markerseek.pictures.search_picture import PaImage, search_figure

__all__ = ["PaImage", "frame_figure", "png_data_uri", "save_png", "search_figure", "write_page"]
