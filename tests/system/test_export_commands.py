"""`markerseek bank export` of frames without stored intensities, as a user types it."""

from __future__ import annotations

import json

import numpy as np
import pytest
import SimpleITK as sitk  # noqa: N813 - the name that its users give it

from markerseek import rigs
from markerseek.core import ChannelFrame, Measured
from markerseek.records.banks import FrameBank, read_bank
from markerseek.runs import scan_bank


@pytest.fixture(scope="module")
def scan(tmp_path_factory):
    path = tmp_path_factory.mktemp("scan") / "scan.hdf5"
    events = list(scan_bank(rigs.simulated(seed=3), path, step_deg=17.5))
    assert sum(isinstance(each, Measured) and isinstance(each.sample.frame, ChannelFrame) for each in events) > 5
    return path


@pytest.fixture(scope="module")
def folder(scan):
    bank = read_bank(scan)
    assert isinstance(bank, FrameBank)
    place = scan.parent / "folder"
    place.mkdir()
    for index, angle_deg in enumerate(bank.angles_deg):
        np.save(place / f"angle_{angle_deg:.6f}deg.npy", bank.frame(index).samples)
    return place


def exported(shell, source, to, *words):
    code, _, err = shell("bank", "export", source, to, *words)
    assert code == 0, err
    return err


def test_the_face_radius_places_the_images_or_is_reported_missing(shell, folder, tmp_path):
    err = exported(shell, folder, tmp_path / "a.igs.mha")
    assert "give --face-radius-mm" in " ".join(err.split())
    err = exported(shell, folder, tmp_path / "b.igs.mha", "--face-radius-mm", 10)
    assert "face-radius" not in err
    key = "Seq_Frame0004_ImageToProbeTransform"
    assert not sitk.ReadImage(str(tmp_path / "a.igs.mha")).HasMetaDataKey(key)
    assert sitk.ReadImage(str(tmp_path / "b.igs.mha")).HasMetaDataKey(key)


def test_a_file_of_zea_is_imported_as_it_was_exported(shell, scan, tmp_path):
    exported(shell, scan, tmp_path / "a.zea.hdf5")
    code, _, err = shell("bank", "import", tmp_path / "a.zea.hdf5", tmp_path / "b.hdf5")
    assert code == 0, err
    before = read_bank(scan)
    after = read_bank(tmp_path / "b.hdf5")
    assert isinstance(before, FrameBank)
    assert isinstance(after, FrameBank)
    np.testing.assert_allclose(after.angles_deg, before.angles_deg, atol=6e-6)
    for index in range(len(before.angles_deg)):
        np.testing.assert_array_equal(after.frame(index).samples, before.frame(index).samples)
    assert after.facts.sampling_hz == before.facts.sampling_hz
    assert after.facts.pitch_m == pytest.approx(before.facts.pitch_m)
    assert after.intensities == pytest.approx(before.intensities, rel=1e-3)


def test_one_frame_of_a_scan_is_searched_as_the_same_frame_alone(shell, scan, folder, tmp_path):
    exported(shell, scan, tmp_path / "a.zea.hdf5")
    alone = sorted(folder.iterdir(), key=lambda path: float(path.stem.removeprefix("angle_").removesuffix("deg")))[2]
    _, expected, _ = shell("frame", alone, "--json")
    for file in (scan, tmp_path / "a.zea.hdf5"):
        code, out, err = shell("frame", file, "--number", 3, "--json")
        assert code in (0, 3), err
        assert json.loads(out)["intensity"] == pytest.approx(json.loads(expected)["intensity"], rel=1e-3)
    code, _, err = shell("frame", scan, "--number", 6)
    assert code == 2
    assert "holds 5 frames" in err
