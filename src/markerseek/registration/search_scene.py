"""What the cameras saw move while a marker was searched: the tissue, the spot on it, and the endoscope."""

from __future__ import annotations

import msgspec
import numpy as np

from markerseek.core import counted
from markerseek.vision import ClockOffset, EndoscopeMoved, SceneMove, SpotSlid, TissueMoves

MIN_KNOWN = 0.5
"""Least share of the pairs from which the motion of the scene is known, so that the search counts as looked at."""


class SearchScene(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What the cameras saw of the scene during the search of a marker.

    Its times are those of the rig's clock if ``clock`` is known, else those of the cameras' clock.
    """

    pairs: int
    """Image pairs that were looked at."""
    known: float
    """Share of them from which the motion of the scene is known."""
    reason: str | None = None
    """Why it is not known from the others; None if it is known from all."""
    tissue: TissueMoves | None = None
    """How the tissue around the spot moves; None: it does not, or it is not known."""
    spot: SpotSlid | None = None
    """How the spot has slid on the tissue; None: it has not, as far as it was seen."""
    endoscope: tuple[EndoscopeMoved, ...] = ()
    """Moves of the endoscope during the search."""
    end: SceneMove | None = None
    """How the scene lies at the end of the search, where the tissue rests, compared with the pair before it; None: as
    then."""
    clock: ClockOffset | None = None
    """Offset of the cameras' clock; None: the laser's blinking has not shown it."""

    @property
    def is_known(self) -> bool:
        """Whether enough was seen to say what moved."""
        return self.pairs > 0 and self.known >= MIN_KNOWN

    @property
    def moved(self) -> bool:
        """Whether tissue, spot or endoscope were seen to move."""
        return self.tissue is not None or self.spot is not None or bool(self.endoscope)

    @property
    def said(self) -> str:
        """The same in a sentence."""
        moved = [
            *(f"the endoscope moved during the search, by {each.by}" for each in self.endoscope),
            *([] if self.tissue is None else [_of_tissue(self.tissue)]),
            *([] if self.spot is None else [_of_spot(self.spot)]),
        ]
        share = f"{self.known:.0%} of {counted(self.pairs, 'image pair')}"
        if not self.is_known:
            moved.append(f"motion during the search is not known: {self.reason}")
        elif not moved:
            return f"nothing moved during the search, as {share} show"
        return "; ".join(moved)

    @property
    def shown(self) -> dict[str, object]:
        """The same for other programs."""
        values: dict[str, object] = msgspec.to_builtins(self)
        return values | {"said": self.said}


def _of_tissue(tissue: TissueMoves) -> str:
    x, y, z = tissue.direction
    way = f"the tissue moves by ± {tissue.amplitude_mm:.2f} mm along ({x:.2f}, {y:.2f}, {z:.2f}) of the left camera"
    if tissue.period_s is None:
        return f"{way}, without a period that was seen"
    return f"{way}, every {tissue.period_s:.1f} s, and stays near its rest for {tissue.pause_s:.1f} s of these"


def _of_spot(slid: SpotSlid) -> str:
    return f"the spot slid on the tissue by {float(np.linalg.norm(slid.displacement_mm)):.2f} mm"
