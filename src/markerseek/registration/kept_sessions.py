"""Registration sessions that are kept: what a list says of each, and how one is deleted."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import msgspec

from markerseek.core import ConfigError, RecordError
from markerseek.files import open_for_writing
from markerseek.records.journal import lock
from markerseek.registration.record import (
    CAMERA_IMAGES,
    NAME,
    POINTED_AT,
    REGISTRATION_FILE,
    SPOT_IS_SET,
    is_running,
    read_view,
)
from markerseek.registration.view import Phase, SessionView
from markerseek.registration.watched_motion import MOTION_FILE

REPORTS = ("report.html", "report.pdf")
"""Names of the report of a session, in its folder."""

_OWN_NAMES = (*CAMERA_IMAGES, REGISTRATION_FILE, SPOT_IS_SET, POINTED_AT, MOTION_FILE, *REPORTS)
_OWN_PATTERNS = ("*.journal", "following-*.jsonl", "*-left.png", "*-right.png")
"""What a session writes into its folder beside its record."""


class KeptSession(msgspec.Struct, frozen=True, kw_only=True):
    """What a list says of a session.

    ``tre_m`` and ``tre95_m`` are the expected errors of its registration, ``off_m`` the error at the last spot that
    checked it; None without a registration that holds, or a check of it. ``registered`` says whether one holds.
    """

    folder: str
    phase: Phase
    registered: bool
    said: str
    """The state in a sentence."""
    size_bytes: int
    begun: str | None = None
    """When it began, UTC; None where the record cannot be read."""
    rig: str = ""
    """The rig in words."""
    simulated: bool = False
    markers: int = 0
    goal_reached: bool = False
    tre_m: float | None = None
    tre95_m: float | None = None
    off_m: float | None = None

    @property
    def state(self) -> str:
        """The state in some words."""
        found = "registered" if self.registered else "not registered"
        if self.registered and not self.goal_reached:
            found = "registered above the goal"
        return {"ended": found, "running": "running", "stopped": f"stopped, {found}"}.get(self.phase, "cannot be read")


def kept_view(folder: Path) -> SessionView:
    """Return a session, and whether a program runs it; `RecordError` if it cannot be read."""
    return as_it_runs(read_view(folder), folder)


def as_it_runs(view: SessionView, folder: Path) -> SessionView:
    """Return the view of a session in this folder, and whether a program runs it."""
    if view.ended is not None:
        return view
    return replace(view, phase="running" if is_running(folder) else "stopped")


def kept_sessions(folder: Path) -> list[KeptSession]:
    """Return the sessions whose folders are in this one, the newest first; those that cannot be read come last."""
    try:
        held = sorted(each.parent for each in folder.glob(f"*/{NAME}"))
    except OSError as problem:
        raise RecordError(f"{folder}: it cannot be read: {problem.strerror or problem}; check the rights") from problem
    return sorted(map(kept_session, held), key=lambda each: each.begun or "", reverse=True)


def kept_session(folder: Path) -> KeptSession:
    """Return what a list says of the session in this folder."""
    size_bytes = sum(each.stat().st_size for each in folder.iterdir() if each.is_file())
    try:
        view = kept_view(folder)
    except RecordError as problem:
        said = str(problem)
        return KeptSession(folder=str(folder), phase="unreadable", registered=False, said=said, size_bytes=size_bytes)
    known = view.registration
    begun = view.begun
    assert begun is not None and view.phase is not None  # noqa: S101, PT018  of a record, which begins with it
    report = None if known is None else known.report
    return KeptSession(
        folder=str(folder),
        phase=view.phase,
        registered=known is not None,
        said=view.sentence,
        size_bytes=size_bytes,
        begun=begun.begun,
        rig=begun.description,
        simulated=begun.simulated,
        markers=len(view.markers),
        goal_reached=view.goal_reached,
        tre_m=None if report is None else report.tre_m,
        tre95_m=None if report is None else report.tre95_m,
        off_m=None if report is None or not report.checks else report.checks[-1].off_m,
    )


def delete_session(folder: Path) -> list[str]:
    """Delete a session: all that it wrote into its folder, and the folder if nothing else is in it.

    Returns the names of other programs' files, which stay with the folder. Raises `ConfigError` if it is no folder of a
    session, or a link, and `RecordError` if a program runs it or its files cannot be deleted.
    """
    record = folder / NAME
    if folder.is_symlink() or not record.is_file() or record.is_symlink():
        raise ConfigError(f"{folder}: it is no folder of a session, or a link to one; name the folder itself")
    try:
        with os.fdopen(open_for_writing(record, os.O_RDWR), "r+b") as file:
            lock(file.fileno())
            own = [folder / name for name in _OWN_NAMES]
            own += [path for pattern in _OWN_PATTERNS for path in folder.glob(pattern)]
            # The record last: what is left of a session by then is still one that can be deleted.
            for path in (*own, record):
                path.unlink(missing_ok=True)
        others = sorted(each.name for each in folder.iterdir())
        if not others:
            folder.rmdir()
    except BlockingIOError as problem:
        raise RecordError(f"{folder}: another markerseek runs this session; wait until it ends") from problem
    except OSError as problem:
        raise RecordError(
            f"{folder}: it cannot be deleted: {problem.strerror or problem}; check the rights"
        ) from problem
    return others
