"""A bank of ours as a file of zea: zea's own reader gives back equal samples, and a file that zea wrote is searched.

zea needs one of the big frameworks; PATATO's jax serves (``make peers``).
"""

from __future__ import annotations

import json
import os
import subprocess
import sys

import h5py
import numpy as np
import pytest

os.environ.setdefault("KERAS_BACKEND", "jax")
zea = pytest.importorskip("zea", reason="zea lives in an environment of its own, .venv-peers")
pytestmark = pytest.mark.filterwarnings("default")


def markerseek(*words):
    program = (sys.executable, "-c", "from markerseek.cli import main; main()")
    ended = subprocess.run((*program, *map(str, words)), capture_output=True, text=True, check=False)
    assert ended.returncode in (0, 3), ended.stderr
    return json.loads(ended.stdout)


@pytest.fixture(scope="module")
def scan(tmp_path_factory):
    """A simulated scan as a bank of ours, and as a file of zea."""
    folder = tmp_path_factory.mktemp("zea")
    markerseek("bank", "scan", folder / "scan.hdf5", "--seed", 1, "--step-deg", 10, "--json")
    markerseek("bank", "export", folder / "scan.hdf5", folder / "scan.zea.hdf5", "--json")
    return folder


def held(group):
    """The fields of a group of a file, as `zea.File.create` takes them."""
    return {name: item.asstr()[()] if item.dtype.kind == "O" else item[()] for name, item in group.items()}


@pytest.fixture(scope="module")
def parts(scan):
    with h5py.File(scan / "scan.zea.hdf5") as file:
        track = file["tracks/track_0"]
        return track["data/raw_data"][()], held(track["scan"]), held(file["metadata/probe_pose"]), held(file["probe"])


def test_zea_accepts_the_file_and_reads_equal_samples(scan, parts):
    from markerseek.records.banks import read_bank

    bank = read_bank(scan / "scan.hdf5")
    with zea.File(str(scan / "scan.zea.hdf5")) as file:
        file.validate()
        samples = np.asarray(file.data.raw_data[:])
        rate_hz = float(file.scan.sampling_frequency)
        elements = np.asarray(file.probe.probe_geometry)
    assert (samples.shape, elements.shape, rate_hz) == ((8, 1, 2080, 128, 1), (128, 3), 40e6)
    np.testing.assert_array_equal(samples, parts[0])
    order = np.argsort(parts[2]["rotation"][:, 0])
    for index, row in enumerate(order):
        np.testing.assert_array_equal(samples[row, 0, :, :, 0].T, bank.frame(index).samples)


def test_a_file_that_zea_wrote_is_searched_to_the_same_answer(scan, parts, tmp_path):
    samples, settings, pose, probe = parts
    theirs = tmp_path / "theirs.hdf5"
    zea.File.create(
        str(theirs),
        data={"raw_data": samples},
        scan=settings,
        metadata={"probe_pose": pose},
        probe=probe,
        compression="gzip",
    )
    found = markerseek("replay", theirs, "--json")
    ours = markerseek("replay", scan / "scan.zea.hdf5", "--json")
    assert (found["answer"], found["angle_deg"]) == (ours["answer"], ours["angle_deg"])
