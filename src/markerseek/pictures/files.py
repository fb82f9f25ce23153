"""Saves figures as PNG, SVG, or PNG embedded in a page."""

from __future__ import annotations

import base64
import io
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

from markerseek.core import ConfigError
from markerseek.files import replace_file
from markerseek.pictures.page import templates
from markerseek.pictures.style import new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def require_room_for_pictures(folder: Path) -> None:
    """Make the folder and test that pictures can be written to it; called before anything is measured.

    Raises
    ------
    ConfigError
        If the folder cannot be made or written.
    MissingExtraError
        If Matplotlib or Jinja2 is not installed.
    """
    new_figure(width_in=1.0, height_in=1.0)
    templates()
    if folder.is_file():
        raise ConfigError(f"{folder}: no picture can be written there: it is a file, not a folder; name another --out")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        # Access rights are unreliable on network disks and in containers: only a write shows it.
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as problem:
        raise ConfigError(
            f"{folder}: no picture can be written there: {problem.strerror}; name another --out"
        ) from problem


def save_png(figure: Figure, path: Path) -> None:
    """Write a figure as PNG; its folder is made if missing.

    Raises
    ------
    ConfigError
        If the file cannot be written.
    RecordError
        If its name is that of a symbolic link, a pipe or a device.
    """
    _save(figure, path, format="png", dpi=120)


def save_svg(figure: Figure, path: Path) -> None:
    """Write a figure as SVG; the folder is made if need be. The same figure gives the same file.

    Raises
    ------
    ConfigError
        If the file cannot be written.
    RecordError
        If its name is that of a symbolic link, a pipe or a device.
    """
    import matplotlib as mpl

    # Without a salt and a date of our own, Matplotlib writes random identifiers and the time.
    with mpl.rc_context({"svg.hashsalt": "markerseek"}):
        _save(figure, path, format="svg", metadata={"Date": None})


def _save(figure: Figure, path: Path, **how: Any) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with replace_file(path) as part:
            figure.savefig(part, **how)
    except OSError as problem:
        raise ConfigError(f"{path}: the picture cannot be written: {problem.strerror}; name another --out") from problem


def png_data_uri(figure: Figure) -> str:
    """The figure as a PNG ``data:`` URI, for a page that loads no other file."""
    buffer = io.BytesIO()
    figure.savefig(buffer, dpi=120, format="png")
    return "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode("ascii")
