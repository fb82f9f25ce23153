"""What a person takes away: the report as HTML, PNG and JSON, and the angle for the clipboard."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import msgspec
from nicegui import run, ui

from markerseek.bridges.page.live import LiveRun

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
        self._live: LiveRun | None = None
        self._reports: dict[Path, dict[str, bytes]] = {}
        with ui.element("div").classes("ms-foot") as self._bar:
            self._text = ui.label("").mark("result")
            for suffix in ("html", "png", "json"):
                ui.button(
                    f"report {suffix.upper()}",
                    icon="download",
                    on_click=lambda name=f"search.{suffix}": self._give(name),
                ).props("flat dense").mark(f"report-{suffix}")
            ui.button("copy the angle", icon="content_copy", on_click=self._copy).props("flat dense").mark("copy")
        self._bar.visible = False

    def show(self, live: LiveRun) -> None:
        """Show the buttons once there is a result."""
        self._live = live
        answer = _answer(live)
        self._bar.set_visibility(answer is not None)
        if answer is not None:
            self._text.set_text(f"{answer['answer']} at {answer['angle_deg']:.3f}°")

    async def _give(self, name: str) -> None:
        answer = None if self._live is None else _answer(self._live)
        if self._live is None or self._live.journal is None or answer is None:
            return
        if name == "search.json":
            ui.download.content(msgspec.json.format(msgspec.json.encode(answer), indent=2), name)
            return
        journal = self._live.journal
        if journal not in self._reports:
            made = await run.io_bound(make_report, journal)
            # None while the program ends.
            if made is None:
                return
            self._reports = {journal: made}
        report = self._reports[journal]
        if name in report:
            ui.download.content(report[name], name)
        else:
            ui.notify("pictures need Matplotlib: pip install 'markerseek[plot]'", type="warning")

    def _copy(self) -> None:
        answer = None if self._live is None else _answer(self._live)
        if answer is not None:
            ui.clipboard.write(f"{answer['angle_deg']:.4f}")
            ui.notify("the angle is in the clipboard")


def _answer(live: LiveRun) -> dict[str, object] | None:
    answer = None if live.outcome is None else live.outcome.answer
    return answer if answer is not None and "angle_deg" in answer else None
