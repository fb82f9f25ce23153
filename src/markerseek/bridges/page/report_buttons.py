"""Buttons that give a report away."""

from __future__ import annotations

import subprocess
from collections.abc import Callable

from nicegui import run, ui

from markerseek.core import MarkerseekError, plain


def report_button(text: str, name: str, make: Callable[[], dict[str, bytes] | None]) -> ui.button:
    """Add a button that gives one file of a report; ``make``: makes its files by their names, None if there is none."""
    return ui.button(text, icon="download", on_click=lambda: _give(name, make)).props("flat dense")


async def _give(name: str, make: Callable[[], dict[str, bytes] | None]) -> None:
    ui.notify("the report is being drawn, which takes some seconds", position="bottom-right")
    try:
        made = await run.io_bound(make)
    except (MarkerseekError, OSError, subprocess.TimeoutExpired) as problem:
        ui.notify(plain(str(problem)), type="negative", multi_line=True)
        return
    # None while the program ends.
    if made is not None:
        ui.download.content(made[name], name)
