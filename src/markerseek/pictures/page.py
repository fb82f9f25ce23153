"""One HTML file that holds a picture, a table and the numbers, and loads nothing."""

from __future__ import annotations

import html
from collections.abc import Sequence
from pathlib import Path

from markerseek.core import ConfigError
from markerseek.files import replaced

_PAGE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title>
<style>
body {{ font: 15px/1.5 system-ui, sans-serif; color: #1c2026; margin: 2rem auto; max-width: 1120px; padding: 0 1rem; }}
h1 {{ font-size: 1.35rem; overflow-wrap: anywhere; }} h2 {{ font-size: 1.05rem; margin-top: 2rem; }}
p.note {{ color: #7a3410; font-weight: 600; }}
img {{ max-width: 100%; }}
table {{ border-collapse: collapse; }}
div {{ overflow-x: auto; }}
th, td {{ text-align: left; vertical-align: top; padding: .2rem 1rem .2rem 0; border-bottom: 1px solid #e3e6ea; }}
th {{ white-space: nowrap; }} td {{ font-variant-numeric: tabular-nums; }}
details {{ margin-top: 1rem; }} pre {{ overflow-x: auto; background: #f5f6f8; padding: 1rem; font-size: 12px; }}
</style>
</head>
<body>
<h1>{title}</h1>
{note}
<table>{facts}</table>
<p><img src="{picture}" alt="{alt}"></p>
<h2>Acquisitions</h2>
<div><table>{samples}</table></div>
<details><summary>The result as JSON</summary><pre>{json}</pre></details>
</body>
</html>
"""


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
    """
    text = _PAGE.format(
        title=html.escape(title),
        note="" if note is None else f'<p class="note">{html.escape(note)}</p>',
        facts="".join(f"<tr><th>{html.escape(name)}</th><td>{html.escape(value)}</td></tr>" for name, value in facts),
        picture=picture_uri,
        alt=html.escape(alt),
        samples=_row("th", rows[0]) + "".join(_row("td", row) for row in rows[1:]),
        json=html.escape(json),
    )
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with replaced(path) as part:
            part.write_text(text, encoding="utf-8")
    except OSError as problem:
        raise ConfigError(f"{path}: the page cannot be written: {problem.strerror}; name another --out") from problem


def _row(kind: str, cells: Sequence[str]) -> str:
    return "<tr>" + "".join(f"<{kind}>{html.escape(cell)}</{kind}>" for cell in cells) + "</tr>"
