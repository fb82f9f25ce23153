"""A `Tracker` as a policy that stops for each frame.

The probe looks at the two flanks of the curve in turn, ahead of and behind the angle where the marker is expected at
the time of the next frame. The times are those of the frames.
"""

from __future__ import annotations

from dataclasses import dataclass

from markerseek.core import Estimate, Found, Interval, NotFound, Sample, SearchError
from markerseek.search.tracking import Tracker

FLANK_SHARE = 0.3
"""How far beside the expected angle the probe looks, as a share of the curve's full width at half maximum."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackPoint:
    """What is known of a moving marker after one frame."""

    time_s: float
    """When the frame was taken, on the rig's clock."""
    probe_deg: float
    intensity: float
    """``probe_deg`` and ``intensity``: angle of the probe in degrees, and what was measured there."""
    angle_deg: float
    sigma_deg: float
    """``angle_deg`` and ``sigma_deg``: angle of the marker then, and its standard deviation."""
    speed_deg_s: float


def require_later(now_s: float, last_s: float) -> None:
    """Refuse a frame that is not later than the one before, by `SearchError`."""
    if not now_s > last_s:
        raise SearchError(f"a frame of {now_s:.3f} s came after one of {last_s:.3f} s; it must be later")


def found_at(mean_deg: float, *, sigma_deg: float) -> Found:
    """The marker at an angle, with the interval of a normal distribution."""
    half_deg = 1.96 * sigma_deg
    return Found(
        mean_deg=mean_deg,
        sigma_deg=sigma_deg,
        interval95_deg=Interval(low_deg=mean_deg - half_deg, high_deg=mean_deg + half_deg),
        interval_kind="posterior",
    )


def flank_deg(tracker: Tracker, *, after_s: float, side: float) -> float:
    """Angle in degrees of the flank on that side (1: above) of where the marker is expected so long after.

    At an end of the range only the other one can be looked at.
    """
    expected_deg, beside_deg = tracker.expected_deg(after_s), side * FLANK_SHARE * tracker.fwhm_deg
    if expected_deg + beside_deg not in tracker.limits:
        beside_deg = -beside_deg
    return tracker.limits.nearest(expected_deg + beside_deg)


class TrackingPolicy:
    """Follows a marker on a rig until a time, or until it is lost.

    Parameters
    ----------
    tracker
        Knows the angle at which a search found the marker.
    began_s
        Time on the rig's clock to which that angle belongs, in seconds.
    until_s
        No frame is asked for that would be taken after this time.
    period_s
        Time until the first frame in seconds, roughly; later ones are taken to come at the rate of those before.
    noise_sigma
        Standard deviation of the noise, where a frame does not state its own.
    """

    def __init__(
        self, tracker: Tracker, *, began_s: float, until_s: float, period_s: float, noise_sigma: float
    ) -> None:
        self._tracker, self._noise_sigma = tracker, noise_sigma
        self.began_s = began_s
        self._last_s, self._until_s = began_s, until_s
        # Of the frames on either flank: a stage may need longer to turn one way than the other.
        self._periods_s = [period_s, period_s]
        self._side = 1.0
        self.track: list[TrackPoint] = []

    @property
    def lost(self) -> bool:
        """Whether the marker is lost."""
        return self._tracker.lost

    def ask(self) -> float | None:
        """Angle of the next frame in degrees; None at the end, or once the marker is lost."""
        if self.lost or self._last_s + self._periods_s[-2] > self._until_s:
            return None
        return flank_deg(self._tracker, after_s=self._periods_s[-2], side=self._side)

    def tell(self, sample: Sample) -> None:
        """Take the next frame; a dark one says nothing of the marker.

        Raises
        ------
        SearchError
            If it has no frame, and so no time, or is not later than the one before.
        """
        if sample.dark:
            return
        if sample.frame is None:
            raise SearchError("a sample without a frame has no time: a moving marker cannot be followed with it")
        now_s = sample.frame.header.started_s
        require_later(now_s, self._last_s)
        self._periods_s.append(now_s - self._last_s)
        reading = sample.reading
        self._tracker.tell(
            sample.angle_deg,
            reading.intensity,
            after_s=self._periods_s[-1],
            noise_sigma=reading.noise_sigma or self._noise_sigma,
            cells=reading.cells or 1,
        )
        self._side, self._last_s = -self._side, now_s
        self.track.append(
            TrackPoint(
                time_s=now_s,
                probe_deg=sample.angle_deg,
                intensity=reading.intensity,
                angle_deg=self._tracker.mean_deg,
                sigma_deg=self._tracker.sigma_deg,
                speed_deg_s=self._tracker.speed_deg_s,
            )
        )

    def estimate(self) -> Estimate:
        """The angle at the last frame; `NotFound` once the marker is lost."""
        mean_deg, sigma_deg = self._tracker.mean_deg, self._tracker.sigma_deg
        if self.lost:
            return NotFound(mean_deg=mean_deg, reason=f"the marker was lost after {len(self.track)} frames")
        return found_at(mean_deg, sigma_deg=sigma_deg)
