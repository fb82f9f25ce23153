"""The policy `SweepPosterior`: turns the probe over the range in light, and stops it only where that is not enough.

1. It sweeps from where the probe is to the nearer end of the range, and from there to the other end, whatever it sees:
   the last degrees cost tenths of a second, and a louder source may be there. Where there is only one source, the
   sweep is over once the marker is known and both of its flanks are swept. Where the frames of a sweep are read at its
   end, a second sweep would cost a second read-out: the probe turns to the nearer end without light. While they are
   read it turns to the middle of the range, which is nearer to most markers.
2. Where the centre of the curve is not known well enough by then, it sweeps back over the flanks, and ends that sweep
   once it is. That also separates the delay between pulse and angle from the angle, for it shifts the two directions
   against one another. Where another source may still hide, it sweeps back over the whole range.
3. What is still missing is measured at rest, as `Posterior` does: another look at a source, more precision. Where
   nothing was detected, a search at rest begins, because the mean of some pulses shows what a single one does not.

The light of a sweep goes out before its end. A marker there shows one flank alone, and where its curve ends is only
assumed. So the end of the range is measured at rest where the curve does not fall to half its height in the light.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from markerseek.core import Estimate, Found, Interval, Sample, Sweep, Unsure
from markerseek.search.policy import check_sample
from markerseek.search.posterior.next_angle import Belief
from markerseek.search.posterior.policy import Posterior
from markerseek.search.posterior.survey import STATED

JUDGED_EVERY_S = 0.1
"""Time between two judgements during a sweep, at its speed: no laser is too fast for them then."""

SWEPT_SIGMA_DEG = 0.3
"""Standard deviation at which a search by sweeps ends, in degrees, unless the tolerance needs less: from 0.2 to 0.3 it
would take six acquisitions at rest, longer than the sweep took."""

LEAST_SPACING_DEG = 0.1
"""Least angle between two pulses: a twentieth of the narrowest curve."""

AT_END_DEG, AT_END = 1.0, 0.05
"""Distance from an end of the range within which a sweep to it is not worth its light; and of the range at most."""

MARGIN = 0.8
"""Share of the probability that is stated of another source up to which a sweep back ends: the confirmation changes it
by some per cent, and must not begin the search again."""

LIT_FLANK = 0.5
"""Distance from the centre up to which its flank must have been in the light, over the full width at half maximum."""

FLANK = 0.8
"""Distance from the centre up to which its flank is swept, over the full width at half maximum."""


class SweepPosterior:
    """Searches by sweeps and the posterior over the marker's angle; a `SweepingPolicy` that confirms its answer.

    Parameters
    ----------
    make
        Makes the `Posterior` that judges the samples, and searches at rest.
    limits
        Range to search.
    speed_deg_s
        Speed of the sweeps.
    start_deg
        Present angle of the probe, in degrees; None: the low end.
    from_end
        Whether the first sweep begins at the nearer end, to which the probe turns without light.
    """

    name = "posterior"

    def __init__(
        self,
        make: Callable[[], Posterior],
        *,
        limits: Interval,
        speed_deg_s: float,
        start_deg: float | None = None,
        from_end: bool = False,
    ) -> None:
        self._make = make
        self._posterior = make()
        self._limits = limits
        self._speed_deg_s = speed_deg_s
        self._dark: list[Sample] = []
        ends_deg = [limits.low_deg, limits.high_deg]
        if start_deg is not None and start_deg > limits.centre_deg:
            ends_deg.reverse()
        self._from_deg: float | None = None
        self._wait_deg = limits.centre_deg if from_end else None
        at_end_deg = min(AT_END_DEG, AT_END * (limits.high_deg - limits.low_deg))
        if start_deg is None or abs(start_deg - ends_deg[0]) <= at_end_deg:
            ends_deg = ends_deg[1:]
        elif from_end:
            self._from_deg, *ends_deg = ends_deg
        self._to_deg = ends_deg
        self._swept_to_deg: float | None = None
        """End at which the probe is after the sweep over the range, until it is decided what follows."""
        self._lit_deg: list[float] = []
        self._ends_deg: list[float] = []
        """Ends of the range that were asked for at rest."""
        self._swept_back = False
        self._judged_deg: float | None = None
        self._next: tuple[float | Sweep | None] | None = None

    def ask(self) -> float | Sweep | None:
        """Next sweep, or next angle in degrees; None at the end of the search."""
        if self._next is None:
            self._next = (self._chosen(),)
        return self._next[0]

    def _chosen(self) -> float | Sweep | None:
        if self._swept_to_deg is not None:
            dark_deg = self._dark_end_deg()
            if dark_deg is not None:
                self._ends_deg.append(dark_deg)
                # A sweep back begins where the probe then is.
                self._swept_to_deg = dark_deg
                return dark_deg
            self._to_deg, self._swept_to_deg = self._after_range(self._swept_to_deg), None
        return self.sweeps[0] if self._to_deg else self._posterior.ask()

    def tell(self, sample: Sample) -> None:
        """Take one sample: a dark one, one of a sweep, or one at rest.

        Raises
        ------
        SearchError
            If the sample is not usable (`check_sample`), or the laser was on and the search is over.
        """
        if sample.dark:
            check_sample(sample)
            # For a search at rest only: the noise of a mean of pulses is not that of one.
            self._dark.append(sample)
        elif sample.sweep is not None:
            self._posterior.tell_swept(sample)
            self._lit_deg.append(sample.angle_deg)
            self._judge(sample)
        else:
            # The posterior did not ask for an end.
            tell = self._posterior.tell if self._swept_to_deg is None else self._posterior.tell_swept
            tell(sample)
            self._next = None

    def end_sweep(self) -> None:
        """Choose what follows a sweep that went to its end; one that was ended by the answer is over already."""
        self._from_deg = None
        if self._to_deg:
            if len(self._to_deg) == 1:
                self._swept_to_deg = self._to_deg[0]
            self._to_deg = self._to_deg[1:]
            self._next = None

    def confirm(self, sample: Sample) -> None:
        """Take the acquisition at the angle found, as `Posterior.confirm`."""
        self._posterior.confirm(sample)
        self._next = None

    def estimate(self) -> Estimate:
        """Answer as far as the samples prove it."""
        return self._posterior.estimate()

    @property
    def belief(self) -> Belief | None:
        """What is believed of the marker's angle, for a picture of it; None before the first sample."""
        return self._posterior.belief

    @property
    def sweeps(self) -> list[Sweep]:
        """The sweeps that it will ask for unless the marker is found before; others may follow."""
        # A beginning is given where there is one sweep alone.
        return [
            Sweep(
                to_deg=to_deg,
                speed_deg_s=self._speed_deg_s,
                spacing_deg=LEAST_SPACING_DEG,
                from_deg=self._from_deg,
                wait_deg=self._wait_deg,
            )
            for to_deg in self._to_deg
        ]

    def _judge(self, sample: Sample) -> None:
        """End a sweep that may be ended, if the marker is known; asked every tenth of a second."""
        # The light is off before the probe brakes; samples that come after a sweep was ended are used like any others.
        if not self._to_deg:
            self._next = None
            return
        if not (self._swept_back or self._posterior.single):
            return
        last_deg = self._judged_deg
        if last_deg is not None and abs(sample.angle_deg - last_deg) < self._speed_deg_s * JUDGED_EVERY_S:
            return
        self._judged_deg = sample.angle_deg
        if self._is_known(sample.angle_deg):
            self._to_deg = []
            self._next = None

    def _is_known(self, at_deg: float) -> bool:
        """Whether the marker is found, its centre known well enough, and both of its flanks swept."""
        progress = self._posterior.progress
        if progress is None or progress.sigma_deg > progress.target_deg:
            return False
        if not self._swept_back and abs(at_deg - progress.mean_deg) < FLANK * progress.fwhm_deg:
            return False
        answer = self._posterior.estimate()
        return isinstance(answer, Found) and (answer.other_probability or 0.0) <= MARGIN * STATED

    def _dark_end_deg(self) -> float | None:
        """End of the range near which a flank of the marker's curve was not in the light; None: there is none."""
        progress = self._posterior.progress
        if progress is None:
            return None
        half_deg = LIT_FLANK * progress.fwhm_deg
        for end_deg, left_deg in (
            (self._limits.high_deg, max(self._lit_deg) - progress.mean_deg),
            (self._limits.low_deg, progress.mean_deg - min(self._lit_deg)),
        ):
            if left_deg < half_deg and end_deg not in self._ends_deg:
                return end_deg
        return None

    def _after_range(self, end_deg: float) -> list[float]:
        """Ends of the sweeps that follow once the range has been swept to that end."""
        progress = self._posterior.progress
        if progress is None:
            # Single pulses show nothing: a search at rest begins, with the noise of its own frames.
            self._posterior = self._make()
            for dark in self._dark:
                self._posterior.tell(dark)
            return []
        self._posterior.state_swept()
        if self._swept_back:
            return []
        answer = self._posterior.estimate()
        back_deg = 1.0 if end_deg < self._limits.centre_deg else -1.0
        if isinstance(answer, Unsure) and (answer.other_probability or 0.0) > STATED:
            # What may hide beside the marker is looked for at some thirty angles in the time of five acquisitions.
            reach_deg = math.inf
        elif progress.sigma_deg > progress.target_deg:
            reach_deg = abs(progress.mean_deg - end_deg) + FLANK * progress.fwhm_deg
        else:
            return []
        self._swept_back = True
        if self._wait_deg is not None:
            # The probe is no longer there.
            self._from_deg = end_deg
            self._wait_deg = self._limits.nearest(progress.mean_deg)
        return [self._limits.nearest(end_deg + back_deg * reach_deg)]
