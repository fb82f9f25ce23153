"""Searches of a marker whose displacements cameras saw, in worlds of intensities with places: its truth is at rest."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest

from markerseek.core import Displacement, Estimate, Found, Reading, Sample, SweepTiming
from markerseek.search.posterior import Posterior
from markerseek.show.words import motion_rows

RADIUS_MM = 60.0
FACE_MM = 10.0
NOISE = 1.0
PEAK = 100.0
FWHM_DEG = 9.0


@dataclass
class BreathingMarker:
    """A marker that swings by a sine of 4 s in a direction of its own, and cameras with an error."""

    rng: np.random.Generator
    amplitude_mm: float
    error_mm: float = 0.05
    seen: bool = True

    def __post_init__(self) -> None:
        self.angle_deg = float(self.rng.uniform(-15, 15))
        drawn = self.rng.standard_normal(3)
        self.direction = drawn / np.linalg.norm(drawn)
        self.phase_s = float(self.rng.uniform(0, 4))

    def displacement_mm(self, at_s: float) -> np.ndarray:
        """From the end of exhalation."""
        way_mm = self.amplitude_mm * (1 - math.cos(2 * math.pi * (at_s + self.phase_s) / 4))
        return np.asarray(way_mm * self.direction)

    def sample(self, probe_deg: float, at_s: float, error_mm: np.ndarray, timing: SweepTiming | None = None) -> Sample:
        """What the probe reads at a moment, and what the cameras say of it."""
        angle = math.radians(self.angle_deg)
        by_mm = self.displacement_mm(at_s)
        place_mm = RADIUS_MM * np.array([math.sin(angle), 0.0, math.cos(angle)]) + by_mm
        away_deg = math.degrees(math.atan2(place_mm[0], place_mm[2])) - probe_deg
        probe = math.radians(probe_deg)
        slant_mm = float(np.hypot(*(place_mm[[0, 2]] - FACE_MM * np.array([math.sin(probe), math.cos(probe)]))))
        energy = 1 + (0.05 if timing else 0.01) * self.rng.standard_normal()
        height = PEAK * energy * math.exp(-4 * math.log(2) * (away_deg / FWHM_DEG) ** 2)
        intensity = math.hypot(height + 0.8 * NOISE * self.rng.standard_normal(), 3 * NOISE)
        weak = intensity < 8 * NOISE
        lateral_mm, depth_mm = self.rng.uniform(-20, 20, 2).tolist() if weak else (float(by_mm[1]), slant_mm)
        x, y, z = (by_mm + error_mm).tolist()
        variance_mm2 = self.error_mm**2
        covariance_mm2 = ((variance_mm2, 0.0, 0.0), (0.0, variance_mm2, 0.0), (0.0, 0.0, variance_mm2))
        return Sample(
            angle_deg=probe_deg,
            reading=Reading(
                intensity=intensity,
                lateral_m=1e-3 * (lateral_mm + 0.01 * self.rng.standard_normal()),
                depth_m=1e-3 * (abs(depth_mm) + 20 * weak + 0.01 * self.rng.standard_normal()),
                noise_sigma=NOISE,
                cells=1000,
                focused_coherence=0.999,
            ),
            sweep=timing,
            displacement=Displacement(mm=(x, y, z), covariance_mm2=covariance_mm2) if self.seen else None,
        )

    def error(self) -> np.ndarray:
        """An error of the cameras."""
        return self.error_mm * self.rng.standard_normal(3)


def at_rest(marker: BreathingMarker) -> Estimate:
    """The answer of a search with the probe at rest, an acquisition every 2.3 s."""
    policy = Posterior(acquisitions=14)
    at_s = 0.0
    while (angle_deg := policy.ask()) is not None:
        policy.tell(marker.sample(angle_deg, at_s, marker.error()))
        at_s += 2.3
    return policy.estimate()


def swept(marker: BreathingMarker) -> Estimate:
    """The answer from one sweep there and back, with one error of the cameras each way."""
    policy = Posterior(others=0.0)
    at_s = 0.0
    for number, speed_deg_s in enumerate((20.0, -20.0), start=1):
        timing = SweepTiming(number=number, speed_deg_s=speed_deg_s)
        error_mm = marker.error()
        for angle_deg in np.arange(-35.0, 35.1, 1.0) * math.copysign(1, speed_deg_s):
            policy.tell_swept(marker.sample(float(angle_deg), at_s, error_mm, timing))
            at_s += 0.05
    return policy.estimate()


def errors_of(estimates: list[tuple[BreathingMarker, Estimate]]) -> tuple[np.ndarray, np.ndarray]:
    """Errors of the angle, and of it over its standard deviation."""
    errors_deg = np.array([each.mean_deg - marker.angle_deg for marker, each in estimates])
    sigmas_deg = np.array([each.sigma_deg for _, each in estimates])
    return errors_deg, errors_deg / sigmas_deg


@pytest.mark.parametrize("search", [at_rest, swept])
@pytest.mark.parametrize("error_mm", [0.02, 0.3])
def test_what_cameras_see_is_taken_out_and_what_they_leave_open_is_in_the_interval(
    search: object, error_mm: float
) -> None:
    assert callable(search)
    markers = [BreathingMarker(np.random.default_rng(seed), amplitude_mm=1.5, error_mm=error_mm) for seed in range(6)]
    answers = [(marker, search(marker)) for marker in markers]
    errors_deg, relative = errors_of(answers)
    assert sum(isinstance(answer, Found) for _, answer in answers) >= 3
    # 0.3 mm are 0.29°, of which a mean over a search leaves a part; 3 mm of motion are 2.9°.
    assert np.median(np.abs(errors_deg)) < 0.12 + 0.7 * math.degrees(error_mm / RADIUS_MM)
    assert np.abs(relative).max() < 3
    assert 0.2 < np.sqrt(np.mean(relative**2)) < 1.6
    for marker, answer in answers:
        assert answer.motion is not None
        assert answer.motion.left_mm == pytest.approx(error_mm, rel=0.02)
        assert answer.motion.cameras_mm == pytest.approx(marker.amplitude_mm, rel=0.5, abs=2 * error_mm)


def test_without_cameras_the_same_markers_are_far_less_well_known() -> None:
    ratios = []
    for seed in range(4):
        blind = at_rest(BreathingMarker(np.random.default_rng(seed), amplitude_mm=1.5, seen=False))
        seen = at_rest(BreathingMarker(np.random.default_rng(seed), amplitude_mm=1.5))
        ratios.append((blind.sigma_deg or math.inf) / (seen.sigma_deg or math.inf))
    assert np.median(ratios) > 2


def test_with_cameras_that_contradict_the_frames_nothing_is_found() -> None:
    """What they say is turned away from the truth: depth and lateral position scatter on, and the turn with them."""

    class Turned(BreathingMarker):
        def error(self) -> np.ndarray:
            return -2 * self.displacement_mm(self.at_s)

        at_s = 0.0

        def sample(
            self, probe_deg: float, at_s: float, error_mm: np.ndarray, timing: SweepTiming | None = None
        ) -> Sample:
            return super().sample(probe_deg, at_s, -2 * self.displacement_mm(at_s), timing)

    for seed in range(3):
        answer = at_rest(Turned(np.random.default_rng(seed), amplitude_mm=1.0))
        assert not isinstance(answer, Found)


def test_the_answer_says_what_the_cameras_saw_and_what_is_left() -> None:
    answer = at_rest(BreathingMarker(np.random.default_rng(2), amplitude_mm=1.1, error_mm=0.05))
    ((name, text),) = motion_rows(answer.motion)
    assert name == "motion"
    assert text.startswith("seen by the cameras: ± 1")
    assert text.endswith("taken out; ± 0.05 mm along the turn left")
