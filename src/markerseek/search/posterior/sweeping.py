"""The policy `SweepPosterior`: turns the probe over the range in light, and stops it only where that is not enough.

1. It sweeps from where the probe is to the nearer end of the range, and from there to the other end, whatever it sees:
   the last degrees cost tenths of a second, and a stronger source may be there. Where there is only one source, the
   sweep is over once the marker is known and both of its flanks are swept. Where the frames of a sweep are read at its
   end, the probe turns to the nearer end without light, and sweeps there and back in one burst: the order of its frames
   is not believed. While they are read it turns to the middle of the range, which is nearer to most markers.
2. It sweeps back over the flanks unless both directions have passed them, since a delay between pulse and angle shifts
   the two against one another (17): a delay that the rig states is compared, and not believed. It does so too where the
   centre is not known well enough, the slower the more is missing. Where another source may still hide, it sweeps back
   over the whole range.
3. What is still missing is measured at rest, as `Posterior` does: another look at a source, more precision. Where
   nothing was detected there and back, a search at rest begins: the mean of some pulses shows what one does not.

Where a prior over the angle expects the marker in a part of the range, the probe turns there without light, and the
sweeps are over that part. If `Posterior` gives the prior up, all begins again over the whole range, with all samples.

The angle of a pulse is the stage's when it was stamped. If the light comes later by a delay d, the probe has turned on
by v·d at the speed v. So a curve that is swept there and back has two centres,

    c_down − c_up = (|v_up| + |v_down|)·d.                                                                     (17)

A marker that moves has two centres as well. Where frames show that it moves, the difference says as much less of the
delay.

Whatever shifts all angles of a sweep alike (stamps, answers of the stage, frames that are late by one) is such a delay.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from msgspec import structs

from markerseek.core import AnglePrior, Estimate, Found, Interval, PriorEvidence, Sample, Sweep, Unsure
from markerseek.search.policy import check_sample
from markerseek.search.posterior.next_angle import Belief
from markerseek.search.posterior.policy import Posterior
from markerseek.search.posterior.survey import STATED

UNEXPLAINED_SIGMAS = 3.0
"""Largest difference of the two ways, in standard deviations of the delay that the rig states."""


DOUBTFUL_SIGMAS = 2.0
"""Difference of the two ways, in the same standard deviations, from which a burst is swept again.

A trigger that is lost before one way and doubled before the other looks like a delay of half a period, but not in the
next burst.
"""


LEAST_FLANK = 0.5
"""Distance from the centre up to which both flanks must be swept, over the full width at half maximum."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepCentre:
    """The centre of the curve by the pulses of one direction, and its standard deviation, in degrees."""

    centre_deg: float
    sigma_deg: float
    speed_deg_s: float
    """Mean speed, positive."""
    whole: bool
    """Whether both flanks were swept, and not one and a part of the other: then the centre is that of the curve."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Delay:
    """Delay beyond the one that the rig states, by the difference of the two ways, in seconds."""

    measured_s: float
    sigma_s: float
    """Standard deviation of the measurement."""
    prior_s: float
    """Standard deviation of what the rig states."""
    whole: bool
    """Whether both flanks were swept both ways."""
    speed_deg_s: float
    """Mean speed of the two ways."""

    @property
    def mean_s(self) -> float:
        """Mean of the delay, by measurement and prior together."""
        return self.measured_s * self.prior_s**2 / (self.prior_s**2 + self.sigma_s**2)

    @property
    def unexplained(self) -> bool:
        """Whether no delay of such a rig explains the difference."""
        return abs(self.measured_s) > UNEXPLAINED_SIGMAS * math.hypot(self.prior_s, self.sigma_s)

    @property
    def doubtful(self) -> bool:
        """Whether it is a delay that few rigs have."""
        return abs(self.measured_s) > DOUBTFUL_SIGMAS * self.prior_s

    def differs_from(self, other: Delay) -> bool:
        """Return whether two bursts of one rig show different delays."""
        return abs(self.measured_s - other.measured_s) > UNEXPLAINED_SIGMAS * math.hypot(self.sigma_s, other.sigma_s)


Centre = tuple[float, float, float]
"""Centre of a curve, its standard deviation, and its full width at half maximum, in degrees."""


def delay_of(
    samples: Sequence[Sample],
    centre_of: Callable[[Sequence[Sample]], Centre | None],
    *,
    moved_deg: float = 0.0,
) -> Delay | None:
    """Return the delay by (17); None unless the marker was passed both ways.

    ``samples``: all samples with light. ``centre_of``: fits a curve to samples; None if they show no curve.
    ``moved_deg``: standard deviation of the displacement of the marker along the turn during a way, 0 where it rests.
    """
    swept = [sample.sweep for sample in samples if sample.sweep is not None]
    up = way_of(_in_direction(samples, 1), centre_of)
    down = way_of(_in_direction(samples, -1), centre_of)
    if up is None or down is None:
        return None
    speed = up.speed_deg_s + down.speed_deg_s
    backlash_deg = max(sweep.play_sigma_deg for sweep in swept)
    return Delay(
        measured_s=(down.centre_deg - up.centre_deg) / speed,
        sigma_s=math.hypot(up.sigma_deg, down.sigma_deg, backlash_deg, math.sqrt(2) * moved_deg) / speed,
        speed_deg_s=speed / 2,
        prior_s=max(sweep.delay_sigma_s for sweep in swept),
        whole=up.whole and down.whole,
    )


def way_of(samples: Sequence[Sample], centre_of: Callable[[Sequence[Sample]], Centre | None]) -> SweepCentre | None:
    """Return the centre by the pulses of one direction; None unless it lies between two of them.

    ``samples``: samples of sweeps in one direction. ``centre_of``: see `delay_of`.
    """
    alone = _by_themselves(samples)
    centre = centre_of(alone) if alone else None
    if centre is None:
        return None
    mean_deg, sigma_deg, fwhm_deg = centre
    angles_deg = [sample.angle_deg for sample in alone]
    if not min(angles_deg) <= mean_deg <= max(angles_deg):
        return None
    near = [sample for sample in alone if abs(sample.angle_deg - mean_deg) <= fwhm_deg] or alone[:1]
    speed = float(np.mean([abs(sample.sweep.speed_deg_s) for sample in near if sample.sweep is not None]))
    flank_deg = LEAST_FLANK * fwhm_deg
    return SweepCentre(
        centre_deg=mean_deg,
        sigma_deg=sigma_deg,
        speed_deg_s=speed,
        whole=min(angles_deg) + flank_deg <= mean_deg <= max(angles_deg) - flank_deg,
    )


def _in_direction(samples: Sequence[Sample], sign: int) -> list[Sample]:
    """Return the samples of sweeps in which the angle rises (1) or falls (-1)."""
    return [sample for sample in samples if sample.sweep is not None and sign * sample.sweep.speed_deg_s > 0]


def _by_themselves(samples: Sequence[Sample]) -> list[Sample]:
    """Return samples of sweeps without the errors that they share with others, which a comparison is to show."""
    return [
        structs.replace(sample, sweep=structs.replace(sample.sweep, delay_sigma_s=0.0, play_sigma_deg=0.0))
        for sample in samples
        if sample.sweep is not None
    ]


SHIFTED = 0.05
"""Prior probability that the frames of one way of a burst are late by one, and that they are early by one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameOrder:
    """What a burst there and back says of the order of its frames.

    A trigger that is lost and another one that is doubled leave the number of frames right, and shift those between
    them by one. If these are of one flank, the flanks on which the probe came to the marker have another centre than
    those on which it left; a delay moves neither centre. If they are of one whole way, that looks like a delay of half
    a period.
    """

    delay: Delay
    apart_deg: float
    """Difference between the centre of the flanks before the marker and that of the flanks after it."""
    apart_sigma_deg: float
    """Standard deviation of it."""
    frame_deg: float
    """Angle by which the probe turns from pulse to pulse at the marker."""
    period_s: float
    """Time in which it does."""

    @property
    def contradictory(self) -> bool:
        """Whether no order in which one frame follows the other explains the flanks."""
        return abs(self.apart_deg) > UNEXPLAINED_SIGMAS * self.apart_sigma_deg

    @property
    def flank_sigma_deg(self) -> float:
        """Standard deviation of the angle by what the flanks lie further apart than they scatter."""
        # One of four flanks that is shifted by e shifts its pair by e/2, and the mean of all by e/4.
        return math.sqrt(max(0.0, self.apart_deg**2 - self.apart_sigma_deg**2)) / 2

    @property
    def way_sigma_deg(self) -> float:
        """Standard deviation of the angle by the probability that the frames of one way are shifted."""
        sigma_s = math.hypot(self.delay.prior_s, self.delay.sigma_s)
        # ln of the probability of the delay that is then left, over that of the one measured.
        log_ratios = [
            (self.delay.measured_s**2 - (self.delay.measured_s + shift_s) ** 2) / (2 * sigma_s**2)
            for shift_s in (self.period_s / 2, -self.period_s / 2)
        ]
        odds = SHIFTED * sum(map(math.exp, log_ratios))
        return math.sqrt(odds / (1 + odds)) * self.frame_deg / 2


def order_of(
    burst: Sequence[Sample], delay: Delay, centre_of: Callable[[Sequence[Sample]], Centre | None]
) -> FrameOrder | None:
    """Return what the flanks of a burst say of the order of its frames; None if they do not show the marker.

    ``burst``: its samples with light. ``delay``: that of the burst. ``centre_of``: see `delay_of`.
    """
    before: list[Sample] = []
    after: list[Sample] = []
    speeds_deg_s: list[float] = []
    periods_s: list[float] = []
    for sign in (1, -1):
        own = _in_direction(burst, sign)
        way = way_of(own, centre_of)
        if way is None:
            return None
        before += [sample for sample in own if sign * (sample.angle_deg - way.centre_deg) < 0]
        after += [sample for sample in own if sign * (sample.angle_deg - way.centre_deg) >= 0]
        speeds_deg_s.append(way.speed_deg_s)
        periods_s += [
            abs((now.angle_deg - before_it.angle_deg) / now.sweep.speed_deg_s)
            for before_it, now in pairwise(own)
            if now.sweep is not None
        ]
    first = centre_of(_by_themselves(before))
    last = centre_of(_by_themselves(after))
    apart_deg = 0.0
    apart_sigma_deg = math.inf
    if first is not None and last is not None:
        apart_deg = first[0] - last[0]
        apart_sigma_deg = math.hypot(first[1], last[1])
    # The median: a pulse without light leaves a gap.
    period_s = float(np.median(periods_s))
    return FrameOrder(
        delay=delay,
        apart_deg=apart_deg,
        apart_sigma_deg=apart_sigma_deg,
        frame_deg=float(np.mean(speeds_deg_s)) * period_s,
        period_s=period_s,
    )


JUDGED_EVERY_S = 0.1
"""Time between two judgements during a sweep, at its speed: no laser is too fast for them then."""

SWEPT_SIGMA_DEG = 0.6
"""Standard deviation at which a search by sweeps ends, in degrees, unless the tolerance needs less: 1 mm near the probe
does not."""

AT_END_DEG = 1.0
AT_END = 0.05
"""Distance from an end of the range within which a sweep to it is not worth its light; and of the range at most."""

MARGIN = 0.8
"""Share of the probability that is stated of another source up to which a sweep ends early: the confirmation changes it
by some per cent, and must not begin the search again."""

FLANK = 0.8
"""Distance from the centre up to which its flank is swept, over the full width at half maximum."""

MOST_BACK = 2
"""Most sweeps over the flanks: what they leave open is measured at rest."""

_WORTH = 0.8
"""Share of the standard deviation before a sweep over the flanks that must be left after it for another one: where the
form of the curve limits it, pulses do not help."""

_SLOWEST = 8.0
"""Most by which such a sweep is slower than that over the range."""


def centre_by(posterior: Posterior, samples: Sequence[Sample], *, of: Posterior | None = None) -> Centre | None:
    """Return the centre of the curve of some samples; None if they show none.

    ``posterior``: a posterior without samples. ``samples``: samples of sweeps. ``of``: the curve is that of the
    strongest source of this posterior; None: that of the samples.
    """
    for sample in samples:
        posterior.tell_swept(sample)
    progress = posterior.progress if of is None else posterior.progress_near(of)
    return None if progress is None else (progress.mean_deg, progress.sigma_deg, progress.fwhm_deg)


class SweepPosterior:
    """Searches by sweeps and the posterior over the marker's angle; a `SweepingPolicy` that confirms its answer.

    Parameters
    ----------
    make
        Makes the `Posterior` that judges the samples, and searches at rest.
    limits
        Range to search.
    speed_deg_s
        Speed of the sweeps over the range.
    start_deg
        Present angle of the probe, in degrees; None: the low end.
    near
        Where the marker is expected; None: anywhere.
    in_bursts
        Whether the frames of a sweep are read at its end: it begins at the nearer end of the range then.
    """

    name = "posterior"

    def __init__(
        self,
        make: Callable[[], Posterior],
        *,
        limits: Interval,
        speed_deg_s: float,
        start_deg: float | None = None,
        near: AnglePrior | None = None,
        in_bursts: bool = False,
    ) -> None:
        self._make = make
        self._posterior = make()
        self._limits = limits
        self._speed_deg_s = speed_deg_s
        self._in_bursts = in_bursts
        self._dark: list[Sample] = []
        self._lit: list[Sample] = []
        # Over what it sweeps: what a prior leaves, in the end the whole range.
        self._part = limits if near is None else near.interval(limits)
        self.sweeps = self._first(start_deg)
        self._back = 0
        self._sigma_deg = math.inf
        self._range_swept = False
        self._known = False
        self._judged_deg: float | None = None
        self._next: tuple[float | Sweep | None] | None = None

    def _first(self, start_deg: float | None) -> list[Sweep]:
        """Return the sweeps over the part of the range, from where the probe is."""
        part = self._part
        near_deg = part.low_deg
        far_deg = part.high_deg
        if start_deg is not None and start_deg > part.centre_deg:
            near_deg, far_deg = far_deg, near_deg
        at_end_deg = min(AT_END_DEG, AT_END * part.width_deg)
        # Without a prior the start is at the end of the range where it is not known, or lies beyond it.
        unknown = part == self._limits and (start_deg is None or start_deg not in part)
        at_end = unknown or (start_deg is not None and abs(start_deg - near_deg) <= at_end_deg)
        if self._in_bursts:
            return [self._burst(near_deg, far_deg, wait_deg=part.centre_deg, here=at_end)]
        if not at_end and (start_deg is None or start_deg not in part):
            return [Sweep(to_deg=far_deg, speed_deg_s=self._speed_deg_s, from_deg=near_deg)]
        return [Sweep(to_deg=to_deg, speed_deg_s=self._speed_deg_s) for to_deg in (near_deg, far_deg)[at_end:]]

    sweeps: list[Sweep]
    """The sweeps that it will ask for unless the marker is found before; others may follow."""
    disorder: str | None = None
    """Why samples are not at their angles, which ends a run with a fault; None if the ways there and back agree."""

    def ask(self) -> float | Sweep | None:
        """Return the next sweep, or next angle in degrees.

        None at the end of the search, or of a sweep that is ended early.
        """
        if self._next is None:
            self._next = (None if self._known else self.sweeps[0] if self.sweeps else self._at_rest(),)
        return self._next[0]

    @property
    def near_evidence(self) -> PriorEvidence | None:
        """What was seen of the prior over the angle; None without one, and before the first sample."""
        return self._posterior.near_evidence

    def _at_rest(self) -> float | Sweep | None:
        """Return the next angle at rest, in degrees; None once the marker is found as well as the tolerance asks.

        A sweep over the whole range where a prior over the angle is given up now.
        """
        narrowed = self._posterior.is_narrowed
        if not (self._range_swept and isinstance(self.estimate(), Found)):
            angle_deg = self._posterior.ask()
        elif self._posterior.doubts_near(at_end=True):
            self._posterior.widen()
            angle_deg = self._posterior.ask()
        else:
            return None
        if narrowed and not self._posterior.is_narrowed:
            self._widen()
            return self.sweeps[0] if self.sweeps else angle_deg
        return angle_deg

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
            self._lit.append(sample)
            self._judge(sample)
        else:
            self._posterior.tell(sample)
            self._next = None

    def end_sweep(self) -> None:
        """Choose what follows a sweep, and judge the order of its frames (`disorder`)."""
        self._next = None
        self._judged_deg = None
        last_deg = self._lit[-1].angle_deg if self._lit else None
        known = self._known or (self._posterior.single and self._is_known(last_deg))
        self.sweeps = [] if known else self.sweeps[1:]
        self._known = False
        if not self.sweeps:
            self.sweeps = self._following()
        if not self.sweeps and self._is_doubtful():
            self._posterior.widen()
            self._widen()

    def _is_doubtful(self) -> bool:
        """Return whether the prior over the angle is to be given up before anything is measured at rest."""
        answer = self._posterior.estimate()
        # For the precision alone an acquisition at rest is the shorter way.
        precise = isinstance(answer, Unsure) and answer.doubt == "width"
        return self._posterior.doubts_near(at_end=not precise)

    def _widen(self) -> None:
        """Begin again over the whole range, from where the probe is, unless all of it has been swept."""
        if self._part == self._limits:
            return
        self._part = self._limits
        self._range_swept = False
        self._back = 0
        self._sigma_deg = math.inf
        if not self._lit:
            self.sweeps = self._first(None)
            return
        last_deg = self._lit[-1].angle_deg
        ends_deg = (self._limits.low_deg, self._limits.high_deg)
        near_deg = min(ends_deg, key=lambda each: abs(each - last_deg))
        # An end that has been swept is not swept again.
        swept = any(abs(each.angle_deg - near_deg) <= AT_END_DEG for each in self._lit)
        self.sweeps = self._first(near_deg if swept else last_deg)

    def confirm(self, sample: Sample) -> None:
        """Take the acquisition at the angle found, as `Posterior.confirm`."""
        self._posterior.confirm(sample)
        self._next = None

    def estimate(self) -> Estimate:
        """Return the answer as far as the samples prove it; nothing is found where the order of the frames is wrong."""
        answer = self._posterior.estimate()
        if isinstance(answer, Found) and self.disorder is not None:
            return answer.as_unsure("source", self.disorder)
        return answer

    @property
    def belief(self) -> Belief | None:
        """What is believed of the marker's angle, for a picture of it; None before the first sample."""
        return self._posterior.belief

    def _judge(self, sample: Sample) -> None:
        """End a sweep over the range once the only source is known; asked every tenth of a second."""
        if self._range_swept or not self._posterior.single or len(self.sweeps) > 1 or self._in_bursts:
            return
        last_deg = self._judged_deg
        if last_deg is not None and abs(sample.angle_deg - last_deg) < self._speed_deg_s * JUDGED_EVERY_S:
            return
        self._judged_deg = sample.angle_deg
        if self._is_known(sample.angle_deg):
            self._known = True
            self._next = None

    def _is_known(self, at_deg: float | None) -> bool:
        """Return whether the marker is found, and both of its flanks were swept by a probe that is there."""
        progress = self._posterior.progress
        if at_deg is None or progress is None or abs(at_deg - progress.mean_deg) < FLANK * progress.fwhm_deg:
            return False
        answer = self._posterior.estimate()
        return isinstance(answer, Found) and (answer.other_probability or 0.0) <= MARGIN * STATED

    def _following(self) -> list[Sweep]:
        """Return the sweep that follows once the range has been swept; none where what is left is measured at rest."""
        progress = self._posterior.progress
        if progress is None and self._part != self._limits:
            return []
        if progress is None and not self._range_swept:
            # One more takes four seconds and shows most that the first has missed by little; a search at rest, forty.
            self._range_swept = True
            return [self._over(self._part.low_deg, self._part.high_deg, speed_deg_s=self._speed_deg_s)]
        if progress is None:
            # Single pulses show nothing: a search at rest begins, with the noise of its own frames.
            self._range_swept = False
            narrowed = self._posterior.is_narrowed
            self._posterior = self._make()
            if not narrowed:
                self._posterior.widen()
            for dark in self._dark:
                self._posterior.tell(dark)
            return []
        self._range_swept = True
        self._posterior.state_swept()
        delay = self._judged_delay()
        progress = self._posterior.progress or progress
        if self._back >= MOST_BACK:
            return []
        answer = self._posterior.estimate()
        if isinstance(answer, Unsure) and (answer.other_probability or 0.0) > STATED and self._back == 0:
            # What may hide beside the marker is looked for at many angles in the time of five acquisitions.
            self._back = MOST_BACK
            return [self._over(self._part.low_deg, self._part.high_deg, speed_deg_s=self._speed_deg_s)]
        slower = (progress.sigma_deg / progress.target_deg) ** 2 - 1
        again = self._in_bursts and delay is not None and delay.doubtful and self._back == 0
        if slower <= 0 and delay is not None and not again:
            return []
        if progress.sigma_deg > _WORTH * self._sigma_deg:
            return []
        self._back = self._back + 1
        self._sigma_deg = progress.sigma_deg
        reach_deg = FLANK * progress.fwhm_deg
        low_deg = self._limits.nearest(progress.mean_deg - reach_deg)
        high_deg = self._limits.nearest(progress.mean_deg + reach_deg)
        # A flank that was not swept is missing, and not light.
        unswept = low_deg not in self._part or high_deg not in self._part
        slowness = 1.0 if unswept and self._back == 1 else min(max(slower, 1.0), _SLOWEST)
        return [self._over(low_deg, high_deg, speed_deg_s=self._speed_deg_s / slowness)]

    def _judged_delay(self) -> Delay | None:
        """Compare the ways there and back, and take the delay that they show out of the angles.

        None if both flanks were not swept both ways: then the difference shows a wrong order alone.
        """
        moved_deg = self._posterior.moved_deg
        delay = delay_of(self._posterior.lit, self._centre_of, moved_deg=moved_deg)
        if delay is None:
            return None
        if delay.unexplained:
            apart_deg = 2 * delay.speed_deg_s * abs(delay.measured_s)
            self.disorder = (
                f"the sweeps there and back differ as if the light came {1e3 * delay.measured_s:.0f} ± "
                f"{1e3 * delay.sigma_s:.0f} ms later than the rig states, which it knows to {1e3 * delay.prior_s:.1f} "
                "ms: frames are late by one or more, the stage answers late, or the delay that is stated is wrong: "
                f"check the trigger's cable, and measure the delay; or the marker moves along the turn, here by "
                f"{apart_deg:.1f} deg from one way to the other: hold the ventilation during the search"
            )
        orders = self._orders() if self._in_bursts else []
        self.disorder = self.disorder or _disorder_of(orders)
        if not delay.whole:
            return None
        self._posterior.take_out_delay(delay.mean_s, order_sigma_deg=_order_sigma_deg(orders))
        return delay

    def _orders(self) -> list[FrameOrder]:
        """Return what each burst that passed the marker both ways says of the order of its frames."""
        lit = self._posterior.lit
        numbers = sorted({sample.sweep.number for sample in lit if sample.sweep is not None})
        bursts = [[each for each in lit if each.sweep is not None and each.sweep.number == one] for one in numbers]
        moved_deg = self._posterior.moved_deg
        delays = [(burst, delay_of(burst, self._centre_of, moved_deg=moved_deg)) for burst in bursts]
        orders = [order_of(burst, delay, self._centre_of) for burst, delay in delays if delay is not None]
        return [order for order in orders if order is not None]

    def _centre_of(self, samples: Sequence[Sample]) -> Centre | None:
        """Return the centre of the curve of some samples by themselves."""
        return centre_by(self._make(), samples, of=self._posterior)

    def _over(self, low_deg: float, high_deg: float, *, speed_deg_s: float) -> Sweep:
        """Return a sweep from the side on which the probe is, which ends on the other."""
        # Where no pulse counted, it does not matter which.
        above = not self._lit or self._lit[-1].angle_deg > (low_deg + high_deg) / 2
        from_deg, to_deg = (high_deg, low_deg) if above else (low_deg, high_deg)
        if self._in_bursts:
            # While its frames are read, the probe turns to the marker.
            return self._burst(from_deg, to_deg, wait_deg=(low_deg + high_deg) / 2, here=False, speed_deg_s=speed_deg_s)
        # A turn without light to where a slow sweep begins, and none to where one at the same speed does.
        slow = speed_deg_s < self._speed_deg_s
        return Sweep(to_deg=to_deg, speed_deg_s=speed_deg_s, from_deg=from_deg if slow else None)

    def _burst(
        self, from_deg: float, to_deg: float, *, wait_deg: float, here: bool, speed_deg_s: float | None = None
    ) -> Sweep:
        """Return a sweep there and back whose frames are read at its end."""
        return Sweep(
            to_deg=to_deg,
            speed_deg_s=self._speed_deg_s if speed_deg_s is None else speed_deg_s,
            from_deg=None if here else from_deg,
            back_deg=from_deg,
            wait_deg=wait_deg,
        )


def _disorder_of(orders: Sequence[FrameOrder]) -> str | None:
    """Return why the frames of some bursts are not of the pulses in their order; None if nothing contradicts it."""
    for order in orders:
        if order.contradictory:
            return (
                f"the flanks on which the probe came to the marker have a centre {order.apart_deg:+.2f} ± "
                f"{order.apart_sigma_deg:.2f} deg beside that of the flanks on which it left: a trigger was lost and "
                "another doubled; check its cable"
            )
    for one, other in pairwise(order.delay for order in orders):
        if one.differs_from(other):
            return (
                f"the light came {1e3 * one.measured_s:.0f} ms later than the rig states in one burst and "
                f"{1e3 * other.measured_s:.0f} ms in the next: a trigger was lost or doubled; check its cable"
            )
    return None


def _order_sigma_deg(orders: Sequence[FrameOrder]) -> float:
    """Return the standard deviation of the angle by what the order of the frames leaves open."""
    if not orders:
        return 0.0
    flanks_deg = math.hypot(*(order.flank_sigma_deg for order in orders)) / len(orders)
    # The same two triggers of the next burst are not lost and doubled too.
    return math.hypot(flanks_deg, orders[0].way_sigma_deg if len(orders) == 1 else 0.0)
