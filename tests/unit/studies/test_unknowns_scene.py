"""What studies draw beside the marker, and how they judge answers where there are two sources."""

from __future__ import annotations

import hashlib
import math
from dataclasses import replace

import msgspec
import numpy as np
import pytest
from msgspec import structs

from markerseek.acoustics import Absorber
from markerseek.core import Ambiguous, ConfigError, Estimate, Interval, NotFound, Unsure
from markerseek.sim import LaserSettings, MarkerSettings, NoiseSettings, SimulatedSettings, TissueMotion
from markerseek.sim.settings import hashable_values
from markerseek.studies import (
    Axis,
    Breathing,
    ClutterAround,
    CurveSettings,
    Repeats,
    SceneSettings,
    SecondSource,
    Study,
    cells,
    run_row,
    study_policy,
    summarise,
)
from markerseek.studies.trial import TwoAngles
from markerseek.studies.unknowns import DrawnScene, draw_extra_sources
from markerseek.studies.worlds import draw_trial, hidden_noise, study_rig

LIMITS = Interval(low_deg=-35.0, high_deg=35.0)
MARKER = Absorber(radius_m=0.05, angle_deg=-20.0, lateral_m=6e-3)
TERNARY = study_policy(method="ternary", acquisitions=4, as_published=True)
FRAMES = Study(
    name="scenes",
    policies=(TERNARY,),
    level="frames",
    drawn="everything",
    scene=SceneSettings(second=SecondSource()),
    rig=SimulatedSettings(noise=NoiseSettings(peak_snr_db=50.0), laser=LaserSettings(energy_jitter=0.0)),
)


def drawn(settings: SceneSettings, count: int = 500) -> list[DrawnScene]:
    rng = np.random.default_rng(5)
    return [draw_extra_sources(settings, rng, marker=MARKER, limits=LIMITS) for _ in range(count)]


def test_a_second_source_is_drawn_over_its_ranges() -> None:
    sources = [scene.second for scene in drawn(SceneSettings(second=SecondSource(least_lateral_m=3e-3)))]
    away = np.array([source.angle_deg - MARKER.angle_deg for source in sources])
    assert all(source.angle_deg in LIMITS for source in sources)
    assert 6 <= np.abs(away).min() < 7
    # To the left there are 15°, to the right 55°.
    assert away.min() == pytest.approx(-15, abs=1.5)
    assert away.max() == pytest.approx(55, abs=1.5)
    loudness = np.array([source.strength for source in sources])
    assert (loudness.min(), loudness.max()) == pytest.approx((0.5, 1.0), abs=0.01)
    assert min(abs(source.lateral_m - MARKER.lateral_m) for source in sources) >= 3e-3
    assert len({source.radius_m for source in sources}) == len({source.source for source in sources}) == len(sources)


def test_a_second_source_at_the_same_place_differs_in_angle_and_loudness_only() -> None:
    for scene in drawn(SceneSettings(second=SecondSource(same_place=True)), count=20):
        expected = structs.replace(MARKER, angle_deg=scene.second.angle_deg, strength=scene.second.strength)
        assert scene.second == expected
        assert scene.clutter == ()
        assert scene.reverberation is None


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: SecondSource(least_apart_deg=70.0), "most_apart_deg is 60"),
        (lambda: SecondSource(least_apart_deg=math.nan), "least_apart_deg is nan"),
        (lambda: SecondSource(most_relative=1.1), "most_relative is 1.1"),
        (lambda: SecondSource(least_relative=0.0), "least_relative is 0"),
        (lambda: SecondSource(same_place=True, least_lateral_m=1e-3), "leave one out"),
        (lambda: ClutterAround(count=0), "count is 0"),
        (lambda: ClutterAround(least_db=-2.0), "most_db is -3"),
        (lambda: ClutterAround(most_db=3.0), "most_db is 3"),
        (lambda: Repeats(least_delay_s=0.0), "least_delay_s is 0"),
        (lambda: Repeats(most_gain=0.01), "most_gain is 0.01"),
        (lambda: Repeats(most_repeats=0), "most_repeats is 0"),
        (lambda: structs.replace(FRAMES, drawn="marker"), "need level"),
        (lambda: structs.replace(FRAMES, level="curves", drawn="marker"), "need level"),
        (lambda: structs.replace(FRAMES, rig=SimulatedSettings(marker=MarkerSettings(present=False))), "not present"),
        (
            lambda: structs.replace(
                FRAMES,
                level="curves",
                drawn="marker",
                curve=CurveSettings(family="sech"),
                scene=SceneSettings(clutter=ClutterAround()),
            ),
            "need level",
        ),
    ],
)
def test_a_scene_that_cannot_be_drawn_is_refused(make: object, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        make()  # type: ignore[operator]


@pytest.mark.parametrize("trial", range(3))
def test_a_second_source_is_as_loud_in_the_image_as_was_drawn(trial: int) -> None:
    """Of the frames of the rig itself; the two are far apart, so that neither is seen from the other's angle."""
    far = structs.replace(FRAMES, scene=SceneSettings(second=SecondSource(least_apart_deg=25.0, most_apart_deg=30.0)))
    draw = draw_trial(far, cells(far)[0], trial)
    rig = study_rig(far, cells(far)[0], draw)
    assert rig.facts.truth_deg == draw.marker_deg
    assert draw.scene.second is not None
    on, beside = (rig.scanner.measure(deg).reading for deg in (draw.marker_deg, draw.scene.second.angle_deg))
    near = [each for each in beside.arrivals if abs(each.lateral_m - draw.scene.second.lateral_m) < 1e-3]
    assert near[0].intensity / on.intensity == pytest.approx(draw.scene.second.strength, rel=0.05)


def test_no_noise_saturates_the_frames_of_a_drawn_rig() -> None:
    """At 20 dB the noise of a channel is as large as the signal; it reached full scale in one rig of six."""
    noisy = structs.replace(FRAMES, scene=SceneSettings(), rig=SimulatedSettings(noise=NoiseSettings(peak_snr_db=20.0)))
    for trial in range(12):
        draw = draw_trial(noisy, cells(noisy)[0], trial)
        rig = study_rig(noisy, cells(noisy)[0], draw)
        for reading in (rig.scanner.measure_dark().reading, rig.scanner.measure(draw.marker_deg).reading):
            assert reading.saturated_fraction is not None
            assert reading.saturated_fraction <= 0.02


def test_a_search_that_fails_for_want_of_noise_says_so_and_names_no_device() -> None:
    quiet = SimulatedSettings(start_deg=-35.0, noise=NoiseSettings(peak_snr_db=60.0))
    checked = study_policy(method="ternary", acquisitions=4)
    study = structs.replace(FRAMES, policies=(checked,), scene=SceneSettings(), rig=quiet, seed=20261141)
    row = run_row(study, 0)
    fault = row.fault or ""
    assert row.answer == "failed"
    assert fault.startswith("noise: peak_snr_db is 60 dB, which leaves 0.0")
    assert "the steps of the converter hide it; lower peak_snr_db to at most " in fault
    most_db = float(fault.split(" at most ")[1].split(" dB")[0])
    lower = structs.replace(study, rig=structs.replace(quiet, noise=NoiseSettings(peak_snr_db=most_db)))
    # Another noise draws another marker: the scene of this one is what must fit.
    draw = draw_trial(study, cells(study)[0], 0)
    assert hidden_noise(lower, cells(lower)[0], draw, sweep=False) is None
    # A frame of a sweep is of one pulse, and has eight times the noise of this average of 64.
    assert hidden_noise(study, cells(study)[0], draw, sweep=True) is None


def test_without_a_scene_a_cell_keeps_its_markers() -> None:
    """The digest of a cell is part of the seed of its trials: of a world as it was before there were scenes."""
    plain = Study(name="plain", policies=(TERNARY,), curve=CurveSettings(family="sech", fwhm_deg=8.0))
    (cell,) = cells(plain)
    before = {"curve": {"draws": 4, "family": "sech", "fwhm_deg": 8.0, "power": 1.0}, "rig": hashable_values(plain.rig)}
    text = msgspec.json.encode(before, order="deterministic")
    assert cell.digest == int.from_bytes(hashlib.sha256(text).digest()[:8], "big")
    other = structs.replace(plain, scene=SceneSettings(second=SecondSource()))
    assert cells(other)[0].digest != cell.digest


def test_a_tissue_and_its_clutter_are_in_the_frames_with_everything_drawn() -> None:
    study = Study(
        name="tissues",
        policies=(TERNARY,),
        level="frames",
        drawn="everything",
        vary=(Axis(key="rig.tissue", values=("plastisol-phantom", "muscle-icg")),),
        rig=SimulatedSettings(noise=NoiseSettings(peak_snr_db=60.0)),
    )
    elsewhere = []
    for cell in cells(study):
        draw = draw_trial(study, cell, 1)
        rig = study_rig(study, cell, draw)
        arrivals = [each for deg in range(-35, 36, 5) for each in rig.scanner.measure(deg).reading.arrivals]
        elsewhere.append(sum(abs(each.lateral_m - draw.lateral_m) > 4e-3 for each in arrivals))
    assert elsewhere[0] == 0
    assert elsewhere[1] > 5


def test_two_sources_are_two_peaks_and_their_csv_states_no_noise() -> None:
    study = Study(
        name="humps",
        policies=(TERNARY,),
        trials=3,
        curve=CurveSettings(family="sech", fwhm_deg=3.0, noise_stated=False),
        scene=SceneSettings(second=SecondSource(least_apart_deg=9.0, most_apart_deg=10.0)),
        rig=SimulatedSettings(noise=NoiseSettings(peak_snr_db=60.0), laser=LaserSettings(energy_jitter=0.0)),
    )
    draw = draw_trial(study, cells(study)[0], 0)
    rig = study_rig(study, cells(study)[0], draw)
    assert draw.scene.second is not None
    second_deg = draw.scene.second.angle_deg
    on, between, other = (
        rig.scanner.measure(deg).reading for deg in (draw.marker_deg, (draw.marker_deg + second_deg) / 2, second_deg)
    )
    assert other.intensity / on.intensity == pytest.approx(draw.scene.second.strength, rel=0.01)
    assert between.intensity < 0.2 * other.intensity
    assert (on.noise_sigma, on.cells, rig.dark_frames) == (None, None, 0)


POINT = Interval(low_deg=-1.0, high_deg=1.0)
TWO = TwoAngles(10.0, -4.0)


def ambiguous(*modes_deg: float) -> Ambiguous:
    return Ambiguous(mean_deg=modes_deg[0], modes_deg=modes_deg)


@pytest.mark.parametrize(
    ("estimate", "nearest", "other_deg"),
    [
        (NotFound(mean_deg=9.0, reason=""), "stronger", None),
        (ambiguous(10.1, -4.2), "stronger", -4.2),
        (ambiguous(-4.2, 10.1), "weaker", 10.1),
        (ambiguous(10.1, 3.0), "stronger", None),
        (ambiguous(10.1, 3.0, -5.0, -4.1), "stronger", -4.1),
        (
            Unsure(
                mean_deg=3.0, sigma_deg=1, interval95_deg=POINT, interval_kind="posterior", doubt="source", reason=""
            ),
            "between",
            None,
        ),
        (NotFound(mean_deg=-30.0, reason=""), "outside", None),
    ],
)
def test_an_answer_is_nearest_to_one_of_two_sources(estimate: Estimate, nearest: str, other_deg: float | None) -> None:
    assert TWO.nearest(estimate.mean_deg) == nearest
    assert TWO.other_named(estimate) == other_deg


def test_the_summary_counts_what_was_answered_of_two_sources() -> None:
    study = structs.replace(FRAMES, trials=5)
    row = run_row(study, 0)
    assert row.second_deg is not None
    assert row.second_db is not None
    assert -6.1 < row.second_db <= 0
    made = [
        msgspec.structs.replace(row, trial=0, answer="found", nearest="stronger", other_deg=1.0),
        msgspec.structs.replace(row, trial=1, answer="found", nearest="weaker", other_deg=None),
        msgspec.structs.replace(row, trial=2, answer="found", nearest="between", other_deg=None),
        msgspec.structs.replace(row, trial=3, answer="ambiguous", nearest="weaker", other_deg=1.0),
        msgspec.structs.replace(row, trial=4, answer="not found", nearest="weaker", other_deg=None),
    ]
    two = summarise(study, made).policies[0].two_sources
    assert two is not None
    hits = {name: getattr(two, name).hits for name in ("stronger", "weaker", "between", "named")}
    assert hits == {"stronger": 2, "weaker": 1, "between": 1, "named": 2}
    assert two.named.count == 5


def test_breathing_is_drawn_over_its_ranges_in_any_direction_or_along_one() -> None:
    at = math.radians(MARKER.angle_deg)
    turn = np.array([math.cos(at), 0.0, -math.sin(at)])

    def motions(breathing: Breathing) -> list[TissueMotion]:
        return [motion for scene in drawn(SceneSettings(breathing=breathing)) if (motion := scene.motion) is not None]

    free = motions(Breathing(amplitude_mm=1.0))
    along = np.array(
        [motion.displacement_m(np.array([-(motion.phase or 0.0) * motion.period_s]))[0] for motion in free]
    )
    # 2 mm at the end of inhalation; the cosine to the turn is evenly spread.
    np.testing.assert_allclose(np.linalg.norm(along, axis=1), 2e-3)
    assert np.quantile(along @ turn / 2e-3, [0.25, 0.5, 0.75]) == pytest.approx([-0.5, 0.0, 0.5], abs=0.1)
    assert {motion.power for motion in free} == {2, 3}
    assert (min(m.period_s for m in free), max(m.period_s for m in free)) == pytest.approx((3.0, 5.0), abs=0.05)
    for name, expected in (("turn", turn), ("axis", np.array([0.0, 1.0, 0.0]))):
        one = motions(Breathing(along=name))
        assert {round(abs(float(np.dot(motion.direction, expected))), 9) for motion in one} == {1.0}


def test_breathing_changes_no_other_draw_and_reaches_the_rig() -> None:
    breathing = structs.replace(
        FRAMES, scene=SceneSettings(second=SecondSource(), breathing=Breathing(amplitude_mm=2.0))
    )
    still = structs.replace(FRAMES, scene=SceneSettings(second=SecondSource()))
    one, other = (draw_trial(study, replace(cells(study)[0], digest=5), 0) for study in (breathing, still))
    assert (one.marker_deg, one.noise_seed, one.scene.second) == (
        other.marker_deg,
        other.noise_seed,
        other.scene.second,
    )
    rig = study_rig(breathing, cells(breathing)[0], one)
    assert rig.facts.truth_deg == one.marker_deg
    depths_m = []
    for _ in range(4):
        depths_m.append(rig.scanner.measure(one.marker_deg).reading.depth_m)
        rig.scanner.clock.wait(0.7)
    assert np.ptp([depth_m for depth_m in depths_m if depth_m is not None]) > 0.1e-3
