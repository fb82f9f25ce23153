"""Damaged or malicious files: a `RecordError` with a sentence, or their content; never anything else.

No crash, no hang, no memory beyond the order of the file's size. ``tests/faults/corpus`` holds inputs that once failed
this, by the name of the decoder.
"""

from __future__ import annotations

import importlib
import sys
import tracemalloc
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from markerseek.core import RecordError
from markerseek.records.banks import read_bank
from markerseek.records.banks.ipasc import read_probed
from markerseek.records.child import try_files
from tests.faults.decoders import DECODERS, IN_THIS_PROCESS, outcome, zip_bomb
from tests.sizes import examples

CORPUS = Path(__file__).parent / "corpus"
HDF5 = ("hdf5", "mat73")
IN_PROCESS = sorted(set(DECODERS) - set(HDF5))
ROOM_BYTES = 3_000_000


@pytest.mark.parametrize("decoder", sorted(IN_THIS_PROCESS))
def test_a_whole_file_is_read(tmp_path, decoder):
    """Without it the other tests could not fail: a reader that refused everything would pass them."""
    name, whole, read = IN_THIS_PROCESS[decoder]
    assert outcome(read, tmp_path / name, whole()) == "read"


# A damaged byte may be a glitch, or a frame without an angle.
@pytest.mark.usefixtures("notes_allowed")
@settings(
    max_examples=examples(150),
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
    derandomize=True,
)
@given(data=st.data(), decoder=st.sampled_from(IN_PROCESS))
def test_damaged_bytes_are_read_or_refused(tmp_path, data, decoder):
    name, whole, read = DECODERS[decoder]
    damaged = bytearray(whole())
    for _ in range(data.draw(st.integers(1, 8))):
        damaged[data.draw(st.integers(0, len(damaged) - 1))] = data.draw(st.integers(0, 255))
    length = data.draw(st.just(len(damaged)) | st.integers(0, len(damaged)))
    more = data.draw(st.binary(max_size=40))
    assert outcome(read, tmp_path / name, bytes(damaged[:length]) + more) in ("read", "refused")


@pytest.fixture
def readers(tmp_path, monkeypatch):
    """Readers that go out of bounds, as the libraries do on damaged files; the child finds them on its path."""
    package = tmp_path / "path" / "out_of_bounds.py"
    package.parent.mkdir()
    package.write_text(OUT_OF_BOUNDS)
    monkeypatch.syspath_prepend(package.parent)
    monkeypatch.setenv("PYTHONPATH", str(package.parent))
    monkeypatch.delitem(sys.modules, package.stem, raising=False)
    return importlib.import_module(package.stem)


OUT_OF_BOUNDS = """
import os
import numpy as np

def dies(path):
    os.abort()

def fills_the_memory(path):
    return {"": np.ones(1 << 37)}

def computes_for_ever(path):
    while True:
        pass

def dies_of_some(path):
    with open(path.with_name("seen"), "a") as seen:
        seen.write(path.stem + " ")
    if path.read_bytes() == b"deadly":
        os.abort()
"""


@pytest.mark.parametrize(
    ("reader", "said"),
    [
        ("dies", "breaks down"),
        ("fills_the_memory", "far more memory than it has bytes"),
        # The file of the corpus on which HDF5 hangs shows the same.
        pytest.param("computes_for_ever", "far more time than its size explains", marks=pytest.mark.long),
    ],
)
def test_a_reader_that_goes_out_of_bounds_is_a_refusal_of_its_file(tmp_path, readers, reader, said):
    (tmp_path / "a.npy").write_bytes(b"a")
    with pytest.raises(RecordError, match=f"a.npy.*{said}"):
        try_files(getattr(readers, reader), [tmp_path / "a.npy"])


def test_one_child_tries_many_files_and_names_the_one_that_it_dies_of(tmp_path, readers):
    paths = [tmp_path / f"{number}.npy" for number in range(4)]
    for path in paths:
        path.write_bytes(b"a")
    paths[2].write_bytes(b"deadly")
    with pytest.raises(RecordError, match=r"2\.npy.*breaks down"):
        try_files(readers.dies_of_some, paths)
    # Those before it are not tried again.
    paths[2].write_bytes(b"harmless")
    try_files(readers.dies_of_some, paths)
    assert (tmp_path / "seen").read_text() == "0 1 2 2 3 "


def corpus():
    return [path for decoder in DECODERS for path in sorted((CORPUS / decoder).glob("*"))]


@pytest.mark.parametrize("path", corpus(), ids=lambda path: f"{path.parent.name}/{path.name}")
def test_inputs_that_once_did_harm_are_refused(tmp_path, path):
    name, _, read = DECODERS[path.parent.name]
    assert outcome(read, tmp_path / name, path.read_bytes()) == "refused"


@pytest.mark.parametrize(
    ("decoder", "data"),
    [
        ("daq", b"\x05\0\0\0\xff\xff\xff\x7f\xff\xff\xff\x7f" + bytes(40)),
        ("rf", b"\x10\0\0\0" + b"\xff\xff\xff\x7f" * 3 + b"\x10\0\0\0" + bytes(56)),
        ("npz", zip_bomb()),
        (
            "npy",
            b"\x93NUMPY\x01\0\x76\0{'descr': '<i2', 'fortran_order': False, 'shape': (9, 99999999999999), }".ljust(128),
        ),
        ("npy", b"\x93NUMPY\x02\0\xff\xff\xff\x7f{'descr'" + bytes(90)),
        ("csv", b"angle_deg,intensity\n" + b"1" * 200_000),
        ("csv", b'angle_deg,intensity\n"' + b"\n" * 200_000),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_a_file_that_promises_much_costs_little(tmp_path, decoder, data):
    name, _, read = DECODERS[decoder]
    tracemalloc.start()
    result = outcome(read, tmp_path / name, data)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert result == "refused"
    assert most < 40 * len(data) + ROOM_BYTES


def bank(path):
    path.write_bytes(IN_THIS_PROCESS["hdf5"][1]())
    return path


def link_outside(file, path):
    secret = path.with_name("secret.hdf5")
    with h5py.File(secret, "w") as other:
        other["angles"] = np.arange(4.0)
    del file["meta_data/trus_angle_deg"]
    file["meta_data/trus_angle_deg"] = h5py.ExternalLink(str(secret), "angles")


def external_bytes(file, path):
    del file["binary_time_series_data"]
    path.with_name("secret").write_bytes(bytes(96))
    file.create_dataset(
        "binary_time_series_data", (2, 6, 1, 4), "i2", external=[(str(path.with_name("secret")), 0, 96)]
    )


def virtual(file, path):
    with h5py.File(path.with_name("secret.hdf5"), "w") as other:
        other["frames"] = np.zeros((2, 6, 1, 4), np.int16)
    layout = h5py.VirtualLayout((2, 6, 1, 4), "i2")
    layout[...] = h5py.VirtualSource(str(path.with_name("secret.hdf5")), "frames", (2, 6, 1, 4))
    del file["binary_time_series_data"]
    file.create_virtual_dataset("binary_time_series_data", layout)


def bomb_of_angles(file, _path):
    del file["meta_data/trus_angle_deg"]
    file.create_dataset("meta_data/trus_angle_deg", (200_000_000,), "f8", chunks=(1 << 20,), compression="gzip")


def bomb_of_one_chunk(file, _path):
    del file["binary_time_series_data"]
    file.create_dataset(
        "binary_time_series_data", (2, 50_000_000, 1, 3), "i2", chunks=(2, 50_000_000, 1, 1), compression="gzip"
    )


def bomb_without_chunks(file, _path):
    del file["meta_data/intensity"]
    file.create_dataset("meta_data/intensity", (10**12,), "f8", chunks=(1024,))


def compound(file, _path):
    del file["meta_data/trus_angle_deg"]
    file["meta_data/trus_angle_deg"] = np.zeros(4, [("a", "f8"), ("b", "f8")])


def group_instead(file, _path):
    del file["meta_data/trus_angle_deg"]
    file.create_group("meta_data/trus_angle_deg")


def other_filter(file, _path):
    values = file["meta_data/trus_angle_deg"][()]
    del file["meta_data/trus_angle_deg"]
    file.create_dataset("meta_data/trus_angle_deg", data=values, chunks=(2,), scaleoffset=3)


@pytest.mark.parametrize(
    "change",
    [
        link_outside,
        external_bytes,
        virtual,
        bomb_of_angles,
        bomb_of_one_chunk,
        bomb_without_chunks,
        compound,
        group_instead,
        other_filter,
    ],
)
def test_hdf5_that_leads_elsewhere_or_promises_much_is_refused(tmp_path, change):
    path = bank(tmp_path / "a.hdf5")
    with h5py.File(path, "r+") as file:
        change(file, path)
    tracemalloc.start()
    with pytest.raises(RecordError, match=r"a\.hdf5"):
        read_probed(path)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most < 40 * path.stat().st_size + ROOM_BYTES


@pytest.mark.parametrize("decoder", HDF5)
@pytest.mark.parametrize("seed", range(40))
def test_damaged_hdf5_is_read_or_refused(tmp_path, seed, decoder):
    """In this process, what the library merely dislikes; what it hangs on is in the corpus, and needs the other."""
    name, whole_file, read = IN_THIS_PROCESS[decoder]
    whole = whole_file()
    rng = np.random.default_rng(seed)
    damaged = np.frombuffer(whole, np.uint8).copy()
    # The first blocks hold the structure; of the global heap, on which HDF5 2.0 hangs, the last part.
    damaged[rng.integers(0, 2000, 1 + seed % 4)] = rng.integers(0, 256, 1 + seed % 4)
    assert outcome(read, tmp_path / name, damaged.tobytes()) in ("read", "refused")


@pytest.mark.parametrize("decoder", HDF5)
def test_no_hdf5_is_read_untried(tmp_path, monkeypatch, decoder):
    name, whole, read = DECODERS[decoder]
    monkeypatch.setattr("markerseek.records.child.sys.executable", "/bin/false")
    (tmp_path / name).write_bytes(whole())
    with pytest.raises(RecordError, match="breaks down"):
        read(tmp_path / name)


def test_a_folder_that_may_not_be_read_is_a_refusal(tmp_path, monkeypatch):
    def forbidden(_path):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "iterdir", forbidden)
    with pytest.raises(RecordError, match="Permission denied"):
        read_bank(tmp_path)
