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

from markerseek.core import MarkerseekError, SearchError

REPORT_S = 120.0
"""Longest time to draw a report, in seconds."""


def is_claimed(answer: Mapping[str, Any]) -> bool:
    """Whether a search claims its angle; the paper's form of a method answers always and claims nothing."""
    return bool(answer["answer"] == "found" and not answer["as_published"])


def make_report(journal: Path) -> dict[str, bytes]:
    """Picture and page of a finished search by the ordinary command, as file names and contents.

    Raises `OSError` if the command cannot be run.
    """
    with tempfile.TemporaryDirectory() as folder:
        command = ["resume", str(journal), "--plot", "--out", folder, "--json"]
        try:
            # -P: a file in the current folder must not replace a module.
            done = subprocess.run(  # noqa: S603  no shell; the journal is one that this page keeps
                [sys.executable, "-P", "-m", "markerseek", *command],
                capture_output=True,
                timeout=REPORT_S,
                check=False,
                stdin=subprocess.DEVNULL,
            )
        except subprocess.TimeoutExpired as problem:
            raise SearchError(f"the report was not drawn within {REPORT_S:g} s; press again") from problem
        made = {f"search{path.suffix}": path.read_bytes() for path in sorted(Path(folder).iterdir())}
        if not made:
            try:
                reason = msgspec.json.decode(done.stdout, type=dict[str, Any])["error"]
            except (msgspec.MsgspecError, KeyError):
                reason = f"the report was not drawn: its command ended with exit code {done.returncode}"
            raise SearchError(reason)
        return made


class ResultRow:
    """Buttons of a finished search."""

    def __init__(self) -> None:
        self._answer: dict[str, Any] | None = None
        self._journal: Path | None = None
        self._reports: dict[Path, dict[str, bytes]] = {}
        self._drawing = False
        with ui.element("div").classes("ms-foot") as self._bar:
            with ui.element("span") as self._pictures:
                for name in ("search.html", "search.png"):
                    _button(f"report {name[7:].upper()}", "download").on_click(lambda name=name: self._give(name))
            _button("report JSON", "download").on_click(self._give_json)
            self._copy_button = _button("copy the angle", "content_copy").on_click(self._copy)
        self._bar.visible = False

    def show(self, answer: Mapping[str, Any] | None, journal: Path | None) -> None:
        """Show the buttons once there is a result; pictures only of a search with a journal."""
        self._answer = None if answer is None or "angle_deg" not in answer else dict(answer)
        self._journal = journal
        self._bar.set_visibility(self._answer is not None)
        self._pictures.set_visibility(journal is not None)
        # An angle that nobody claims must not find its way into a protocol.
        self._copy_button.set_visibility(self._answer is not None and is_claimed(self._answer))

    def _give_json(self) -> None:
        ui.download.content(msgspec.json.format(msgspec.json.encode(self._answer), indent=2), "search.json")

    async def _give(self, name: str) -> None:
        journal = self._journal
        if journal is None or self._drawing:
            return
        if journal not in self._reports:
            self._drawing = True
            ui.notify("the report is being drawn, which takes some seconds", position="bottom-right")
            try:
                made = await run.io_bound(make_report, journal)
            except (MarkerseekError, OSError) as problem:
                ui.notify(str(problem), type="negative", multi_line=True)
                return
            finally:
                self._drawing = False
            # None while the program ends.
            if made is None:
                return
            self._reports = {journal: made}
        ui.download.content(self._reports[journal][name], name)

    def _copy(self) -> None:
        if self._answer is not None:
            ui.clipboard.write(f"{self._answer['angle_deg']:.4f}")
            ui.notify("the angle is in the clipboard")


def _button(text: str, icon: str) -> ui.button:
    return ui.button(text, icon=icon).props("flat dense")
