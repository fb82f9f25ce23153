"""Contract tests of policies, over regular and irregular intensity curves."""

# ruff: noqa: S101 - the rules are tests, and tests assert

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from msgspec import structs

from markerseek.contract.devices import refused
from markerseek.core import PAPER_RANGE, Estimate, Found, Interval, Policy, Reading, Sample, SearchError

Intensity = Callable[[float], float]
"""A curve: angle in degrees to intensity."""


def peak_at(marker_deg: float, *, fwhm_deg: float = 10.0) -> Intensity:
    """Return a symmetric curve of height 1 with tails that fall as 1/t², as a marker at that angle would draw."""
    return lambda angle_deg: 1 / (1 + (2 * (angle_deg - marker_deg) / fwhm_deg) ** 2)


CURVES: dict[str, Intensity] = {
    "marker in the middle": peak_at(0.0),
    "marker to one side": peak_at(-17.3),
    "marker at the high end": peak_at(35.0),
    "marker beyond the low end": peak_at(-50.0),
    "narrow": peak_at(12.4, fwhm_deg=2.0),
    "flat": lambda _angle_deg: 1.0,
    "zero": lambda _angle_deg: 0.0,
    "rising": lambda angle_deg: 100 + angle_deg,
    "two markers": lambda angle_deg: peak_at(-20.0)(angle_deg) + peak_at(20.0)(angle_deg),
    # Near the largest and smallest floats: squares and ratios overflow or vanish.
    "huge": lambda angle_deg: 1e300 * peak_at(3.0)(angle_deg),
    "tiny": lambda angle_deg: 1e-300 * peak_at(3.0)(angle_deg),
    # The shader hash: no two neighbours agree, and no seed is needed.
    "no order": lambda angle_deg: math.fmod(abs(math.sin(12.9898 * angle_deg)) * 43758.5453, 1.0),
}
"""Curves that every policy must end on, by name."""

MISSED_BY: dict[str, Callable[[float], float]] = {
    "exact": lambda asked_deg: asked_deg,
    "resolution": lambda asked_deg: round(asked_deg / 0.3) * 0.3,
    "backlash": lambda asked_deg: asked_deg - 0.7,
    "beyond the range": lambda asked_deg: 1.02 * asked_deg,
    "stuck": lambda _asked_deg: 4.0,
}
"""Positioning errors by name: angle reached as a function of the one asked."""


class PolicyContract:
    """Contract of a policy; a subclass makes one."""

    limits: Interval = PAPER_RANGE
    """Range that the policies are made for."""

    most: int = 1000
    """Acquisitions after which a search counts as endless."""

    def make(self, limits: Interval) -> Policy:
        """Return a new policy that searches this range."""
        raise NotImplementedError("a PolicyContract must say how to make its policy: def make(self, limits): ...")

    def search(
        self, curve: Intensity, *, reach: Callable[[float], float] = MISSED_BY["exact"]
    ) -> tuple[list[float], Estimate]:
        """Run a search; return the angles asked and the answer."""
        policy = self.make(self.limits)
        asked: list[float] = []
        for angle_deg in self.asked(policy):
            asked.append(angle_deg)
            policy.tell(_sample(reach(angle_deg), curve(reach(angle_deg))))
        return asked, policy.estimate()

    def asked(self, policy: Policy) -> Iterator[float]:
        """Yield what a policy asks, up to its end; whoever takes an angle must tell it a sample."""
        for _ in range(self.most):
            angle_deg = policy.ask()
            if angle_deg is None:
                return
            yield angle_deg
        assert policy.ask() is None, f"the search has not ended after {self.most} acquisitions"

    def test_asks_inside_the_range(self) -> None:
        """Every angle asked lies in the range, whatever the intensities."""
        for name, curve in CURVES.items():
            with _named(name):
                asked, _ = self.search(curve)
                assert asked, "nothing was asked"
                outside = [angle_deg for angle_deg in asked if angle_deg not in self.limits]
                assert not outside, f"asked {outside} deg, outside {self.limits}"

    def test_ends_wherever_the_stage_stops(self) -> None:
        """The search ends and asks inside the range although the angle reached is not the one asked."""
        for (missed_by, reach), (name, curve) in itertools.product(MISSED_BY.items(), CURVES.items()):
            with _named(name, missed_by):
                asked, answer = self.search(curve, reach=reach)
                outside = [angle_deg for angle_deg in asked if angle_deg not in self.limits]
                assert not outside, f"asked {outside} deg, outside {self.limits}"
                _check_answer(answer, self.limits)

    def test_estimates_at_any_time(self) -> None:
        """An estimate can be had before, during and after the search: a mean inside the range, and what fits to it."""
        for name, curve in CURVES.items():
            with _named(name):
                policy = self.make(self.limits)
                _check_answer(policy.estimate(), self.limits)
                for angle_deg in self.asked(policy):
                    policy.tell(_sample(angle_deg, curve(angle_deg)))
                    _check_answer(policy.estimate(), self.limits)

    def test_asking_changes_nothing(self) -> None:
        """Asking twice, or asking for an estimate in between, gives the same angle."""
        policy = self.make(self.limits)
        curve = CURVES["marker to one side"]
        for angle_deg in self.asked(policy):
            first = policy.estimate()
            assert policy.ask() == angle_deg, "asking twice gave two angles"
            assert policy.estimate() == first, "two estimates without a sample in between differ"
            policy.tell(_sample(angle_deg, curve(angle_deg)))
        first = policy.estimate()
        assert policy.ask() is None, "the search ended, and asked again"
        assert policy.estimate() == first, "two estimates after the end differ"

    def test_is_deterministic(self) -> None:
        """Two policies that receive the same samples ask and answer the same."""
        for name, curve in CURVES.items():
            with _named(name):
                assert self.search(curve) == self.search(curve), "two equal searches differ"

    def test_refuses_what_is_no_intensity(self) -> None:
        """NaN, infinite and negative intensities and angles that are not finite are refused, and leave no trace."""
        policy = self.make(self.limits)
        angle_deg = policy.ask()
        assert angle_deg is not None
        before = policy.estimate()
        for sample in (
            _sample(angle_deg, math.nan),
            _sample(angle_deg, math.inf),
            _sample(angle_deg, -1.0),
            _sample(math.nan, 1.0),
        ):
            with refused(SearchError, f"the sample {sample} was taken in; it must be refused with SearchError"):
                policy.tell(sample)
        assert policy.ask() == angle_deg, "a refused sample changed the next angle"
        assert policy.estimate() == before, "a refused sample changed the estimate"

    def test_refuses_samples_after_the_end(self) -> None:
        """A lit sample after the last is refused."""
        policy = self.make(self.limits)
        curve = CURVES["marker in the middle"]
        for angle_deg in self.asked(policy):
            policy.tell(_sample(angle_deg, curve(angle_deg)))
        with refused(SearchError, "a sample after the end was taken in; it must be refused with SearchError"):
            policy.tell(_sample(0.0, 1.0))

    def test_dark_samples_move_nothing(self) -> None:
        """A sample with the laser off is no point of the curve: the angle asked stays."""
        policy = self.make(self.limits)
        before = policy.ask()
        for _ in range(3):
            policy.tell(Sample(angle_deg=0.0, reading=Reading(intensity=0.01), dark=True))
        assert policy.ask() == before, "a dark sample changed the next angle"


def _sample(angle_deg: float, intensity: float) -> Sample:
    reading = Reading(intensity=0.0)
    # Past the reading's own check, which a class from elsewhere does not have.
    structs.force_setattr(reading, "intensity", intensity)
    return Sample(angle_deg=angle_deg, reading=reading)


@contextmanager
def _named(curve: str, missed_by: str = "exact") -> Iterator[None]:
    """Say on which curve, and with which positioning error, a policy failed or broke a rule."""
    try:
        yield
    except Exception as problem:
        problem.add_note(
            f"the curve is CURVES[{curve!r}] of markerseek.contract.policies, the positioning error {missed_by!r}"
        )
        raise


def _check_answer(estimate: Estimate, limits: Interval) -> None:
    assert estimate.mean_deg in limits, f"{estimate} has its mean outside {limits}"
    if isinstance(estimate, Found):
        assert 0 <= estimate.sigma_deg < math.inf, f"{estimate} has no standard deviation"
        assert estimate.mean_deg in estimate.interval95_deg, f"{estimate} has its mean outside its interval"
