"""The breath of the tissue, as a session knows it: watched before a search, seen in each search, awaited for the next.

What a search takes of it is its `CameraTissue`; a spot is looked for in a pause of it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from msgspec import structs

from markerseek.core import StereoPair
from markerseek.registration.camera_tissue import CameraRotation, CameraTissue, SeenScene
from markerseek.registration.endoscope_motion import EndoscopeMotion, SeenEndoscope, less_breath
from markerseek.registration.plan import Gate
from markerseek.registration.room import Room
from markerseek.registration.search_scene import SearchScene
from markerseek.registration.search_watch import SearchWatch
from markerseek.registration.spots import Looked, SpotError, SpotFinder
from markerseek.registration.steps import TakenMarker
from markerseek.vision import ClockOffset, NotKnown, SceneWatch, TissueMoves, scene_texture

MOST_LOOK_ON_S = 13.0
"""Longest time in which the cameras look on, to tell what moves: one and a half of the longest breaths."""

_GLANCE_S = 4.0
"""Time in which a breath shows, if there is one."""

_GLANCES_S = 0.5
"""Time between two questions whether the tissue breathes, while it is watched."""

_PAUSE_POLL_S = 0.05
"""Time between two questions whether a pause has begun."""

_WATCHED_BREATHS = 2.0
"""Breaths that are watched before a search: with fewer, a wrong period fits as well."""

_OVER_BREATHS = 1.6
"""Breaths without motion after which there is none any more."""

_ENOUGH_BREATHS = 2.5
"""Breaths after which a search knows them as well as an earlier one."""


class KnownBreath:
    """The breath of the tissue, as the searches of a session have shown it so far.

    Parameters
    ----------
    room
        Where the session takes place.
    gate
        Whether light waits for the pauses of the breath.
    markers
        Those that were taken before.
    """

    def __init__(self, room: Room, *, gate: Gate, markers: Sequence[TakenMarker] = ()) -> None:
        self._room = room
        self._gate = gate
        self.moves: TissueMoves | None = None
        """How the tissue breathes, at times of the rig's clock; None: it does not, or it is not known."""
        self.offset: ClockOffset | None = None
        """Offset of the cameras' clock, as the searches so far show it."""
        self._rests = False
        """Whether the tissue was watched, and did not move."""
        for marker in markers:
            if marker.scene is not None:
                self.moves = newer_breath(self.moves, marker.scene, during_s=marker.rig_s)

    @property
    def waits(self) -> bool:
        """Whether light waits for the pauses."""
        return self._gate != "never"

    def look(self, spots: SpotFinder) -> Looked:
        """Look for the spot in a pause of the breath; where it is refused, find out whether there is one.

        `SpotError` if there is no spot.
        """
        if self._gate == "always" and self.moves is None:
            self._watch(spots)
        self.await_pause()
        try:
            return spots.look()
        except SpotError:
            if not self._watch(spots):
                raise
        self.await_pause()
        return spots.look()

    def await_pause(self) -> None:
        """Wait for a pause of the breath: a spot that moves is not measured."""
        breath = self.moves
        if breath is None or breath.period_s is None:
            return
        clock = self._room.rig.scanner.clock
        until_s = clock.now_s() + 2 * breath.period_s
        # Most of the pause must be left for the look.
        while not (breath.in_pause(clock.now_s()) and breath.in_pause(clock.now_s() + 0.8 * breath.pause_s)):
            if clock.now_s() >= until_s:
                return
            clock.wait(_PAUSE_POLL_S)

    def _watch(self, spots: SpotFinder) -> bool:
        """Watch the tissue in the dark for up to two breaths; whether it was seen to breathe.

        It is watched again only if it moved.
        """
        if self._rests or not self.waits:
            return False
        try:
            texture = scene_texture(spots.dark()[-1], self._room.stereo.cameras)
        except SpotError:
            return False
        if isinstance(texture, NotKnown):
            return False
        places_m = texture.points.positions_m
        middle = int(np.argmin(np.linalg.norm(places_m - np.median(places_m, axis=0), axis=1)))
        watch = SceneWatch(texture, spot_m=places_m[middle], rng=np.random.default_rng(0))
        clock = self._room.rig.scanner.clock
        ahead_s = [-math.inf]

        def look(pair: StereoPair) -> None:
            ahead_s[0] = max(ahead_s[0], pair.at_s - clock.now_s())
            watch.look(pair)

        begun_s = clock.now_s()
        breath: TissueMoves | None = None
        with self._room.following(look):
            while clock.now_s() - begun_s < MOST_LOOK_ON_S:
                clock.wait(_GLANCES_S)
                tissue = watch.told().tissue
                if tissue and tissue[-1].breaths >= _WATCHED_BREATHS:
                    breath = tissue[-1]
                    break
                if not tissue and clock.now_s() - begun_s >= _GLANCE_S:
                    break
        if breath is None or breath.pause_at_s is None:
            self._rests = not watch.told().tissue
            return False
        # Without flashes, what comes last came now.
        by_s = ahead_s[0] if self.offset is None else self.offset.offset_s
        self.moves = structs.replace(
            breath,
            from_s=breath.from_s - by_s,
            until_s=breath.until_s - by_s,
            pause_at_s=breath.pause_at_s - by_s,
        )
        return True

    def tissue(self, watch: SearchWatch, *, rotation: CameraRotation | None) -> CameraTissue | None:
        """Return the tissue for a search; None if it was not seen to breathe.

        ``watch``: what follows it. ``rotation``: from the cameras to the probe; None: it is not known.
        """
        offset = self.offset or watch.clock()
        if self.moves is None or offset is None or not watch.follows:
            return None
        return CameraTissue(
            watch=watch,
            clock=self._room.rig.scanner.clock,
            offset=offset,
            breath=self.moves,
            rotation=rotation,
            waits=self.waits,
        )

    def learn(self, watch: SearchWatch, *, during_s: float) -> SearchScene | None:
        """Return what moved during a search of so many seconds, and know it from now on; None: nothing was followed."""
        if not watch.follows:
            return None
        shown = watch.clock()
        if shown is not None and (self.offset is None or shown.sigma_s < self.offset.sigma_s):
            self.offset = shown
        scene = watch.scene(self.offset)
        self.moves = newer_breath(self.moves, scene, during_s=during_s)
        return scene

    def seen(self, watch: SearchWatch, scene: SearchScene | None) -> CameraTissue | None:
        """Return the tissue as it was seen in a search that is over; None if it did not move, or no clock tells when.

        ``scene``: what moved then.
        """
        if scene is None or scene.tissue is None or self.offset is None:
            return None
        return CameraTissue(
            watch=SeenScene(moments=watch.moments),
            clock=self._room.rig.scanner.clock,
            offset=self.offset,
            breath=scene.tissue,
            rotation=None,
        )

    def taken_out_of(self, endoscope: SeenEndoscope | None, markers: Sequence[TakenMarker]) -> SeenEndoscope | None:
        """Return what one pair shows of the endoscope, less what may be the breath.

        ``markers``: those so far; where no breath is known, the tissue's motion at the last that has one counts.
        """
        seen = [marker.scene.tissue for marker in markers if marker.scene and marker.scene.tissue]
        breath = self.moves or (seen[-1] if seen else None)
        if breath is not None and isinstance(endoscope, EndoscopeMotion):
            return less_breath(endoscope, breath)
        return endoscope


def newer_breath(breath: TissueMoves | None, scene: SearchScene, *, during_s: float) -> TissueMoves | None:
    """Return the breath after a search: the one that was known, another one, or none.

    A search that saw a part of a breath does not replace what is known; one that saw none for longer than a breath ends
    it.
    """
    tissue = scene.tissue
    if not scene.is_known:
        return breath
    if tissue is None:
        over = breath is not None and during_s > _OVER_BREATHS * (breath.period_s or math.inf)
        return None if over else breath
    if tissue.period_s is None or scene.clock is None:
        return breath
    return tissue if breath is None or tissue.breaths >= min(breath.breaths, _ENOUGH_BREATHS) else breath
