"""Searches on rigs that give RF lines or B-mode images: the same loop, guard, journal and commands as for channels."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from markerseek import build, run
from markerseek.core import ConfigError, Finished, Found, Measured, RFFrame, SearchPlan
from markerseek.records.journal import read_journal
from markerseek.rigs import simulated
from markerseek.runs import journal_bank
from markerseek.sim import (
    BModeSettings,
    LaserSettings,
    MarkerSettings,
    ReceiverSettings,
    SimulatedSettings,
    World,
    post_beamformed,
)

RF = SimulatedSettings(receiver=ReceiverSettings(data="rf", readout_s=0.05))
TIP = SimulatedSettings(
    marker=MarkerSettings(angle_deg=12.5, lateral_m=2e-3), receiver=ReceiverSettings(data="b-mode", readout_s=0.05)
)

BOTH = SimulatedSettings(receiver=ReceiverSettings(b_mode=True, readout_s=0.05))


def finished(settings, *, method="posterior", seed=1, **options):
    rig = simulated(seed=seed, settings=settings)
    events = list(run(build(SearchPlan(method=method, **options)), rig.scanner, rig.run_plan))
    assert isinstance(events[-1], Finished)
    return rig, events


def test_a_marker_is_found_in_rf_lines_by_spare():
    rig, events = finished(RF)
    assert isinstance(events[-1].estimate, Found)
    assert abs(events[-1].estimate.mean_deg - rig.facts.truth_deg) < 0.3
    assert all(isinstance(each.sample.frame, RFFrame) for each in events if isinstance(each, Measured))
    assert "SPARE, from post-beamformed RF, dynamic receive focus" in rig.facts.description


@pytest.mark.parametrize("data", ["rf", "b-mode"])
def test_a_journal_of_such_a_search_is_replayed_and_becomes_a_bank_of_intensities(shell, tmp_path, data):
    rig = tmp_path / "rig.toml"
    rig.write_text(f'kind = "simulated"\n[marker]\nangle_deg = 3.0\n[receiver]\ndata = "{data}"\nreadout_s = 0.05\n')
    journal = tmp_path / "run.journal"
    code, out, err = shell("search", "--seed", 1, "--rig", rig, "--single", "--journal", journal, "--json")
    assert (code, abs(json.loads(out)["angle_deg"] - 3.0) < 0.3) == (0, True), err
    again = json.loads(shell("journal", "replay", journal, "--json")[1])
    assert again["from_the_frames"]["angle_deg"] == pytest.approx(again["recorded"]["angle_deg"], abs=0.01)
    code, out, err = shell("bank", "import", journal, tmp_path / "scan.hdf5")
    assert code == 0, err
    assert json.loads(shell("bank", "info", tmp_path / "scan.hdf5", "--json")[1])["content"].startswith("intensities")


def test_a_rig_with_both_shows_the_marker_on_the_surface_of_the_tissue():
    """Seen in its plane, the spot of light is as deep in both images as it is before the array: R − r."""
    # A long pulse is loudest at its ends, 0.4 mm before and behind the spot.
    settings = replace(BOTH, marker=MarkerSettings(angle_deg=12.5, lateral_m=-6e-3), laser=LaserSettings(pulse_s=50e-9))
    rig = simulated(seed=1, settings=settings)
    sample = rig.scanner.measure(12.5)
    b_mode = sample.frame.b_mode
    depth_m = settings.marker.radius_m - settings.probe.face_radius_m
    row, column = b_mode.geometry.pixel(lateral_m=-6e-3, depth_m=depth_m)
    # Two pixels are 0.3 mm. The surface is the brightest row; the source is found by the other simulation.
    assert np.argmax(b_mode.pixels.mean(axis=1)) == pytest.approx(row, abs=2)
    image = rig.imaging.picture(sample.frame)
    at = divmod(int(np.argmax(image.envelope)), image.envelope.shape[1])
    lateral_m, deep_m = image.geometry.position_m(row=at[0], column=at[1])
    assert b_mode.geometry.pixel(lateral_m=lateral_m, depth_m=deep_m) == pytest.approx((row, column), abs=2)


@pytest.mark.filterwarnings("always")
def test_b_mode_images_beside_channel_data_are_kept_replayed_and_drawn(shell, tmp_path):
    rig = tmp_path / "rig.toml"
    rig.write_text('kind = "simulated"\n[receiver]\nb_mode = true\n[b_mode]\npixel_m = 5e-4\n')
    journal = tmp_path / "run.journal"
    search = ("search", "--seed", 1, "--rig", rig, "--single", "--journal", journal, "--json", "--plot")
    code, out, err = shell(*search, "--out", tmp_path)
    assert (code, json.loads(out)["found"]) == (0, True), err
    assert (tmp_path / "search.png").stat().st_size > 10_000
    held = [each.event.sample for each in read_journal(journal).entries if isinstance(each.event, Measured)]
    expected = BModeSettings(pixel_m=5e-4)
    assert all(each.frame.b_mode.pixels.shape == expected.shape for each in held)
    again = json.loads(shell("journal", "replay", journal, "--json")[1])
    assert again["from_the_frames"]["angle_deg"] == pytest.approx(again["recorded"]["angle_deg"], abs=0.01)
    # As a bank it is searched again, with the images.
    frame = journal_bank(journal).frame(0)
    assert frame.b_mode.geometry == expected.geometry
    # Their banks have no place for them, and that is said once.
    rig.write_text('kind = "simulated"\n[receiver]\nb_mode = true\nreadout_s = 0.01\n[b_mode]\npixel_m = 1e-3\n')
    for words in (
        ("scan", tmp_path / "a.hdf5", "--rig", rig, "--step-deg", 35),
        ("import", journal, tmp_path / "b.hdf5"),
    ):
        code, _, err = shell("bank", *words)
        assert (code, " ".join(err.split()).count("B-mode images are left out")) == (0, 1), err


@pytest.mark.parametrize("receive_focus_m", [None, 40e-3])
def test_the_simulated_machine_beamforms_as_it_is_written_out(receive_focus_m):
    from tests.unit.signals.machine_rf import post_beamformed as written_out

    world = simulated(seed=2).stage._world
    assert isinstance(world, World)
    counts = np.random.default_rng(1).integers(-500, 500, (128, 2080)).astype(np.int16)
    element_m = world.model.probe.array.lateral_m
    expected = written_out(
        counts.astype(float),
        element_m=element_m,
        line_m=element_m,
        sampling_hz=40e6,
        sound_speed_m_s=1540.0,
        f_number=2.0,
        receive_focus_m=receive_focus_m,
    )
    ours = post_beamformed(counts, world.model, receive_focus_m=receive_focus_m)
    # Counts are rounded, and an element on the edge of the aperture may be in the one sum only.
    differs = np.abs(ours - 0.25 * expected) > 2
    assert differs.mean() < 2e-3


def test_settings_that_do_not_fit_are_refused():
    with pytest.raises(ConfigError, match="receive_focus_m is for data = 'rf', not 'channels'"):
        ReceiverSettings(receive_focus_m=0.03)
    with pytest.raises(ConfigError, match="b_mode is for data = 'channels' or 'rf'"):
        ReceiverSettings(data="b-mode", b_mode=True)
    with pytest.raises(ConfigError, match="receiver: receive_focus_m is nan m"):
        ReceiverSettings(data="rf", receive_focus_m=float("nan"))


def test_settings_that_are_newer_than_the_hashes_do_not_change_them():
    """The hashes of a rig and of a study from before RF lines and B-mode images; a study's seeds are made of them."""
    from markerseek.rigs import fingerprint
    from markerseek.studies import cells
    from markerseek.studies.paper.fig5 import Condition, study_of

    assert fingerprint(SimulatedSettings()) == "b147248e16205b8115e71afbb0e70af7"
    assert fingerprint(RF) != fingerprint(TIP) != fingerprint(SimulatedSettings())
    study = study_of(Condition(source_radius_m=0.15e-3, peak_snr_db=40.0), seed=1)
    assert cells(study)[0].digest == 7318545960020396796


@pytest.mark.parametrize(
    ("receiver", "said"),
    [
        ({"data": "rf"}, "a SonixDAQ gives channel data"),
        ({"data": "b-mode"}, "a SonixDAQ gives channel data"),
        ({"b_mode": True}, "a SonixDAQ takes no B-mode images"),
    ],
)
def test_studies_and_emulated_devices_have_channel_data_only(shell, tmp_path, receiver, said):
    from markerseek.studies import Study, study_policy

    with pytest.raises(ConfigError, match="a study computes channel data only"):
        Study(
            name="a",
            trials=1,
            seed=1,
            policies=(study_policy(method="ternary"),),
            rig=SimulatedSettings(receiver=ReceiverSettings(**receiver)),
        )
    lines = "".join(f"{name} = {json.dumps(value)}\n" for name, value in receiver.items())
    (tmp_path / "rig.toml").write_text(f'kind = "simulated"\n[receiver]\n{lines}')
    code, _, err = shell("emulate", "bench", "--rig", tmp_path / "rig.toml", "--dir", tmp_path / "daq")
    assert (code, said in " ".join(err.split())) == (2, True), err
