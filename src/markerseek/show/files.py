"""Writes figures as PNG, SVG or PDF, or PNG embedded in a page, and self-contained HTML pages from Jinja2 templates."""

from __future__ import annotations

import base64
import io
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from markerseek.core import ConfigError, needs_package
from markerseek.files import replace_file
from markerseek.show.style import new_figure

if TYPE_CHECKING:
    from jinja2 import Environment
    from matplotlib.figure import Figure


def require_room_for_pictures(folder: Path) -> None:
    """Make the folder and test that pictures can be written to it; called before anything is measured."""
    new_figure(width_in=1.0, height_in=1.0)
    _templates()
    if folder.is_file():
        raise ConfigError(f"{folder}: no picture can be written there: it is a file; choose another folder")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        # Access rights are unreliable on network disks and in containers: only a write shows it.
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as problem:
        raise ConfigError(
            f"{folder}: no picture can be written there: {problem.strerror}; choose another folder"
        ) from problem


@contextmanager
def new_picture(path: Path, *, what: str) -> Iterator[Path]:
    """Yield a temporary path beside `path`, renamed when the block succeeds; the folder is made if missing.

    ``path``: file to write; an existing one is replaced. ``what``: what it holds, for the message: "picture".
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with replace_file(path) as part:
            yield part
    except OSError as problem:
        raise ConfigError(
            f"{path}: the {what} cannot be written: {problem.strerror}; choose another folder"
        ) from problem


PICTURE_SUFFIXES = (".png", ".svg", ".pdf")
"""Endings of files that `save_figure` writes."""


def save_figure(figure: Figure, path: Path) -> None:
    """Write a figure as its ending says, one of `PICTURE_SUFFIXES`; the same figure gives the same file.

    Errors as of `new_picture`.
    """
    import matplotlib as mpl

    kind = path.suffix.lower().removeprefix(".")
    # Without a salt and dates of our own, Matplotlib writes random identifiers and the time.
    dates: dict[str, dict[str, Any]] = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}
    with mpl.rc_context({"svg.hashsalt": "markerseek"}), new_picture(path, what="picture") as part:
        figure.savefig(part, format=kind, dpi=120, metadata=dates.get(kind))


def png_data_uri(figure: Figure) -> str:
    """Return the figure as a PNG ``data:`` URI, for a page that loads no other file."""
    buffer = io.BytesIO()
    figure.savefig(buffer, dpi=120, format="png")
    return "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode("ascii")


@cache
def _templates() -> Environment:
    """Return the Jinja2 environment of the templates; an undefined name in a template is an error."""
    with needs_package("jinja2", extra="plot", purpose="a page"):
        from jinja2 import Environment, PackageLoader, StrictUndefined
    return Environment(
        loader=PackageLoader("markerseek.show"),
        # Descriptions and paths come from files of other people and could contain markup.
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def write_page(path: Path, template: str, **values: object) -> None:
    """Write one page, in which every value is escaped.

    ``path``: HTML file to write. ``template``: name of the template, whose first line names its values.
    """
    text = _templates().get_template(template).render(values)
    with new_picture(path, what="page") as part:
        part.write_text(text, encoding="utf-8")
