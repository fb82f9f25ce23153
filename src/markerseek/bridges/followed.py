"""What bridges hand on beside events: the images of a run, and the registration of a finished file or of a session."""

from __future__ import annotations

import threading
from dataclasses import replace
from itertools import islice
from pathlib import Path

from markerseek._closing import Closing
from markerseek.core import AcquisitionError, ChannelFrame, Measured, PaImage, RecordError, Sample
from markerseek.records.journal import Configuration, Entry, RunView
from markerseek.registration import (
    SessionView,
    follow_session,
    is_running,
    next_view,
    read_registration,
    read_session,
    session_folder,
    view_of,
)
from markerseek.runs import rebuild_image_reader


class RunImages:
    """Makes the images of one run.

    Attributes
    ----------
    brightest
        Largest envelope so far, in counts: what is white. What will come is not known.
    problem
        Why the last frame gave no image; empty if it gave one.
    """

    def __init__(self, configuration: Configuration) -> None:
        self._imaging = rebuild_image_reader(configuration)
        self.brightest = 0.0
        self.problem = ""

    def of(self, sample: Sample) -> PaImage | None:
        """Photoacoustic image of an acquisition; None if it has none."""
        if self._imaging is None or not isinstance(sample.frame, ChannelFrame):
            return None
        try:
            image = self._imaging.picture(sample.frame)
        except AcquisitionError as problem:
            self.problem = str(problem)
            return None
        self.brightest = max(self.brightest, float(image.envelope.max()))
        return image


def since_fired_s(view: RunView, entry: Entry) -> float:
    """Seconds from the first pulse of an acquisition of devices to its entry; 0 for all other entries."""
    frame = entry.event.sample.frame if isinstance(entry.event, Measured) else None
    # A simulated clock runs ahead of the time of day.
    if frame is None or view.facts.kind != "bench":
        return 0.0
    return max(0.0, entry.clock_s - frame.header.started_s)


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
        super().__init__(self._as_it_runs(view))
        self._thread = threading.Thread(target=self._follow, args=[len(steps)], name="registration", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Follow no longer; allowed twice."""
        self._closed.set()
        self._thread.join()

    def _follow(self, known: int) -> None:
        """Follow the session from a number of steps on, which are known."""
        newest = shown = self.view

        def look() -> None:
            nonlocal shown
            # Steps that come together are shown together, because the states between them are over already.
            view = self._as_it_runs(newest)
            if newest is not shown or view.phase != self.view.phase:
                shown = newest
                self.view = view
            self._closed.wait(_POLL_S)

        try:
            steps = follow_session(self._folder, is_over=self._closed.is_set, wait=look)
            for step in islice(steps, known, None):
                newest = next_view(newest, step)
        except RecordError as problem:
            self.view = self.view.unreadable(str(problem))

    def _as_it_runs(self, view: SessionView) -> SessionView:
        """Return the view, and whether a program runs the session."""
        if view.ended is not None:
            return view
        return replace(view, phase="running" if is_running(self._folder) else "stopped")


def open_registration(path: Path) -> RegistrationSource:
    """Open the registration in ``registration.json``, or that of a session by its folder or a file in it.

    A ``registration.json`` in the folder of a session is followed as the session is, because it may be withdrawn.
    Raises `RecordError` if there is none, and none can come.
    """
    folder = session_folder(path)
    if folder is not None:
        return FollowedSession(folder)
    return RegistrationSource(SessionView.of_file(read_registration(path), path))
