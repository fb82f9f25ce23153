"""Whether the endoscope has moved since the registration, by the images of the session and those without light now."""

from __future__ import annotations

from pathlib import Path

from markerseek.following.spot_source import SpotSource
from markerseek.registration import (
    EndoscopeWatch,
    SeenEndoscope,
    StereoSettings,
    kept_pair,
    read_session,
    station_names,
    view_of,
)


class EndoscopeCheck:
    """Compares the newest pair without light with that of the last place where the endoscope stood in the session.

    ``session``: its folder; None: the pair of the first look, so that a move before it is not seen: the spot that
    confirms the registration shows that one.
    """

    def __init__(self, stereo: StereoSettings, spot: SpotSource, session: Path | None) -> None:
        self._watch = EndoscopeWatch(stereo.cameras)
        self._spot = spot
        self._since = ""
        if session is not None:
            stations = station_names(view_of(read_session(session), session).markers)
            name = next(reversed(stations.values()))
            pair = kept_pair(session, name)
            if pair is not None:
                self._watch.begin(name, pair)
                self._since = name

    def look(self) -> SeenEndoscope | None:
        """Return how the endoscope has moved; None if there is nothing to compare yet."""
        if not self._spot.dark:
            return None
        pair = self._spot.dark[-1]
        if not self._since:
            self._since = "the first look"
            self._watch.begin(self._since, pair)
            return None
        return self._watch.look(pair, after=self._since)
