"""Looks for the laser spot with both cameras, and whether it stands still."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from msgspec import structs

from markerseek.core import ConfigError, Side, StereoPair, counted
from markerseek.registration.choice import SeenMarker
from markerseek.registration.room import Room
from markerseek.registration.shared_errors import seen_point
from markerseek.registration.steps import Spot
from markerseek.vision import LaserSpot, find_spot, lit_pairs

SPOT_PAIRS = 8
"""Image pairs with light by which a spot is measured."""

DARK_PAIRS = 3
"""Image pairs with the laser off that are subtracted."""

LEAST_TRAINS = 2
"""Fewest trains of pulses of a look: light that comes once may be a highlight that moves there."""

LOOK_S = 3.0
"""Longest time in which pairs with the laser off must come, and longest time for which it fires, in seconds."""

LATE_S = 0.5
"""Delay of the light in the images from which they are late, in seconds."""

MOST_LATE_S = 3.0
"""Longest delay that is awaited, in seconds."""

MOVED_SIGMAS = 4.0
MOVED_PX = 0.2
"""Standard deviations, and pixels more, by which a spot may seem to move during its search."""

SIDES: tuple[Side, Side] = ("left", "right")
"""The cameras."""

_POLL_S = 0.1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Looked:
    """What the cameras showed."""

    spot: Spot
    dark: Sequence[StereoPair] = ()
    lit: Sequence[StereoPair] = ()
    flashes_s: Sequence[float] = ()
    """Times of the flashes meanwhile, on the rig's clock."""


class SpotError(Exception):
    """The images show no spot that can be measured, or the spot moved; a person is told, and lights it again.

    ``places``: where the images show what is wrong, by the camera.
    """

    def __init__(self, reason: str, *, places: Mapping[Side, Sequence[tuple[float, float]]] | None = None) -> None:
        super().__init__(reason)
        self.places = places or {}

    @classmethod
    def at(cls, spot: Spot, reason: str) -> Self:
        """Return the refusal of a spot that both cameras see."""
        return cls(reason, places={"left": [spot.left_px], "right": [spot.right_px]})


class SpotFinder:
    """Finds the spot in a room.

    ``show``: takes the newest pair of each look, for those who look on.
    """

    def __init__(self, room: Room, *, show: Callable[[StereoPair], None] = lambda _pair: None) -> None:
        self._room = room
        self._show = show
        # How long the light took to appear in the images, where they are late; None: it was not seen yet.
        self._late_s: float | None = None
        self._flashes_s: list[float] = []

    def look(self) -> Looked:
        """Look for the spot, with the laser on and off; `SpotError` if there is none."""
        self._room.arm()
        self._room.images.newest()
        dark = self.dark()
        self._flashes_s.clear()
        lit, unlit = self._lit(dark)
        self._show((lit or dark)[-1])
        # Highlights move with the tissue: those between the flashes are where they are in lit pairs, or beside.
        dark = [*dark, *unlit]
        return Looked(spot=self._measured(lit, dark), dark=dark, lit=lit, flashes_s=tuple(self._flashes_s))

    def dark(self) -> list[StereoPair]:
        """Return the pairs with the laser off; `SpotError` if too few come."""
        late_s = self._late_s or 0.0
        # Late images still show the light of before.
        if late_s:
            self._room.rig.scanner.clock.wait(late_s)
            self._room.images.newest()
        for dark in self._coming(LOOK_S):
            if len(dark) >= DARK_PAIRS:
                return dark
        raise SpotError(
            f"{self._room.images.name}: {counted(len(dark), 'image pair')} came within {LOOK_S:g} s, {DARK_PAIRS} are "
            "needed; check that both cameras send"
        )

    def _lit(self, dark: Sequence[StereoPair]) -> tuple[list[StereoPair], list[StereoPair]]:
        """Return the pairs that show light, and those between them.

        Light comes while the laser fires or, in late images, after that.
        """
        scanner = self._room.rig.scanner
        late_s = self._late_s
        began_s = scanner.clock.now_s()
        lit: list[StereoPair] = []
        unlit: list[StereoPair] = []
        trains = 0
        for pairs in self._coming(LOOK_S + (MOST_LATE_S if late_s is None else late_s)):
            came_s = scanner.clock.now_s() - began_s
            if came_s < LOOK_S and (len(lit) < SPOT_PAIRS or trains < LEAST_TRAINS):
                self._fire()
                trains += 1
            lit, unlit = lit_pairs(pairs, dark)
            if lit and late_s is None:
                late_s = lit[0].at_s - began_s
                late_s = late_s if late_s > LATE_S else 0.0
            ends_dark = bool(lit and unlit) and unlit[-1].at_s > lit[-1].at_s
            enough = len(lit) >= SPOT_PAIRS and trains >= LEAST_TRAINS and ends_dark
            if enough or (late_s is not None and came_s >= LOOK_S + late_s):
                break
        self._late_s = late_s
        return lit, unlit

    def _fire(self) -> None:
        """Fire, and note when: the pulses of a train come evenly."""
        clock = self._room.rig.scanner.clock
        begun_s = clock.now_s()
        pulses = self._room.light()
        self._flashes_s.extend(np.linspace(begun_s, clock.now_s(), pulses + 1)[:-1].tolist())

    def _coming(self, within_s: float) -> Iterator[list[StereoPair]]:
        """Yield the newest pairs, again and again until the time is over."""
        clock = self._room.rig.scanner.clock
        pairs = list[StereoPair]()
        ends_s = clock.now_s() + within_s
        yield pairs
        while clock.now_s() < ends_s:
            clock.wait(_POLL_S)
            pairs = [*pairs, *self._room.images.newest()][-4 * SPOT_PAIRS :]
            yield pairs

    def _measured(self, lit: Sequence[StereoPair], dark: Sequence[StereoPair]) -> Spot:
        """Return the spot in pairs with light; `SpotError` if there is none."""
        if len(lit) < DARK_PAIRS:
            raise SpotError(self._no_light(dark))
        return structs.replace(spot_in(lit, dark), late_s=self._late_s or None)

    def _no_light(self, dark: Sequence[StereoPair]) -> str:
        """Say that no light is seen, and what is lit all the time."""
        after_s = MOST_LATE_S if self._late_s is None else self._late_s
        after = f" and {after_s:.1f} s after that" if after_s else ""
        always = [
            f"the bright spot at ({answer.x_px:.0f}, {answer.y_px:.0f}) px of the {side} image is lit all the time: "
            "if it is an aiming beam, switch it off"
            for side in SIDES
            if isinstance(answer := find_spot([getattr(pair, side) for pair in dark]), LaserSpot)
        ]
        cures = [
            "point the fibre at tissue in view of both cameras, and check that they do not block its wavelength",
            *always[:1],
        ]
        return f"no light is seen in {self._room.images.name} while the laser fires{after}; {'; '.join(cures)}"

    def seen(self, name: str, spot: Spot) -> SeenMarker:
        """Return the spot in space; `SpotError` if both images do not show one place."""
        stereo = self._room.stereo
        try:
            camera_m, covariance_m2, shared_m = seen_point(
                np.array(spot.left_px),
                np.array(spot.right_px),
                stereo.cameras,
                spot_px=spot.sigma_px,
                calibration_px=stereo.calibration_sigma_px,
            )
        except ConfigError as problem:
            reason = f"{str(problem).removeprefix('point 1: ')}; the images come from {self._room.images.name}"
            raise SpotError.at(spot, reason) from problem
        return SeenMarker(
            name=name,
            candidates=(),
            camera_m=camera_m,
            camera_covariance_m2=covariance_m2,
            camera_shared_m=shared_m,
        )

    def require_still(self, looked: Looked, later: Sequence[StereoPair]) -> None:
        """Refuse a spot that has moved during its search; ``later``: the last pairs of the search."""
        try:
            after = self._after(looked, later)
        except SpotError as problem:
            raise SpotError(f"the spot was not seen after its search: {problem}", places=problem.places) from problem
        sigma_px = math.hypot(looked.spot.sigma_px, after.sigma_px)
        for side in SIDES:
            apart = np.subtract(getattr(looked.spot, f"{side}_px"), getattr(after, f"{side}_px"))
            moved_px = float(np.linalg.norm(apart))
            if not moved_px <= MOVED_SIGMAS * sigma_px + MOVED_PX:
                raise SpotError.at(
                    after,
                    f"the spot moved by {moved_px:.1f} px in the {side} image during its search, which it is known to "
                    f"within {sigma_px:.2f} px; hold laser, tissue and camera still",
                )

    def _after(self, looked: Looked, later: Sequence[StereoPair]) -> Spot:
        """Return the spot after its search, by a look of its own if the last pairs do not show it."""
        try:
            return self._measured(lit_pairs(later, looked.dark)[0], looked.dark)
        except SpotError:
            return self.look().spot


def spot_in(lit: Sequence[StereoPair], dark: Sequence[StereoPair], *, alone_px: float | None = None) -> Spot:
    """Return the spot in pairs with light; `SpotError` if there is none.

    ``alone_px``: its standard deviation where too few images tell it; None: they show no spot.
    """
    places = []
    sigma_px = 0.0
    for side in SIDES:
        answer = find_spot([getattr(pair, side) for pair in lit], dark=[getattr(pair, side) for pair in dark])
        if not isinstance(answer, LaserSpot):
            raise SpotError(f"{side} camera: {answer.reason}", places={side: answer.places_px})
        place = (answer.x_px, answer.y_px)
        side_px = alone_px if answer.sigma_px is None else answer.sigma_px
        if side_px is None:
            raise SpotError(f"{side} camera: too few images show the spot", places={side: [place]})
        places.append(place)
        sigma_px = max(sigma_px, side_px)
    return Spot(left_px=places[0], right_px=places[1], sigma_px=sigma_px)
