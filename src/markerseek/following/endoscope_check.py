"""Whether the endoscope has moved since the registration, by the images of the session and those without light now."""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Literal, Protocol, TypeAlias

from markerseek._closing import Closing
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

GoingOn: TypeAlias = Literal["going on"]
"""A look of which nothing is known yet."""


class DarkPairs(Protocol):
    """Image pairs with the laser off."""

    def newest_dark(self) -> StereoPair | None:
        """Return the newest pair; None: there is none, or none that is new."""


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
        """Return the newest pair, whoever has it already; None: there was none yet."""
        pairs = self._images.newest()
        if pairs:
            self._newest = pairs[-1]
        return self._newest


class EndoscopeCheck(Closing):
    """Compares the newest pair without light with that of the last place where the endoscope stood in the session.

    ``session``: its folder; None: the pair of the first look, so that a move before it is not seen: the spot that
    confirms the registration shows that one.
    """

    def __init__(self, stereo: StereoSettings, pairs: DarkPairs, session: Path | None) -> None:
        self._watch = EndoscopeWatch(stereo.cameras)
        self._pairs = pairs
        self._since = ""
        self._beside = ThreadPoolExecutor(max_workers=1, thread_name_prefix="endoscope")
        self._going_on: Future[SeenEndoscope | None] | None = None
        if session is not None:
            stations = station_names(read_view(session).markers)
            name = next(reversed(stations.values()))
            pair = kept_pair(session, name)
            if pair is not None:
                self._watch.begin(name, pair)
                self._since = name

    def look(self) -> SeenEndoscope | None:
        """Return how the endoscope has moved; None if there is nothing to compare yet."""
        return self._compare(self._pairs.newest_dark())

    def glance(self) -> SeenEndoscope | GoingOn | None:
        """Return what `look` does, once it is known: it is computed beside, so that a probe that turns is read in time.

        Image pairs are taken here, in the thread that follows. To be closed then.
        """
        if self._going_on is None:
            self._going_on = self._beside.submit(self._compare, self._pairs.newest_dark())
        if not self._going_on.done():
            return "going on"
        seen = self._going_on.result()
        self._going_on = None
        return seen

    def close(self) -> None:
        """End the thread of `glance`; allowed twice."""
        self._beside.shutdown(wait=True, cancel_futures=True)

    def _compare(self, pair: StereoPair | None) -> SeenEndoscope | None:
        """Compare a pair; None: no new one came."""
        if pair is None:
            if not self._since:
                return None
            return EndoscopeNotKnown(after=self._since, reason="no images come")
        if not self._since:
            self._since = "the first look"
            self._watch.begin(self._since, pair)
            return None
        return self._watch.look(pair, after=self._since)
