"""The registration that bridges hand on: that of a finished file, or of a session, which is followed."""

from __future__ import annotations

import threading
from itertools import islice
from pathlib import Path

from markerseek._closing import Closing
from markerseek.core import RecordError, plain
from markerseek.registration import (
    SessionView,
    as_it_runs,
    follow_session,
    next_view,
    read_registration,
    read_session,
    session_folder,
    view_of,
)

_POLL_S = 0.1
"""Time from one look at the record to the next, in seconds."""


class RegistrationSource(Closing):
    """Says what a registration is now, that of a finished file until a session changes it; read `view` at any time."""

    def __init__(self, view: SessionView) -> None:
        self.view = view
        """The newest; another object only if something has changed."""

    def close(self) -> None:
        """Follow no longer; allowed twice."""


class FollowedSession(RegistrationSource):
    """The registration of a session, followed in a thread of its own until it is closed.

    A session that was stopped is followed too: it goes on here when it is continued.

    Raises
    ------
    RecordError
        If the session has not begun, cannot be read, or has ended without a registration that holds.
    """

    def __init__(self, folder: Path) -> None:
        steps = read_session(folder)
        view = view_of(steps, folder)
        if view.registration is None and (view.ended is not None or view.moved):
            raise RecordError(
                f"{folder}: the session has ended without a registration that holds ({view.said}); register again"
            )
        self._folder = folder
        self._closed = threading.Event()
        super().__init__(as_it_runs(view, folder))
        self._thread = threading.Thread(target=self._follow, args=[len(steps)], name="registration", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Follow no longer; allowed twice."""
        self._closed.set()
        self._thread.join()

    def _follow(self, known: int) -> None:
        """Follow the session from a number of steps on, which are known."""
        newest = self.view
        shown = newest

        def look() -> None:
            nonlocal shown
            # Steps that come together are shown together, because the states between them are over already.
            view = as_it_runs(newest, self._folder)
            if newest is not shown or view.phase != self.view.phase:
                shown = newest
                self.view = view
            self._closed.wait(_POLL_S)

        try:
            steps = follow_session(self._folder, is_over=self._closed.is_set, wait=look)
            for step in islice(steps, known, None):
                newest = next_view(newest, step)
        except RecordError as problem:
            self.view = self.view.unreadable(plain(str(problem)))


def open_registration(path: Path) -> RegistrationSource:
    """Open the registration in ``registration.json``, or that of a session by its folder or a file in it.

    A ``registration.json`` in the folder of a session is followed as the session is, because it may be withdrawn.
    Raises `RecordError` if there is none, and none can come.
    """
    folder = session_folder(path)
    if folder is not None:
        return FollowedSession(folder)
    return RegistrationSource(SessionView.of_file(read_registration(path), path))
