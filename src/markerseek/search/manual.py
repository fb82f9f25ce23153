"""Manual search as a script, the baseline of the comparison: an assistant who turns the probe by hand.

It makes the coarse turns and the steps back and forth that the paper's introduction describes. It does not model a
person: their time, tremor or judgement.
"""

from __future__ import annotations

import math

from markerseek.core import PAPER_RANGE, Found, Interval, Sample
from markerseek.search.bracket import bracket_answer
from markerseek.search.curve import curve_of
from markerseek.search.policy import SearchPolicy, check_acquisitions, check_start
from markerseek.search.steps import equal_steps

TURNS = 8
"""Coarse turns over the range, one every 10° of the paper's."""

FINEST_STEP_DEG = 0.1
"""The assistant stops when a step would be smaller than this, in degrees."""


class ScriptedManual(SearchPolicy):
    """Eight coarse turns over the range, then back and forth round the strongest angle with shrinking steps.

    From the strongest angle the script goes half a coarse turn to the low side, then to the high side; a stronger
    sample becomes the new middle and the same side is tried again; when neither side is stronger the step is halved. It
    ends after ``acquisitions``, or when the step falls below 0.1°.

    On a flat curve nothing is stronger than the first sample, which stays the answer.

    Parameters
    ----------
    limits
        Range to search.
    acquisitions
        Most acquisitions, at least 10.
    start_deg
        Present angle of the probe, in degrees: the coarse turns begin at the nearer end. None: at the low end.

    Raises
    ------
    ConfigError
        If there are fewer acquisitions, or the start angle is not finite.
    """

    name = "manual"
    summary = "the assistant's way as a script: coarse turns, then back and forth with shrinking steps"
    acquisitions = 28
    least = TURNS + 2

    def __init__(self, *, limits: Interval = PAPER_RANGE, acquisitions: int, start_deg: float | None = None) -> None:
        super().__init__()
        check_acquisitions(acquisitions, least=self.least, method=self.name)
        check_start(start_deg, method=self.name)
        turns = equal_steps(limits, acquisitions=TURNS)
        self._turns = turns[::-1] if start_deg is not None and start_deg > limits.centre_deg else turns
        self._limits = limits
        self._budget = acquisitions
        self._best_deg = limits.centre_deg
        self._best_intensity = -math.inf
        self._step_deg = limits.width_deg / (TURNS - 1) / 2
        self._sides: tuple[int, ...] = (-1, 1)

    def _next_deg(self) -> float | None:
        """Return the next angle in degrees: a coarse turn, then a step from the strongest; None at the end."""
        if len(self._lit) >= self._budget:
            return None
        if len(self._lit) < TURNS:
            return float(self._turns[len(self._lit)])
        if self._step_deg < FINEST_STEP_DEG:
            return None
        return self._candidate_deg()

    def _update(self, sample: Sample) -> None:
        if sample.reading.intensity > self._best_intensity:
            self._best_deg = sample.angle_deg
            self._best_intensity = sample.reading.intensity
        elif len(self._lit) > TURNS:
            self._turn_round()
        if len(self._lit) >= TURNS:
            # A side that lies outside the range counts as tried.
            while self._step_deg >= FINEST_STEP_DEG and self._candidate_deg() not in self._limits:
                self._turn_round()

    def _candidate_deg(self) -> float:
        return self._best_deg + self._sides[0] * self._step_deg

    def _turn_round(self) -> None:
        """Try the other side; if that was the second one, halve the step and begin again."""
        if len(self._sides) > 1:
            self._sides = self._sides[1:]
        else:
            self._sides = (-1, 1)
            self._step_deg /= 2

    def estimate(self) -> Found:
        """Return the strongest angle, with its neighbours among the samples (or an end of the range) as its bracket."""
        return self.answer(noise_sigma=None)

    def answer(self, *, noise_sigma: float | None) -> Found:
        """Return the strongest angle, uncertain by its neighbours and by what noise hides (`bracket_answer`)."""
        if not self._lit:
            return bracket_answer(self._limits.centre_deg, self._limits, curve_of(()), noise_sigma=None)
        angles = [sample.angle_deg for sample in self._lit]
        best_deg = self._limits.nearest(self._best_deg)
        bracket = Interval(
            low_deg=max((angle for angle in angles if angle < best_deg), default=self._limits.low_deg),
            high_deg=min((angle for angle in angles if angle > best_deg), default=self._limits.high_deg),
        )
        return bracket_answer(best_deg, bracket, curve_of(self._lit), noise_sigma=noise_sigma)
