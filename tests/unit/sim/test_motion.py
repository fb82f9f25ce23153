"""How simulated tissue moves, and what its frames and its angles say of that."""

from __future__ import annotations

import math

import numpy as np
import pytest
from msgspec import structs

from markerseek.acoustics import Absorber
from markerseek.core import ConfigError, SceneOptions
from markerseek.rigs import of_intensities, simulated
from markerseek.sim import (
    GaussianCurve,
    LaserSettings,
    MarkerSettings,
    NoiseSettings,
    ReceiverSettings,
    SimulatedSettings,
    TissueMotion,
    displaced,
    with_options,
)
from markerseek.sim.motion import moments_s

STILL = SimulatedSettings(
    marker=MarkerSettings(angle_deg=12.0, radius_m=50e-3, lateral_m=0.0),
    noise=NoiseSettings(peak_snr_db=60.0),
    laser=LaserSettings(energy_jitter=0.0),
    receiver=ReceiverSettings(readout_s=0.02),
)


def test_breathing_has_its_amplitude_its_period_and_a_pause_that_is_its_zero() -> None:
    motion = TissueMotion(breathing_mm=1.5, period_s=4.0, power=2, phase=0.5, direction=(0.0, 3.0, 4.0))
    at_s = np.linspace(0, 4, 4001)
    way_mm = 1e3 * motion.way_m(at_s)
    assert (way_mm.min(), way_mm.max()) == pytest.approx((0.0, 3.0), abs=1e-6)
    # φ of a half: the end of exhalation, and a quarter of a period later cos⁴ of 45°.
    assert way_mm[[0, 1000, 2000]] == pytest.approx([0.0, 3.0 / 4, 3.0], abs=1e-9)
    np.testing.assert_allclose(motion.way_m(at_s + 4.0), motion.way_m(at_s), atol=1e-12)
    # The mean of cos⁴ is 3/8, of cos⁶ 5/16; longer than 40 % of the time the tissue is within a tenth of its pause.
    assert way_mm[:-1].mean() == pytest.approx(3.0 * 3 / 8, rel=1e-3)
    assert (way_mm < 0.3).mean() > 0.35
    longer = structs.replace(motion, power=3)
    assert 1e3 * longer.way_m(at_s)[:-1].mean() == pytest.approx(3.0 * 5 / 16, rel=1e-3)
    np.testing.assert_allclose(motion.displacement_m(at_s)[:, 2] / motion.way_m(at_s).clip(1e-9), 0.8, atol=0.81)
    np.testing.assert_allclose(motion.displacement_m(np.array([2.0]))[0], [0.0, 1.8e-3, 2.4e-3])


def test_heartbeat_and_drift_add_to_breathing() -> None:
    motion = TissueMotion(heart_mm=0.1, heart_period_s=0.8, drift_mm_per_min=6.0, phase=0.0)
    assert motion.moves
    np.testing.assert_allclose(1e3 * motion.way_m(np.array([0.0, 0.2, 60.0])), [0.0, 0.12, 6.0], atol=1e-9)


def test_a_phase_is_drawn_for_moving_tissue_only_and_changes_no_other_draw() -> None:
    one = np.random.default_rng(3)
    other = np.random.default_rng(3)
    moving = TissueMotion(breathing_mm=1.0)
    drawn = moving.drawn(one)
    assert drawn.phase is not None
    assert 0 <= drawn.phase < 1
    assert drawn == moving.drawn(other)
    assert one.random() == other.random() == np.random.default_rng(3).random()
    assert TissueMotion().drawn(one) == TissueMotion()


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"breathing_mm": float("nan")}, "motion: breathing_mm is nan mm"),
        ({"period_s": 0.5}, "motion: period_s is 0.5 s, it must lie in .*3 to 5 s are usual"),
        ({"direction": (0.0, 0.0, 0.0)}, "motion: direction is"),
        ({"direction": (0.0, math.inf, 0.0)}, "motion: direction is"),
    ],
)
def test_what_cannot_be_is_refused(settings: dict[str, object], said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        TissueMotion(**settings)  # type: ignore[arg-type]


def test_an_absorber_moves_in_the_frame_of_the_probe() -> None:
    absorber = Absorber(radius_m=50e-3, angle_deg=30.0, lateral_m=4e-3)
    moved = displaced(absorber, np.array([1e-3, 2e-3, -3e-3]))
    np.testing.assert_allclose(moved.position_m, np.add(absorber.position_m, [1e-3, 2e-3, -3e-3]), atol=1e-12)
    assert displaced(absorber, np.zeros(3)).angle_deg == pytest.approx(30.0)


def test_a_moved_marker_sounds_at_its_present_place_and_the_truth_stays() -> None:
    """Against a rig whose marker is at that place and rests."""
    # Held at the end of inhalation for a search that takes no time: 2 mm along the turn, 1 mm away from the axis.
    at = math.radians(12.0)
    along = np.array([math.cos(at), 0, -math.sin(at)])
    away = np.array([math.sin(at), 0, math.cos(at)])
    way_m = 2e-3 * along + 1e-3 * away
    x, y, z = way_m.tolist()
    half_mm = 500 * math.hypot(x, y, z)
    motion = TissueMotion(breathing_mm=half_mm, period_s=60.0, power=1, phase=0.0, direction=(x, y, z))
    moving = simulated(seed=2, settings=structs.replace(STILL, motion=motion))
    there = displaced(Absorber(radius_m=50e-3, angle_deg=12.0), way_m)
    marker = structs.replace(STILL.marker, angle_deg=there.angle_deg, radius_m=there.radius_m)
    still = simulated(seed=2, settings=structs.replace(STILL, marker=marker))
    assert (moving.facts.truth_deg, there.angle_deg) == (12.0, pytest.approx(14.25, abs=0.05))
    for angle_deg in (12.0, there.angle_deg):
        moved, rested = (rig.scanner.measure(angle_deg).reading for rig in (moving, still))
        assert moved.depth_m == pytest.approx(rested.depth_m, abs=0.05e-3)
        assert moved.centroid_s is not None
        assert moved.centroid_s == pytest.approx(rested.centroid_s, abs=0.03e-6)
    assert moved.intensity > 1.5 * moving.scanner.measure(8.0).reading.intensity


def test_the_pulses_of_one_acquisition_blur_its_frame_where_the_tissue_moves_on() -> None:
    fast = TissueMotion(breathing_mm=2.0, period_s=4.0, phase=0.25)
    assert moments_s(fast, first_s=1.0, pulses=1, period_s=0.01).tolist() == [1.0]
    blurred_s = moments_s(fast, first_s=2.0, pulses=16, period_s=0.01)
    # 0.52 mm: one for every 0.05 mm.
    np.testing.assert_allclose(blurred_s, 2.0 + 0.15 * (np.arange(11) + 0.5) / 11)
    slow = structs.replace(fast, breathing_mm=0.4)
    assert len(moments_s(slow, first_s=2.0, pulses=16, period_s=0.01)) == 4
    assert len(moments_s(slow, first_s=2.0, pulses=3, period_s=0.2)) == 3
    pause = structs.replace(fast, phase=0.5)
    np.testing.assert_allclose(moments_s(pause, first_s=0.0, pulses=16, period_s=0.01), [0.075])


def test_of_intensities_the_part_along_the_turn_counts() -> None:
    def rig(direction: tuple[float, float, float]) -> float:
        motion = TissueMotion(breathing_mm=1.0, period_s=60.0, power=1, phase=0.0, direction=direction)
        settings = structs.replace(STILL, motion=motion, marker=structs.replace(STILL.marker, angle_deg=0.0))
        made = of_intensities(seed=1, curve=GaussianCurve(fwhm_deg=5.0), marker_deg=0.0, settings=settings)
        return made.scanner.measure(0.0).reading.intensity / 1e3

    # By 2 mm at 50 mm, 2.29°: exp(−4 ln 2·(2.29/5)²).
    assert rig((1.0, 0.0, 0.0)) == pytest.approx(math.exp(-4 * math.log(2) * (2.29 / 5) ** 2), rel=0.02)
    assert rig((0.0, 1.0, 0.0)) == pytest.approx(1.0, rel=0.02)


def test_breathing_is_an_option_and_changes_nothing_of_a_rig_without_it() -> None:
    chosen = with_options(SimulatedSettings(), SceneOptions(breathing_mm=0.7, breathing_period_s=5.0))
    assert (chosen.motion.breathing_mm, chosen.motion.period_s) == (0.7, 5.0)
    assert with_options(SimulatedSettings(), SceneOptions()) == SimulatedSettings()
    one = simulated(1)
    other = simulated(1, settings=structs.replace(SimulatedSettings(), motion=TissueMotion(power=3)))
    assert one.scanner.measure(0.0).reading == other.scanner.measure(0.0).reading
