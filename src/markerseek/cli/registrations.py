"""The list of registration sessions that are kept."""

from __future__ import annotations

from pathlib import Path

import msgspec
from rich.markup import escape

from markerseek import registration
from markerseek.cli.report import Report
from markerseek.cli.terminal import local_time, one_line
from markerseek.core import ConfigError, counted


def sessions_report(folder: Path | None) -> Report:
    """Return the report of the sessions in a folder; None: in the folder of sessions for which no folder was named."""
    place = folder or registration.sessions_folder()
    if folder is not None and not folder.is_dir():
        raise ConfigError(f"{folder}: there is no such folder; name one that holds folders of sessions")
    # Before the first session there is no such folder.
    kept = registration.kept_sessions(place) if place.exists() else []
    total_bytes = sum(each.size_bytes for each in kept)
    lines = []
    for each in kept:
        lines.append(f"[bold]{one_line(Path(each.folder).name)}[/]\n  {one_line(_in_words(each))}")
        if each.phase == "unreadable" or not each.registered:
            lines.append(f"  [dim]{one_line(each.said)}[/]")
    lines.append(f"{counted(len(kept), 'session')} in {escape(str(place))}, {total_bytes / 1e6:.1f} MB")
    sessions = [msgspec.to_builtins(each) | {"state": each.state} for each in kept]
    return Report(values={"folder": str(place), "sessions": sessions}, shown=lines)


def _in_words(session: registration.KeptSession) -> str:
    """Return a session in a line: when, on which rig, its markers, errors and state."""
    if session.begun is None:
        return session.state
    errors = ""
    if session.tre_m is not None and session.tre95_m is not None:
        errors = f", expected error {1e3 * session.tre_m:.2f} mm (95 %: {1e3 * session.tre95_m:.2f})"
    if session.off_m is not None:
        errors += f", {1e3 * session.off_m:.2f} mm off at the spot that checked it"
    markers = counted(session.markers, "marker")
    size = f"{session.size_bytes / 1e6:.1f} MB"
    return f"{local_time(session.begun)}, {session.rig}: {session.state}, {markers}{errors}, {size}"
