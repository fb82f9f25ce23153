"""What the cameras have seen move during a search so far, for those who look on; the session itself keeps its summary.

A session writes it into its folder again and again, as it does with the newest images.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import msgspec
import numpy as np
from msgspec import structs

from markerseek.core import ConfigError, Float64, RecordError, Vector, as_vector
from markerseek.files import MIB, read_input, replace_file
from markerseek.vision import ClockOffset, Moment, TissueMoves

MOTION_FILE = "motion.json"
"""Name of the file in the folder of a session."""

SPAN_S = 60.0
"""Time over which motion is handed on, in seconds: the last minute."""


class WatchedMotion(msgspec.Struct, frozen=True, kw_only=True):
    """Displacements since the begin of a search, in the left camera's frame and on the clock of the cameras."""

    name: str
    """Name of the marker that is searched."""
    tissue_s: list[float]
    tissue_mm: list[Vector]
    """``tissue_s``, ``tissue_mm``: times, and displacements of the tissue around the spot, or of the whole scene there
    where too little of that tissue has texture."""
    spot_s: list[float]
    spot_mm: list[Vector]
    """``spot_s``, ``spot_mm``: times, and displacements of the spot."""
    unknown_s: list[float]
    """Times of image pairs that do not show how the tissue lies."""
    breath: TissueMoves | None = None
    """How the tissue breathes, as this search or the last one has shown it; None: it does not, or it is not known."""

    @classmethod
    def of(
        cls,
        name: str,
        moments: Sequence[Moment],
        *,
        spot_m: Float64[np.ndarray, " 3"],
        breath: TissueMoves | None,
    ) -> WatchedMotion:
        """Return the last minute of what was seen; ``spot_m``: place of the spot before the search."""
        last_s = max((moment.at_s for moment in moments), default=0.0)
        recent = sorted((each for each in moments if each.at_s >= last_s - SPAN_S), key=lambda each: each.at_s)
        tissue = [(each.at_s, moved_m) for each in recent if (moved_m := _moved_m(each, spot_m)) is not None]
        spot = [(each.at_s, each.spot.value_m - spot_m) for each in recent if each.spot is not None]
        return cls(
            name=name,
            tissue_s=[float(at_s) for at_s, _ in tissue],
            tissue_mm=[as_vector(1e3 * value_m) for _, value_m in tissue],
            spot_s=[float(at_s) for at_s, _ in spot],
            spot_mm=[as_vector(1e3 * value_m) for _, value_m in spot],
            unknown_s=[float(each.at_s) for each in recent if _moved_m(each, spot_m) is None and each.spot is None],
            breath=breath,
        )

    @property
    def pauses(self) -> list[tuple[float, float]]:
        """Begins and ends of the pauses of the breath, from the first time to the last."""
        times_s = [*self.tissue_s, *self.spot_s, *self.unknown_s]
        breath = self.breath
        if not times_s or breath is None or breath.period_s is None or breath.pause_at_s is None:
            return []
        first = np.ceil((min(times_s) - breath.pause_at_s - breath.pause_s) / breath.period_s)
        last = np.floor((max(times_s) - breath.pause_at_s) / breath.period_s)
        begins_s = [breath.pause_at_s + float(number) * breath.period_s for number in np.arange(first, last + 1)]
        return [(begin_s, begin_s + breath.pause_s) for begin_s in begins_s]


def _moved_m(moment: Moment, spot_m: Float64[np.ndarray, " 3"]) -> Float64[np.ndarray, " 3"] | None:
    """Return the displacement of the tissue at the spot; None if the pair does not show it."""
    if moment.tissue is not None:
        return moment.tissue.value_m
    return None if moment.scene is None else moment.scene.displacement_m(spot_m[None])[0]


def on_cameras_clock(breath: TissueMoves | None, offset: ClockOffset | None) -> TissueMoves | None:
    """Return how the tissue breathes on the clock of the cameras, from the rig's; None if that is not known."""
    if breath is None or offset is None or breath.pause_at_s is None:
        return None
    return structs.replace(breath, pause_at_s=breath.pause_at_s + offset.offset_s)


def show_motion(folder: Path, motion: WatchedMotion) -> None:
    """Write what moves into the folder of a session, for those who look on; an error of the disk is none of theirs."""
    try:
        with replace_file(folder / MOTION_FILE) as part:
            part.write_bytes(msgspec.json.encode(motion))
    except OSError:
        return


def read_motion(folder: Path) -> WatchedMotion | None:
    """Return what moves in a session; None if nobody has looked, or it cannot be read."""
    try:
        return msgspec.json.decode(read_input(folder / MOTION_FILE, most_bytes=MIB), type=WatchedMotion)
    except (OSError, RecordError, ConfigError, msgspec.MsgspecError):
        return None
