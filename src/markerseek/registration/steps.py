"""The steps of a registration session, as data for other programs.

All steps except `Searching` are recorded; what they say together is a `markerseek.registration.SessionView`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import msgspec
import numpy as np
from msgspec import structs

from markerseek._version import __version__
from markerseek.core import ConfigError, MarkerCandidate, require_range
from markerseek.records.journal import RunView
from markerseek.registration.choice import Choice, SeenMarker
from markerseek.registration.endoscope_motion import SeenEndoscope
from markerseek.registration.poses import Place, Prediction
from markerseek.registration.report import SpotCheck
from markerseek.registration.search_scene import SearchScene

Numbers: TypeAlias = list[list[float]]
"""A matrix, row by row."""

_FARTHEST_M = 10.0
"""Largest distance of a spot or marker from the origin of its frame, in metres."""

_FINEST_M = 1e-9
"""Least standard deviation of such a place, in metres."""


class Spot(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A laser spot in both images: its pixels and their standard deviation."""

    left_px: tuple[float, float]
    right_px: tuple[float, float]
    sigma_px: float
    late_s: float | None = None
    """Time from the first pulse to the first image that shows light, in seconds; None: too short to matter."""


class Begun(msgspec.Struct, frozen=True, kw_only=True, tag="begun"):
    """What a session registers; it must be the same when the session is continued."""

    rig: str
    """Fingerprint of the rig."""
    description: str
    """The rig in words."""
    simulated: bool
    images: str
    """Source of the images, in words."""
    cameras: str
    """Calibration of the cameras, as text."""
    size_px: tuple[int, int]
    """Width and height of the left image."""
    goal_m: float
    """Expected TRE at which the session ends."""
    target_trus_m: tuple[float, float, float] | None
    """Point of the expected error, in the TRUS frame; None: `TARGET_DEPTH_M` under the middle of the points."""
    begun: str
    """When it began, UTC."""
    seed: int | None = None
    stage_since: str = ""
    """Since when its stage had always stood where it was left, UTC; empty: nobody kept it."""
    version: str = __version__


class Continued(msgspec.Struct, frozen=True, kw_only=True, tag="continued"):
    """The session is continued with another goal or target than before."""

    goal_m: float
    target_trus_m: tuple[float, float, float] | None
    """``goal_m`` and ``target_trus_m``: as of `Begun`, from here on."""
    said: str
    """What is different, in a sentence."""


class Waiting(msgspec.Struct, frozen=True, kw_only=True, tag="waiting"):
    """The session waits for a spot."""

    name: str
    """Name that the next marker will have."""
    place: Place | None
    """Place at which a spot reduces the error most; None: anywhere in view and in reach."""
    said: str
    """What the person has to do, in a sentence."""
    dark: bool = False
    """Whether the laser is dark until the person says that the spot is set."""


class SpotRefused(msgspec.Struct, frozen=True, kw_only=True, tag="spot-refused"):
    """The images show no spot that can be measured, or the spot moved; the session looks for it again."""

    name: str
    reason: str
    pulses: int | None = None
    """Pulses for the cameras since the person said that the spot is set; None: the laser fires while it waits."""
    left_px: list[tuple[float, float]] = []
    right_px: list[tuple[float, float]] = []
    """``left_px`` and ``right_px``: where the images show what is wrong; empty if they show nothing."""


class SpotSeen(msgspec.Struct, frozen=True, kw_only=True, tag="spot"):
    """Both cameras see the spot, and its search begins."""

    name: str
    spot: Spot
    camera_m: tuple[float, float, float]
    """The spot in the frame of the left camera."""
    prediction: Prediction | None
    """Prediction of its marker from the markers so far; None if they allow none."""
    journal: str | None
    """Name of the search's journal in the folder of the session."""
    pulses: int | None = None
    """As of `SpotRefused`."""
    endoscope: SeenEndoscope | None = None
    """Whether the endoscope has moved since the markers before; None: nobody looked, or there are none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Searching:
    """The search of a marker has gone on by one event."""

    name: str
    view: RunView
    """The search so far."""


class TakenMarker(msgspec.Struct, frozen=True, kw_only=True, tag="marker"):
    """A marker that was searched while its spot stood still."""

    name: str
    spot: Spot
    camera_m: list[float]
    """The spot in the frame of the left camera."""
    camera_covariance_m2: Numbers
    """Covariance of the spot's position."""
    camera_shared_m: Numbers
    """Displacements of the spot by the errors that all spots share."""
    answer: str
    """Answer of the search."""
    reason: str | None
    """Reason that the search gives for its answer."""
    candidates: list[MarkerCandidate]
    """Sources that may be the marker, the most probable first; empty if the search found nothing."""
    acquisitions: int
    rig_s: float
    """Time on the rig's clock from the first look at the spot to the answer, without waiting for a person."""
    prior: str | None
    """Prior over its angle from the earlier markers, as text; None if there was no prior."""
    journal: str | None
    at: str
    """When it was taken, UTC."""
    again: str | None = None
    """Name of the earlier marker that was measured again; None for a new marker."""
    check: bool = False
    """Whether it takes no part in the registration, and checks it."""
    endoscope: SeenEndoscope | None = None
    """As of `SpotSeen`, at the end of the search and where the tissue rests: so is ``camera_m``."""
    scene: SearchScene | None = None
    """What the cameras saw move during the search; None: nobody looked."""

    def __post_init__(self) -> None:
        # A record is checked too: its check sums say that it is not damaged, and not that its numbers are possible.
        _require_numbers("camera_m", self.camera_m, shape=(3,), most=_FARTHEST_M)
        _require_numbers("camera_covariance_m2", self.camera_covariance_m2, shape=(3, 3), most=_FARTHEST_M**2)
        _require_numbers("camera_shared_m", self.camera_shared_m, shape=(3, None), most=_FARTHEST_M)
        for candidate in self.candidates:
            position = candidate.position
            _require_numbers("the position of a candidate", position.position_m, shape=(3,), most=_FARTHEST_M)
            _require_numbers("sigma_m of a candidate", position.sigma_m, shape=(3,), most=_FARTHEST_M, least=_FINEST_M)
            require_range("the probability of a candidate", candidate.probability, low=0, high=1)
            require_range("the angle of a candidate", candidate.angle_deg, low=-360, high=360, unit="deg")
        # No variance is negative; that of a marker with candidates is no smaller than a measurement can have.
        axes_m2 = np.linalg.eigvalsh(np.array(self.camera_covariance_m2))
        if axes_m2[0] < (_FINEST_M**2 if self.candidates else 0.0):
            raise ConfigError(f"camera_covariance_m2 is {self.camera_covariance_m2}, which is no covariance of a spot")

    @property
    def seen(self) -> SeenMarker:
        """The marker and its spot."""
        return SeenMarker(
            name=self.name,
            candidates=tuple(self.candidates),
            camera_m=np.array(self.camera_m),
            camera_covariance_m2=np.array(self.camera_covariance_m2),
            camera_shared_m=np.array(self.camera_shared_m),
        )


class CorrectedMarker(msgspec.Struct, frozen=True, kw_only=True, tag="marker-corrected"):
    """The search of an earlier marker was answered again: more is known of how the tissue moved meanwhile."""

    name: str
    answer: str
    reason: str | None
    candidates: list[MarkerCandidate]
    """``answer``, ``reason`` and ``candidates``: as of `TakenMarker`, with the displacements taken out."""
    said: str
    """The change in a sentence."""

    def of(self, marker: TakenMarker) -> TakenMarker:
        """Return the marker with this answer."""
        return structs.replace(marker, answer=self.answer, reason=self.reason, candidates=self.candidates)


def _require_numbers(
    name: str, values: Sequence[object], *, shape: tuple[int | None, ...], most: float, least: float = -math.inf
) -> None:
    """Refuse numbers of another shape (None: any length), above ``most`` in magnitude, or below ``least``."""
    try:
        numbers = np.array(values, dtype=float)
    except ValueError:
        numbers = np.array(math.nan)
    fits = numbers.ndim == len(shape) and all(
        want in (None, has) for want, has in zip(shape, numbers.shape, strict=True)
    )
    if not (fits and (np.abs(numbers) <= most).all() and (numbers >= least).all()):
        low = f", from {least:g}" if math.isfinite(least) else ""
        raise ConfigError(
            f"{name} is {str(values)[:80]}, {' x '.join(str(each or 'n') for each in shape)} numbers within ± {most:g}"
            f"{low} are expected"
        )


class Registered(Choice, frozen=True, kw_only=True, tag="registered"):
    """The registration from all markers so far, computed after each marker."""

    place: Place | None
    """Place at which the next spot reduces the error most, with the TRE expected after it."""
    done: bool
    """Whether the session ends here."""
    said: str
    """The state in a sentence."""
    lost: tuple[str, ...] = ()
    """Markers that do not count: the endoscope has moved since, or may have, and it is not known by how much."""
    endoscope: SeenEndoscope | None = None
    """How the endoscope has moved after the last marker; None: it has not, as far as it was seen."""


class MovedMarker(msgspec.Struct, frozen=True, kw_only=True, tag="again"):
    """A marker was measured again at the end."""

    name: str
    moved_m: float
    """Distance that the marker has moved since its first measurement, relative to the camera."""
    sigma_m: float
    """Standard deviation of that distance."""
    moved: bool
    """Whether the distance is larger than its standard deviation explains; the registration is then not valid."""
    said: str


class SpotChecked(msgspec.Struct, frozen=True, kw_only=True, tag="check"):
    """The registration was compared with a spot that takes no part in it."""

    check: SpotCheck
    chosen: dict[str, int]
    """As of `Choice`: the registration that was checked."""

    @property
    def said(self) -> str:
        """The check in a sentence, with its name."""
        return f"{self.check.name}: {self.check.said}"


class Ended(msgspec.Struct, frozen=True, kw_only=True, tag="ended"):
    """The session is over."""

    registered: bool
    said: str
    rig_s: float
    """Time of the rig for all markers."""


RecordedStep: TypeAlias = (
    Begun
    | Continued
    | Waiting
    | SpotRefused
    | SpotSeen
    | TakenMarker
    | CorrectedMarker
    | Registered
    | MovedMarker
    | SpotChecked
    | Ended
)
Step: TypeAlias = RecordedStep | Searching
"""Any step of a session."""
