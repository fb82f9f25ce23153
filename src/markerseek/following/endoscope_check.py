"""Whether the endoscope has moved since the registration, by the images of the session and those without light now."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

from markerseek.core import StereoImages, StereoPair
from markerseek.registration import (
    EndoscopeNotKnown,
    EndoscopeWatch,
    SeenEndoscope,
    StereoSettings,
    kept_pair,
    read_view,
    station_names,
)


class DarkPairs(Protocol):
    """Image pairs with the laser off."""

    def newest_dark(self) -> StereoPair | None:
        """Newest pair; None: there is none, or none that is new."""


class NewestPairs:
    """`DarkPairs` of cameras where the laser is off all the time."""

    def __init__(self, images: StereoImages) -> None:
        self._images = images
        self._newest: StereoPair | None = None
        self._given: StereoPair | None = None

    @property
    def name(self) -> str:
        """What the pairs come from, for messages."""
        return self._images.name

    def newest_dark(self) -> StereoPair | None:
        """As of `DarkPairs`."""
        pair = self.newest()
        if pair is self._given:
            return None
        self._given = pair
        return pair

    def newest(self) -> StereoPair | None:
        """Newest pair, whoever has it already; None: there was none yet."""
        pairs = self._images.newest()
        if pairs:
            self._newest = pairs[-1]
        return self._newest


class EndoscopeCheck:
    """Compares the newest pair without light with that of the last place where the endoscope stood in the session.

    ``session``: its folder; None: the pair of the first look, so that a move before it is not seen: the spot that
    confirms the registration shows that one.
    """

    def __init__(self, stereo: StereoSettings, pairs: DarkPairs, session: Path | None) -> None:
        self._watch = EndoscopeWatch(stereo.cameras)
        self._pairs = pairs
        self._since = ""
        if session is not None:
            stations = station_names(read_view(session).markers)
            name = next(reversed(stations.values()))
            pair = kept_pair(session, name)
            if pair is not None:
                self._watch.begin(name, pair)
                self._since = name

    def look(self) -> SeenEndoscope | None:
        """Return how the endoscope has moved; None if there is nothing to compare yet."""
        pair = self._pairs.newest_dark()
        if pair is None:
            if not self._since:
                return None
            return EndoscopeNotKnown(after=self._since, reason="no images come")
        if not self._since:
            self._since = "the first look"
            self._watch.begin(self._since, pair)
            return None
        return self._watch.look(pair, after=self._since)
