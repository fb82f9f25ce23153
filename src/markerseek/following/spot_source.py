"""The laser spot as both cameras see it in the pulses of one look; the probe hears the same pulses."""

from __future__ import annotations

import math

from markerseek.core import AcquisitionError, StereoPair
from markerseek.following.target import Look, Target
from markerseek.registration import Room, SpotError, SpotFinder, spot_in
from markerseek.vision import lit_pairs

DARK_PAIRS = 3
"""Image pairs with the laser off that are subtracted."""

LATE_S = 0.5
"""Longest time for which light is awaited in the images, in seconds."""

ALONE_PX = 0.5
"""Standard deviation of a spot in a look with too few images to tell it."""

_POLL_S = 0.05


class SpotSource:
    """A `LitSource` of the cameras and the laser of a room."""

    name = "the laser spot"

    def __init__(self, room: Room) -> None:
        self._room = room
        self._finder = SpotFinder(room)
        self._dark: list[StereoPair] = []
        self._newest: StereoPair | None = None
        self._looked_s = -math.inf

    def look(self, pulses: int) -> Look:
        """Fire so many pulses, look at the images, and read the frame of the same pulses."""
        self._take_dark()
        scanner = self._room.rig.scanner
        began_s = scanner.clock.now_s()
        try:
            sample = scanner.look(pulses)
        except AcquisitionError:
            # The cameras have seen the pulses all the same.
            sample = None
        ended_s = scanner.clock.now_s()
        lit: list[StereoPair] = []
        pairs = list(self._room.images.newest())
        while not (lit := lit_pairs(pairs, self._dark)[0]) and scanner.clock.now_s() - ended_s < LATE_S:
            scanner.clock.wait(_POLL_S)
            pairs += self._room.images.newest()
        self._looked_s = scanner.clock.now_s()
        if not lit:
            return Look(target=None, reason="no light is seen in the images", sample=sample)
        self._newest = lit[-1]
        try:
            seen = self._finder.seen("spot", spot_in(lit, self._dark, alone_px=ALONE_PX))
        except SpotError as problem:
            return Look(target=None, reason=str(problem), sample=sample)
        target = Target(at_s=(began_s + ended_s) / 2, camera_m=seen.camera_m, covariance_m2=seen.camera_covariance_m2)
        return Look(target=target, sample=sample)

    def newest_dark(self) -> StereoPair | None:
        """Return the newest pair with the laser off; the same again until the next look."""
        return self._dark[-1] if self._dark else None

    def newest(self) -> StereoPair | None:
        """Return the newest pair, for those who look on: the last with light while it looks for the spot.

        None: there was none.
        """
        if self._room.rig.scanner.clock.now_s() - self._looked_s > LATE_S and (pairs := self._room.images.newest()):
            _, unlit = lit_pairs(pairs, self._dark)
            self._dark = [*self._dark, *unlit][-DARK_PAIRS:]
            self._newest = pairs[-1]
        return self._newest

    def _take_dark(self) -> None:
        """Keep the newest pairs with the laser off."""
        clock = self._room.rig.scanner.clock
        pairs = list(self._room.images.newest())
        ends_s = clock.now_s() + LATE_S
        while len(self._dark) + len(pairs) < DARK_PAIRS and clock.now_s() < ends_s:
            clock.wait(_POLL_S)
            pairs += self._room.images.newest()
        _, unlit = lit_pairs(pairs, self._dark)
        self._dark = [*self._dark, *unlit][-DARK_PAIRS:]
        if len(self._dark) < DARK_PAIRS:
            raise AcquisitionError(f"{self._room.images.name}: too few image pairs come; check that both cameras send")
