"""Whether the endoscope has moved between two markers, from image pairs without the laser's light.

The cameras see how the scene lies in their own frame. If it lies elsewhere than at an earlier marker, the endoscope has
moved against the tissue; which of the two moved in the room cannot be told from two pairs.
"""

from __future__ import annotations

from typing import Literal, TypeAlias

import msgspec
import numpy as np
from msgspec import structs

from markerseek.core import StereoPair
from markerseek.geometry import StereoCameras
from markerseek.vision import NotKnown, SceneFollower, SceneMove, SceneSeen, SceneTexture, TissueMoves, scene_texture


class EndoscopeMotion(SceneMove, frozen=True, kw_only=True, tag="known"):
    """How the scene lies in the camera's frame, compared with an earlier marker."""

    since: str
    """Name of the marker with whose images it was compared."""
    after: str
    """Name of the last marker before."""

    def until(self, end: SceneMove) -> EndoscopeMotion:
        """Return the motion up to the end of a search; ``end``: how the scene lay there, compared with its begin."""
        return EndoscopeMotion(**structs.asdict(self.then(end)), since=self.since, after=self.after)

    @property
    def state(self) -> Literal["at rest", "moved"]:
        """Whether the endoscope stands where it stood, in two words."""
        return "moved" if self.is_move else "at rest"

    @property
    def said(self) -> str:
        """The motion in a sentence."""
        by = f"{self.by} against the tissue"
        if self.is_move:
            return f"the endoscope has moved after marker {self.after}, by {by}"
        return f"the endoscope stands where it stood at marker {self.since}: moved by {by}"

    @property
    def shown(self) -> dict[str, object]:
        """The motion for other programs."""
        values: dict[str, object] = msgspec.to_builtins(self)
        return values | {"state": self.state, "said": self.said}


def less_breath(motion: EndoscopeMotion, tissue: TissueMoves) -> EndoscopeMotion:
    """Return a motion that one pair shows, less what of it may be the breath of the tissue at that moment."""
    swing_mm = np.array(tissue.swing_mm)
    displacement_mm = np.array(motion.displacement_mm)
    share = np.clip(displacement_mm @ swing_mm / (swing_mm @ swing_mm), 0.0, 1.0)
    x, y, z = (displacement_mm - share * swing_mm).tolist()
    covariance = np.array(motion.covariance)
    # The tissue may be anywhere on its way.
    covariance[3:, 3:] += np.outer(swing_mm, swing_mm) / 12
    return structs.replace(
        motion, displacement_mm=(x, y, z), covariance=tuple(tuple(row) for row in covariance.tolist())
    )


class EndoscopeNotKnown(msgspec.Struct, frozen=True, kw_only=True, tag="not-known"):
    """The images do not show whether the endoscope has moved."""

    after: str
    """Name of the last marker before."""
    reason: str
    """Why, with the numbers."""

    @property
    def state(self) -> Literal["not known"]:
        """The same in two words."""
        return "not known"

    @property
    def said(self) -> str:
        """The same in a sentence."""
        return f"it is not known whether the endoscope has moved after marker {self.after}: {self.reason}"

    @property
    def shown(self) -> dict[str, object]:
        """The same for other programs."""
        values: dict[str, object] = msgspec.to_builtins(self)
        return values | {"state": self.state, "said": self.said}


SeenEndoscope: TypeAlias = EndoscopeMotion | EndoscopeNotKnown
"""What the cameras show of the endoscope's own motion."""


class EndoscopeWatch:
    """Compares image pairs with those of earlier markers.

    Each pair is compared with the first pair of each place where the endoscope has stood, the latest place first, so
    that small errors do not add up, and a place to which the endoscope comes back is recognised.
    """

    def __init__(self, cameras: StereoCameras) -> None:
        self._cameras = cameras
        # The same session sees the same motion: only samples of patches are drawn.
        self._rng = np.random.default_rng(0)
        self._places: dict[str, SceneFollower | NotKnown] = {}
        self._ends: dict[str, SceneMove | None] = {}

    def begin(self, name: str, pair: StereoPair | None, *, end: SceneMove | None = None) -> None:
        """Note a pair as that of a new place of the endoscope.

        ``name``: of the marker. ``pair``: without the laser's light; None: it was not kept. ``end``: how the scene lay
        at the end of its search, compared with this pair; None: as then.
        """
        self._ends[name] = end
        texture: SceneTexture | NotKnown
        if pair is None:
            texture = NotKnown(at_s=0.0, cause="hidden", reason="its images without light were not kept")
        else:
            texture = scene_texture(pair, self._cameras)
        self._places[name] = SceneFollower(texture, rng=self._rng) if isinstance(texture, SceneTexture) else texture

    def look(self, pair: StereoPair, *, after: str) -> SeenEndoscope | None:
        """Return how the endoscope has moved; None if there was no place before.

        ``pair``: without the laser's light. ``after``: name of the last marker.
        """
        reasons = []
        for name, place in reversed(self._places.items()):
            if isinstance(place, NotKnown):
                reasons.append(f"at marker {name}, {place.reason}")
                continue
            seen = place.follow(pair)
            motion = seen.motion if isinstance(seen, SceneSeen) else seen
            if not isinstance(motion, NotKnown):
                end = self._ends[name]
                move = SceneMove.of(motion) if end is None else end.back().then(SceneMove.of(motion))
                return EndoscopeMotion(**structs.asdict(move), since=name, after=after)
            reasons.append(motion.reason)
        return EndoscopeNotKnown(after=after, reason=reasons[0]) if reasons else None
