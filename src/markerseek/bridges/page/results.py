"""What a person takes away: the report as HTML, PNG and JSON, and the angle for the clipboard."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec
from nicegui import run, ui

REPORT_S = 120.0
"""Longest time to draw a report, in seconds."""


def make_report(journal: Path) -> dict[str, bytes]:
    """Pictures of a finished search by the ordinary command, as file names and contents; none without Matplotlib.

    Parameters
    ----------
    journal
        Journal of the search.

    Raises
    ------
    OSError
        If the command cannot be run, or does not end in time.
    """
    with tempfile.TemporaryDirectory() as folder:
        command = ["resume", str(journal), "--plot", "--out", folder, "--json"]
        # -P: a file in the current folder must not replace a module.
        subprocess.run(  # noqa: S603  no shell; the journal is one that this page keeps or was started with
            [sys.executable, "-P", "-m", "markerseek", *command],
            capture_output=True,
            timeout=REPORT_S,
            check=False,
            stdin=subprocess.DEVNULL,
        )
        return {f"search{path.suffix}": path.read_bytes() for path in sorted(Path(folder).iterdir())}


class ResultRow:
    """Buttons of a finished search."""

    def __init__(self) -> None:
        self._answer: dict[str, Any] | None = None
        self._journal: Path | None = None
        self._reports: dict[Path, dict[str, bytes]] = {}
        with ui.element("div").classes("ms-foot") as self._bar:
            self._text = ui.label("").mark("result")
            with ui.element("span") as self._pictures:
                self._button("search.html")
                self._button("search.png")
            self._button("search.json")
            self._copy_button = ui.button("copy the angle", icon="content_copy", on_click=self._copy)
            self._copy_button.props("flat dense")
        self._bar.visible = False

    def _button(self, name: str) -> None:
        text = f"report {name.rpartition('.')[2].upper()}"
        ui.button(text, icon="download", on_click=lambda: self._give(name)).props("flat dense")

    def show(self, answer: Mapping[str, Any] | None, journal: Path | None) -> None:
        """Show the buttons once there is a result; pictures only of a search with a journal."""
        self._answer = None if answer is None or "angle_deg" not in answer else dict(answer)
        self._journal = journal
        self._bar.set_visibility(self._answer is not None)
        self._pictures.set_visibility(journal is not None)
        if self._answer is not None:
            # An angle that nobody claims must not find its way into a protocol.
            found = self._answer["answer"] == "found"
            self._text.set_text(f"found at {self._answer['angle_deg']:.3f}°" if found else self._answer["answer"])
            self._copy_button.set_visibility(found)

    async def _give(self, name: str) -> None:
        if name == "search.json":
            ui.download.content(msgspec.json.format(msgspec.json.encode(self._answer), indent=2), name)
            return
        journal = self._journal
        if journal is None:
            return
        if journal not in self._reports:
            made = await run.io_bound(make_report, journal)
            # None while the program ends.
            if made is None:
                return
            self._reports = {journal: made}
        if name in self._reports[journal]:
            ui.download.content(self._reports[journal][name], name)
        else:
            ui.notify("pictures need Matplotlib: pip install 'markerseek[plot]'", type="warning")

    def _copy(self) -> None:
        if self._answer is not None:
            ui.clipboard.write(f"{self._answer['angle_deg']:.4f}")
            ui.notify("the angle is in the clipboard")
