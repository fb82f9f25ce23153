"""What all pictures share: colours, figures without a display, and files to keep them in.

Matplotlib is an extra and imported here, when the first picture is drawn.
"""

from __future__ import annotations

import base64
import io
import tempfile
import textwrap
from pathlib import Path
from typing import TYPE_CHECKING

from markerseek.core import ConfigError, MissingExtraError
from markerseek.files import replaced

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SIGNAL, ACCENT, TRUTH, QUIET = "#1f5fa8", "#c8501e", "#2a7f3f", "#8a8f98"
"""Colours of what was measured, what was concluded, what is true, and all the rest; apart for the colour-blind too."""


def new_figure(*, width_in: float, height_in: float) -> Figure:
    """Empty figure that needs no display.

    Parameters
    ----------
    width_in, height_in
        Size in inches.

    Raises
    ------
    MissingExtraError
        If Matplotlib is not installed.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError as problem:
        raise MissingExtraError(package="matplotlib", extra="plot", purpose="a picture") from problem
    return Figure(figsize=(width_in, height_in), layout="constrained")


def put_heading(figure: Figure, text: str, *, fontsize: float = 12.0) -> None:
    """Write a heading over the whole figure, in as many lines as it takes; a file's name is no mathematics."""
    lines = _lines(text, width_in=figure.get_figwidth(), fontsize=fontsize)
    figure.suptitle(lines, fontsize=fontsize, x=0.01, ha="left", parse_math=False)


def put_title(axes: Axes, text: str, *, width_in: float, fontsize: float = 9.0) -> None:
    """Write what one panel shows above it, in as many lines as it takes in such a width in inches."""
    axes.set_title(_lines(text, width_in=width_in, fontsize=fontsize), fontsize=fontsize, parse_math=False)


def _lines(text: str, *, width_in: float, fontsize: float) -> str:
    # Letters of the default font are 0.55 of its size wide on average, and paths hold wider ones: 0.6.
    return textwrap.fill(text, int(width_in * 72 / (0.6 * fontsize)), break_on_hyphens=False)


def require_room_for_pictures(folder: Path) -> None:
    """Make the folder and refuse it where no picture could be written, before anything is measured for one.

    Raises
    ------
    ConfigError
        If the folder cannot be made or written.
    MissingExtraError
        If Matplotlib is not installed.
    """
    new_figure(width_in=1.0, height_in=1.0)
    if folder.is_file():
        raise ConfigError(f"{folder}: no picture can be written there: it is a file and no folder; name another --out")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as problem:
        raise ConfigError(
            f"{folder}: no picture can be written there: {problem.strerror}; name another --out"
        ) from problem


def save_png(figure: Figure, path: Path) -> None:
    """Write a figure as PNG, making the folder if need be.

    Raises
    ------
    ConfigError
        If the file cannot be written.
    RecordError
        If its name is that of a symbolic link, a pipe or a device.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with replaced(path) as part:
            figure.savefig(part, dpi=120, format="png")
    except OSError as problem:
        raise ConfigError(f"{path}: the picture cannot be written: {problem.strerror}; name another --out") from problem


def save_svg(figure: Figure, path: Path) -> None:
    """Write a figure as SVG, making the folder if need be; the same figure gives the same file.

    Raises
    ------
    ConfigError
        If the file cannot be written.
    RecordError
        If its name is that of a symbolic link, a pipe or a device.
    """
    import matplotlib as mpl

    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with replaced(path) as part, mpl.rc_context({"svg.hashsalt": "markerseek"}):
            figure.savefig(part, format="svg", metadata={"Date": None})
    except OSError as problem:
        raise ConfigError(f"{path}: the picture cannot be written: {problem.strerror}; name another --out") from problem


def png_data_uri(figure: Figure) -> str:
    """The figure as a PNG inside a ``data:`` address, for a page that stands alone."""
    buffer = io.BytesIO()
    figure.savefig(buffer, dpi=120, format="png")
    return "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode("ascii")
