"""What a session sees of its endoscope: whether it has moved since the markers so far, and whether that would be seen.

A session whose endoscope is held does not look.
"""

from __future__ import annotations

from collections.abc import Sequence

from markerseek.core import StereoPair
from markerseek.registration.endoscope_motion import EndoscopeNotKnown, EndoscopeWatch, SeenEndoscope
from markerseek.registration.record import SessionRecord
from markerseek.registration.spots import SpotError
from markerseek.registration.stations import station_names
from markerseek.registration.steps import TakenMarker
from markerseek.vision import NotKnown, SceneTexture

MOST_TEXTURELESS = 2
"""How often in a row images without texture are accepted where somebody may move the endoscope."""


class SessionEndoscope:
    """The endoscope of a session, as its images without the laser's light show it.

    Parameters
    ----------
    watch
        Compares its images with those of the markers; None: it is held.
    record
        Where the images of markers are kept; None: nowhere.
    markers
        Those that were taken before.
    """

    def __init__(
        self, watch: EndoscopeWatch | None, *, record: SessionRecord | None = None, markers: Sequence[TakenMarker] = ()
    ) -> None:
        self._watch = watch
        self._record = record
        self._textureless = 0
        """How often in a row the images had no texture."""
        if watch is not None:
            self._begin_at(watch, markers)

    def _begin_at(self, watch: EndoscopeWatch, markers: Sequence[TakenMarker]) -> None:
        """Compare with the markers that were taken before, one at each place where the endoscope stood."""
        scenes = {marker.name: marker.scene for marker in markers}
        for name in dict.fromkeys(station_names(markers).values()):
            scene = scenes[name]
            pair = None if self._record is None else self._record.kept_pair(name)
            watch.begin(name, pair, end=None if scene is None else scene.end)

    @property
    def is_held(self) -> bool:
        """Whether it cannot move."""
        return self._watch is None

    @property
    def is_blind(self) -> bool:
        """Whether the images had no texture twice in a row, so that a move of the endoscope would not be seen."""
        return self._textureless >= MOST_TEXTURELESS

    def require_texture(self, texture: SceneTexture | NotKnown) -> None:
        """Refuse images without texture, unless the endoscope is held."""
        if self._watch is None or isinstance(texture, SceneTexture):
            self._textureless = 0
            return
        self._textureless += 1
        raise SpotError(
            f"it would not be seen if the endoscope moved: {texture.reason}; light the tissue, focus on it, or say "
            "that the endoscope is held"
        )

    def look(self, pair: StereoPair, markers: Sequence[TakenMarker]) -> SeenEndoscope | None:
        """Return whether the endoscope has moved since the markers so far, or the tissue at this moment.

        None if nobody looks. ``pair``: without the laser's light.
        """
        if self._watch is None or not markers:
            return None
        return self._watch.look(pair, after=markers[-1].name)

    def keep(self, taken: TakenMarker, pair: StereoPair) -> None:
        """Keep the images of a marker if the endoscope stands where it did not stand before."""
        endoscope = taken.endoscope
        if self._watch is None or (endoscope is not None and endoscope.state == "at rest"):
            return
        self._watch.begin(taken.name, pair, end=None if taken.scene is None else taken.scene.end)
        if self._record is not None:
            self._record.keep_pair(taken.name, pair)


def require_no_comparison(endoscope: SeenEndoscope, again: TakenMarker | None, *, check: bool) -> None:
    """Refuse to compare a marker with what was measured where the endoscope stood before.

    ``again``: earlier marker that is measured again. ``check``: whether a spot checks the registration.
    """
    if again is not None and isinstance(endoscope, EndoscopeNotKnown):
        raise SpotError(f"{endoscope.said}, so that marker {again.name} cannot be compared with where it was")
    if check:
        raise SpotError(f"{endoscope.said}, so that there is no registration to be checked: light one more marker")
