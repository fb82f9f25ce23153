"""A bank of ours, opened by PATATO 0.7: equal frames, rates and angles, and the marker in the same place.

PATATO needs jax and lives in an environment of its own:
``.venv-peers/bin/python -m pytest -q --confcutdir=tests/peers tests/peers/test_patato.py``. Its own ``save_to_hdf5``
fails on what it reads by pacfish, ours or not, so that no file of PATATO's is read here.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys

import h5py
import numpy as np
import pytest
from scipy.signal import butter, hilbert, sosfiltfilt

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
    began_s = theirs._get_scan_times()[np.argsort(angles)] - bank.facts.clock_zero_unix_s
    np.testing.assert_allclose(began_s, bank.started_s, atol=1e-6)
    assert theirs._get_scanner_z_position().shape == (15, 6)


@pytest.mark.parametrize("falling", [False, True])
def test_patato_sees_the_marker_where_we_see_it(scan, tmp_path, falling):
    """PATATO's reference backprojection with the file's positions, also of an array that is written from its end."""
    from patato import PAData
    from patato.io.ipasc.read_ipasc import IPASCInterface
    from patato.recon.backprojection_reference import ReferenceBackprojection

    from markerseek.records.banks import read_bank
    from markerseek.rigs.replay import preset_of
    from markerseek.signals import ImageReader

    path = tmp_path / "a.hdf5"
    shutil.copy(scan, path)
    if falling:
        with h5py.File(path, "r+") as file:
            for detector in file["meta_data_device/detectors"].values():
                detector["detector_position"][0] *= -1
    bank = read_bank(path)
    strongest = int(np.argmax(bank.intensities))
    preset = preset_of(bank, None)
    ours = ImageReader(preset).read(bank.frame(strongest))

    theirs = IPASCInterface(str(path))
    data = PAData(theirs)
    rows = np.asarray(theirs._get_pa_data()[0])[np.argsort(theirs.pa_data.get_custom_meta_datum("trus_angle_deg")), 0]
    samples = rows[strongest].astype(np.float64)
    samples[:, : preset.pickup_samples] = 0
    band = butter(3, (5e6, 9e6), "band", fs=data.get_sampling_frequency(), output="sos")
    samples = sosfiltfilt(band, samples, axis=-1).astype(np.float32)
    half_m = np.abs(np.asarray(data.get_scan_geometry())[:, 0]).max()
    low_m = np.array((-half_m, 0.0, 0.004))
    width_m = np.array((2 * half_m, 0.0, 0.076))
    pixels = (128, 1, 761)
    geometry = np.array(data.get_scan_geometry()) - (low_m + width_m / 2)
    imaging = ReferenceBackprojection(pixels, tuple(width_m))
    speed_m_s = theirs.pa_data.get_speed_of_sound()
    image = imaging.reconstruct(samples[None], data.get_sampling_frequency(), geometry, pixels, width_m, speed_m_s)
    envelope = np.abs(hilbert(np.asarray(image).reshape(pixels[2], pixels[0]), axis=0))
    depth, lateral = np.unravel_index(envelope.argmax(), envelope.shape)

    pitch_m = width_m[0] / (pixels[0] - 1)
    deep_m = width_m[2] / (pixels[2] - 1)
    assert abs(ours.lateral_m) > 10 * pitch_m, "a marker in the middle would prove nothing"
    assert low_m[0] + lateral * pitch_m == pytest.approx(ours.lateral_m, abs=pitch_m)
    assert low_m[2] + depth * deep_m == pytest.approx(ours.depth_m, abs=deep_m)


def test_frames_that_went_through_patato_are_imported_and_the_search_measures_the_same(scan, tmp_path):
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


def test_patato_opens_a_bank_of_intensities_as_one_without_elements(tmp_path):
    from patato.io.ipasc.read_ipasc import IPASCInterface

    (tmp_path / "a.csv").write_text("angle_deg,intensity\n-1,2\n0,4\n1,3\n")
    markerseek("bank", "import", tmp_path / "a.csv", tmp_path / "a.hdf5", "--json")
    theirs = IPASCInterface(str(tmp_path / "a.hdf5"))
    assert (theirs.nframes, theirs._get_pa_data()[0].shape, theirs._get_sensor_geometry()) == (3, (3, 1, 0, 0), None)
    np.testing.assert_array_equal(theirs.pa_data.get_custom_meta_datum("intensity"), (2, 4, 3))
