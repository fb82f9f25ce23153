"""A bank of ours, opened by PATATO 0.7: equal frames, rates and angles; then replayed, with the same answer.

PATATO needs jax and lives in an environment of its own: ``.venv-peers/bin/pytest tests/peers/test_patato.py``.
"""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pytest

pytest.importorskip("patato", reason="PATATO lives in an environment of its own, .venv-peers")
pytestmark = pytest.mark.filterwarnings("default")


def markerseek(*words):
    program = (sys.executable, "-c", "from markerseek.cli import main; main()")
    ended = subprocess.run((*program, *map(str, words)), capture_output=True, text=True, check=False)
    assert ended.returncode in (0, 3), ended.stderr
    return json.loads(ended.stdout)


@pytest.fixture(scope="module")
def scan(tmp_path_factory):
    path = tmp_path_factory.mktemp("bank") / "scan.hdf5"
    markerseek("bank", "scan", path, "--seed", 3, "--step-deg", 5, "--wavelength-nm", 760, "--json")
    return path


def test_patato_reads_frames_rates_and_geometry(scan):
    from patato.io.ipasc.read_ipasc import IPASCInterface

    from markerseek.records.banks import read_bank

    bank = read_bank(scan)
    theirs = IPASCInterface(str(scan))
    frames, attributes = theirs._get_pa_data()
    assert frames.shape == (15, 1, 128, 2080)
    angles = theirs.pa_data.get_custom_meta_datum("trus_angle_deg")
    np.testing.assert_array_equal(np.sort(angles), bank.angles_deg)
    for index, row in enumerate(np.argsort(angles)):
        np.testing.assert_array_equal(frames[row, 0], bank.frame(index).samples)
    assert attributes["fs"] == 40e6
    assert theirs._get_wavelengths() == [pytest.approx(760e-9)]
    positions = np.asarray(theirs._get_sensor_geometry())
    np.testing.assert_allclose(np.diff(positions[:, 0]), 0.43e-3)
    assert theirs.nframes == 15


def test_patato_makes_its_own_file_of_it_and_the_replay_points_at_the_same_angle(scan, tmp_path):
    """Frames that went through PATATO are imported again: the search hears the same."""
    from patato.io.ipasc.read_ipasc import IPASCInterface

    theirs = IPASCInterface(str(scan))
    frames = np.asarray(theirs._get_pa_data()[0])[:, 0]
    angles = theirs.pa_data.get_custom_meta_datum("trus_angle_deg")
    np.savez(tmp_path / "theirs.npz", angle_deg=angles, frames=frames, sampling_hz=theirs._get_sampling_frequency())
    markerseek("bank", "import", tmp_path / "theirs.npz", tmp_path / "theirs.hdf5", "--json")
    method = ("--method", "golden-section", "--as-published", "--json")
    ours = markerseek("replay", scan, *method)
    again = markerseek("replay", tmp_path / "theirs.hdf5", *method)
    assert again["angle_deg"] == ours["angle_deg"]
    assert [each["intensity"] for each in again["samples"]] == [each["intensity"] for each in ours["samples"]]
