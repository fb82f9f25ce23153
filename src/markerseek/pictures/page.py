"""Writes self-contained HTML pages from Jinja2 templates; every value is escaped."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from markerseek.core import ConfigError, MissingExtraError
from markerseek.files import replace_file

if TYPE_CHECKING:
    from jinja2 import Environment


@cache
def templates() -> Environment:
    """Jinja2 environment of the templates; an undefined name in a template is an error.

    Raises
    ------
    MissingExtraError
        If Jinja2 is not installed.
    """
    try:
        from jinja2 import Environment, PackageLoader, StrictUndefined
    except ImportError as problem:
        raise MissingExtraError(package="jinja2", extra="plot", purpose="a page") from problem
    return Environment(
        loader=PackageLoader("markerseek.pictures"),
        # Descriptions and paths come from files of other people and could contain markup.
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def write_from_template(path: Path, template: str, **values: object) -> None:
    """Write one page; the folder is made if need be.

    Parameters
    ----------
    path
        HTML file to write.
    template
        Name of the template.
    **values
        Values of the names in the template.

    Raises
    ------
    ConfigError
        If the file cannot be written.
    RecordError
        If its name is that of a symbolic link, a pipe or a device.
    MissingExtraError
        If Jinja2 is not installed.
    """
    text = templates().get_template(template).render(values)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with replace_file(path) as part:
            part.write_text(text, encoding="utf-8")
    except OSError as problem:
        raise ConfigError(f"{path}: the page cannot be written: {problem.strerror}; name another --out") from problem


def write_page(
    path: Path,
    *,
    title: str,
    note: str | None,
    facts: Sequence[tuple[str, str]],
    picture_uri: str,
    alt: str,
    rows: Sequence[Sequence[str]],
    json: str,
) -> None:
    """Write the page of one search.

    Parameters
    ----------
    path
        HTML file to write; its folder is made if need be.
    title, note
        Heading, and a warning beneath it (such as "simulated").
    facts
        Names and values of the result.
    picture_uri, alt
        The picture as a ``data:`` address, and its description in words.
    rows
        Table of the acquisitions, its headings first.
    json
        The whole result, indented.

    Raises
    ------
    ConfigError
        If the file cannot be written.
    RecordError
        If its name is that of a symbolic link, a pipe or a device.
    MissingExtraError
        If Jinja2 is not installed.
    """
    write_from_template(
        path,
        "search.html.jinja",
        title=title,
        note=note,
        facts=facts,
        picture_uri=picture_uri,
        alt=alt,
        rows=rows,
        json=json,
    )
