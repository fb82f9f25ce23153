"""Recordings of PLUS as a user types them: `tooltip`, `bank import`, `bank info` and `replay` of sequences."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from markerseek.records.banks import read_bank
from tests.unit.records.banks.test_sequence import fields, write_mha

RECORDING = Path(__file__).parents[2] / "../shared/data/plus/USTC_3NWires_ProbeRotation.igs.mha"
ANGLES = tuple(np.arange(-35.0, 36.0))


@pytest.fixture
def recording(tmp_path):
    """Lines of radio frequency at 71 angles, of a marker at 12.5 degrees."""
    rng = np.random.default_rng(2)
    time = np.arange(300)
    peaks = 8000 * np.exp(-((np.array(ANGLES) - 12.5) ** 2) / (2 * 4.0**2))
    burst = np.exp(-(((time - 120) / 15) ** 2)) * np.sin(2 * np.pi * time / 7)
    lines = rng.normal(0, 15, (len(ANGLES), 8, len(time)))
    lines[:, 3] += peaks[:, None] * burst
    frames = fields(ANGLES, encoder_deg=[f"{angle - 3:g}" for angle in ANGLES])
    pixels = np.rint(lines).astype(np.int16)
    return write_mha(tmp_path / "scan.igs.mha", pixels, frames, packed=True, kind="RF_REAL", orientation="FM")


def test_a_recording_of_radio_frequency_is_replayed(shell, recording):
    code, out, err = shell("replay", recording, "--json")
    assert code == 0, err
    assert json.loads(out)["angle_deg"] == pytest.approx(12.5, abs=0.3)
    code, out, err = shell("bank", "info", recording, "--json")
    assert code == 0, err
    said = json.loads(out)
    assert (said["content"], said["angles"]) == ("intensities", 71)


def test_a_recording_is_imported_with_the_angles_and_times_that_are_named(shell, recording, tmp_path):
    for number, (words, shift) in enumerate(
        {(): 0, ("--angle-field", "encoder_deg"): -3, ("--angle-field", "ProbeToStepperHome"): 0}.items()
    ):
        to = tmp_path / f"{number}.hdf5"
        code, _, err = shell("bank", "import", recording, to, *words)
        assert code == 0, err
        bank = read_bank(to)
        np.testing.assert_allclose(bank.angles_deg, np.add(ANGLES, shift), atol=1e-3)
        np.testing.assert_allclose(bank.started_s, 100 + 0.5 * np.arange(71))


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--angle-field", "none"), "no frame has none; its fields are"),
        (("--angle-field", "Timestamp"), "Timestamp counts time or frames, and is no angle"),
        (("--columns", "a,b"), "it is no CSV"),
    ],
)
def test_wrong_words_for_a_recording_are_refused(shell, recording, tmp_path, words, said):
    code, _, err = shell("bank", "import", recording, tmp_path / "a.hdf5", *words)
    assert (code, said in " ".join(err.split())) == (2, True), err


def test_an_angle_field_is_for_sequences(shell, tmp_path):
    (tmp_path / "a.csv").write_text("angle_deg,intensity\n1,2\n2,3\n3,1\n")
    code, _, err = shell("bank", "import", tmp_path / "a.csv", tmp_path / "a.hdf5", "--angle-field", "x")
    assert (code, "is no sequence (.mha" in " ".join(err.split())) == (2, True)


def b_mode(tmp_path, **changed):
    """B-mode of 21 angles with a tip that is brightest at 4 degrees, on speckle."""
    rng = np.random.default_rng(4)
    angles = np.arange(-6.0, 15.0)
    pixels = rng.rayleigh(12, (len(angles), 160, 200))
    row, column = np.mgrid[:160, :200]
    spot = ((row - 90) / 9.0) ** 2 + ((column - 110) / 9.0) ** 2 < 1
    pixels[:, spot] += (200 * np.exp(-((angles - 4) ** 2) / (2 * 2.0**2)))[:, None]
    return write_mha(
        tmp_path / "b.igs.mha", np.clip(pixels, 0, 255).astype(np.uint8), fields(angles), packed=True, **changed
    )


def test_a_tip_is_found_at_the_angles_of_the_recording(shell, tmp_path):
    code, out, err = shell("tooltip", b_mode(tmp_path, ElementSpacing="0.1 0.15 1"), "--json")
    assert code == 0, err
    said = json.loads(out)
    assert said["reference_deg"] == pytest.approx(4, abs=1)
    assert (said["pixel_mm"], said["pixel_size"]) == ([0.15, 0.1], "from the files")
    assert said["images"][0]["angle_deg"] == -6
    assert said["images"][0]["image"].endswith("Seq_Frame0000")
    # Of many images the strongest are printed.
    _, out, _ = shell("tooltip", b_mode(tmp_path))
    printed = out.count("Seq_Frame")
    assert 0 < printed <= 15
    assert f"{printed} of 21 images, those with the strongest tips" in out
    code, out, _ = shell("tooltip", b_mode(tmp_path), "--json", "--first-deg", 0, "--step-deg", 1, "--pixel-mm", 0.1)
    assert (code, json.loads(out)["reference_deg"]) == (0, pytest.approx(10, abs=1))
    code, _, err = shell("tooltip", b_mode(tmp_path), "--step-deg", 1, "--angle-field", "ProbeRotation")
    assert (code, "without --angles and --step-deg" in " ".join(err.split())) == (2, True)


@pytest.mark.skipif(not RECORDING.exists(), reason="the recording of PLUS is not here")
def test_there_is_no_tip_in_a_recording_of_wires_and_a_wall(shell):
    code, out, err = shell("tooltip", RECORDING, "--json")
    assert code == 3, err
    assert "51 images repeat an angle" in " ".join(err.split())
    said = json.loads(out)
    assert (said["found"], len(said["images"])) == (False, 91)
    assert "no tissue with speckle" in said["reason"]
