"""The delay of the stamps and the backlash by sweeps there and back, against those of the simulation."""

from __future__ import annotations

import pytest
from msgspec import structs

from markerseek.core import AcquisitionError, Asked, ConfigError
from markerseek.rigs import Rig, of_intensities
from markerseek.runs import DelayRun
from markerseek.sim import GaussianCurve, LaserSettings, ReceiverSettings, SimulatedSettings, StageMotion

SETTINGS = SimulatedSettings(
    stage=StageMotion(speed_deg_s=25.0, acceleration_deg_s2=25.0, backlash_deg=0.15, stated_backlash_deg=0.1),
    laser=LaserSettings(rate_hz=20.0, energy_jitter=0.02, stamp_delay_s=0.012),
    receiver=ReceiverSettings(readout_s=0.02, single_pulses=True),
)


def rig_with(settings: SimulatedSettings, *, seed: int = 1, marker_deg: float = 3.3) -> Rig:
    return of_intensities(seed=seed, curve=GaussianCurve(fwhm_deg=7.0), marker_deg=marker_deg, settings=settings)


def measured(rig: Rig, *, times: int = 6):  # type: ignore[no-untyped-def]
    run = DelayRun(rig, times=times)
    asked = [event.sweep for event in run.events() if isinstance(event, Asked)]
    assert len(asked) == run.sweeps
    return run.result(), asked


@pytest.mark.parametrize(("delay_s", "stated_deg", "readout_s"), [(-0.009, 0.1, 0.02), (0.012, 0.0, 10.0)])
def test_delay_and_backlash_are_those_of_the_simulation(delay_s: float, stated_deg: float, readout_s: float) -> None:
    settings = structs.replace(
        SETTINGS,
        stage=structs.replace(SETTINGS.stage, stated_backlash_deg=stated_deg),
        laser=structs.replace(SETTINGS.laser, stamp_delay_s=delay_s),
        receiver=structs.replace(SETTINGS.receiver, readout_s=readout_s),
    )
    found, _ = measured(rig_with(settings))
    # The simulated stage is read a millisecond after the middle of its answer.
    assert found.stamp_delay_s == pytest.approx(delay_s + 1e-3, abs=4 * found.stamp_delay_sigma_s)
    assert found.backlash_deg == pytest.approx(0.15, abs=4 * found.backlash_sigma_deg)
    assert 0.2e-3 <= found.stamp_delay_sigma_s < 2e-3
    assert found.marker_deg == pytest.approx(3.3, abs=0.1)


def test_what_a_rig_states_already_is_part_of_what_is_measured() -> None:
    found, _ = measured(
        rig_with(structs.replace(SETTINGS, laser=structs.replace(SETTINGS.laser, stamp_delay_sigma_s=1e-3)))
    )
    assert found.stamp_delay_s == pytest.approx(0.013, abs=4 * found.stamp_delay_sigma_s)


def test_the_slow_sweeps_of_a_slow_stage_end_within_their_permits() -> None:
    settings = structs.replace(
        SETTINGS, stage=StageMotion(), receiver=structs.replace(SETTINGS.receiver, readout_s=10.0)
    )
    _, asked = measured(rig_with(settings), times=3)
    assert min(sweep.speed_deg_s for sweep in asked) < 10.0


def test_a_rig_that_cannot_is_refused_before_it_moves() -> None:
    for times in (2, 31):
        with pytest.raises(ConfigError, match=f"times is {times}, it must be from 3 to 30"):
            DelayRun(rig_with(SETTINGS), times=times)


def test_without_a_marker_nothing_is_measured() -> None:
    run = DelayRun(of_intensities(seed=1, curve=None, marker_deg=0.0, settings=SETTINGS), times=3)
    list(run.events())
    with pytest.raises(AcquisitionError, match="0 ways show a marker with both of its flanks"):
        run.result()


def test_ways_of_one_speed_do_not_tell_the_delay_from_the_backlash(monkeypatch: pytest.MonkeyPatch) -> None:
    run = DelayRun(rig_with(SETTINGS), times=3)
    list(run.events())
    centre = run._centre

    def of_fast_ways(swept):  # type: ignore[no-untyped-def]
        way = centre(swept)
        return way if way is not None and abs(way[1]) > 20.0 else None

    monkeypatch.setattr(run, "_centre", of_fast_ways)
    with pytest.raises(AcquisitionError, match=r"6 ways show .* there and back and at both speeds"):
        run.result()
