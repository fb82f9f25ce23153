"""Files of other people that say less than ours, or say it otherwise: read with a word from a person, or refused."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from scipy.io import savemat
from scipy.signal import hilbert, resample_poly

from markerseek.records.banks import FrameBank, TableFormat, read_bank
from tests.field.base_scan import MARKER_DEG, SAMPLING_HZ, base_scan
from tests.unit.records.vantage_workspaces import write_workspace

Shell = Callable[..., tuple[int, str, str]]
pytestmark = pytest.mark.usefixtures("no_child", "notes_allowed")

STEPS = ("--first-deg", "7", "--step-deg", "1")
FIRST, LAST = 42, 54
"""Rows of the base scan from 7° to 18°, about the marker."""


@pytest.fixture(scope="module")
def angles_deg() -> np.ndarray:
    return base_scan().angles_deg[FIRST:LAST]


@pytest.fixture(scope="module")
def frames() -> np.ndarray:
    return base_scan().frames[FIRST:LAST]


def ipasc(path: Path, frames: np.ndarray, *, wavelength: float = 780e-9) -> Path:
    """A file as pacfish writes it for a device that knows nothing of angles."""
    with h5py.File(path, "w") as file:
        file["binary_time_series_data"] = frames.transpose(1, 2, 0)[:, :, None, :]
        file["meta_data/ad_sampling_rate"] = SAMPLING_HZ
        file["meta_data/acquisition_wavelengths"] = np.array([wavelength])
        for number in range(frames.shape[1]):
            place = f"meta_data_device/detectors/{number:010d}/detector_position"
            file[place] = np.array([base_scan().pitch_m * number, 0.0, 0.0])
    return path


def zea(path: Path, raw: np.ndarray) -> Path:
    """A file of zea without poses; ``raw``: (frames, 1, samples, elements, 1 or 2)."""
    with h5py.File(path, "w") as file:
        file["tracks/track_0/data/raw_data"] = raw
        file["tracks/track_0/scan/sampling_frequency"] = SAMPLING_HZ
    return path


def imported(shell: Shell, path: Path, *words: object) -> str:
    """What an import said."""
    code, _, said = shell("bank", "import", path, path.with_name("bank.hdf5"), *words)
    assert code == 0, said
    return " ".join(said.split())


def refused(shell: Shell, path: Path, *words: object) -> str:
    """What a refused import said."""
    code, _, said = shell("bank", "import", path, path.with_name("bank.hdf5"), *words)
    assert code == 2, said
    assert not path.with_name("bank.hdf5").exists()
    return " ".join(said.split())


def answer_deg(shell: Shell, path: Path, *words: object) -> float:
    """Angle at which a replay finds the marker."""
    code, out, said = shell("replay", path, "--json", *words)
    assert code == 0, said
    return float(json.loads(out)["angle_deg"])


def info(shell: Shell, path: Path) -> dict[str, float]:
    code, out, said = shell("bank", "info", path, "--json")
    assert code == 0, said
    found: dict[str, float] = json.loads(out)
    return found


@pytest.mark.parametrize("kind", [np.int16, np.float32, np.uint16])
def test_ipasc_without_angles(
    shell: Shell, tmp_path: Path, frames: np.ndarray, angles_deg: np.ndarray, kind: type
) -> None:
    offset = 1 << 15 if kind is np.uint16 else 0
    path = ipasc(tmp_path / "scan.hdf5", (frames.astype(np.int64) + offset).astype(kind), wavelength=780.0)
    said = refused(shell, path)
    assert "angle_deg is missing" in said
    assert "--first-deg" in said
    assert "--angles FILE" in said
    imported(shell, path, *STEPS)
    found = info(shell, tmp_path / "bank.hdf5")
    assert found["cen_deg"] == pytest.approx(MARKER_DEG, abs=0.1)
    # Some programs write nanometres.
    assert found["wavelength_m"] == pytest.approx(780e-9)
    assert found["pitch_m"] == pytest.approx(base_scan().pitch_m)
    # The same with a file of angles, as a spreadsheet of a German laboratory writes it.
    (tmp_path / "bank.hdf5").unlink()
    lines = ["Winkel", *(f"{each:.1f}".replace(".", ",").replace("-", "\u2212") for each in angles_deg - 30)]
    (tmp_path / "angles.txt").write_text("\n".join(lines), encoding="utf-8")
    imported(shell, path, "--angles", tmp_path / "angles.txt")
    assert info(shell, tmp_path / "bank.hdf5")["cen_deg"] == pytest.approx(MARKER_DEG - 30, abs=0.1)


def test_a_file_of_angles_of_another_length(shell: Shell, tmp_path: Path, frames: np.ndarray) -> None:
    path = ipasc(tmp_path / "scan.hdf5", frames)
    (tmp_path / "angles.txt").write_text("7\n8\n9\n")
    assert "frames has the shape (12, 128, 2080) for 3 angles" in refused(
        shell, path, "--angles", tmp_path / "angles.txt"
    )
    (tmp_path / "angles.txt").write_text("7\n8\neight\n")
    assert "write one angle in degrees on each line" in refused(shell, path, "--angles", tmp_path / "angles.txt")
    (tmp_path / "angles.txt").write_text("7\n8\n9\n")
    assert "leave one out" in refused(shell, path, "--angles", tmp_path / "angles.txt", *STEPS)


def test_zea_without_poses(shell: Shell, tmp_path: Path, frames: np.ndarray) -> None:
    path = zea(tmp_path / "scan.hdf5", frames.transpose(0, 2, 1)[:, None, :, :, None])
    assert "--first-deg" in refused(shell, path)
    imported(shell, path, *STEPS)
    assert info(shell, tmp_path / "bank.hdf5")["cen_deg"] == pytest.approx(MARKER_DEG, abs=0.1)


CARRIER_HZ = 6.3e6


def iq_of(frames: np.ndarray, *, every: int = 1) -> np.ndarray:
    """The frames mixed down by the carrier, filtered, and every so many-th sample kept, as a machine does."""
    time_s = np.arange(frames.shape[2]) / SAMPLING_HZ
    mixed = hilbert(frames.astype(float), axis=2) * np.exp(-2j * np.pi * CARRIER_HZ * time_s)
    return mixed if every == 1 else resample_poly(mixed, 1, every, axis=2)


def zea_of_iq(path: Path, frames: np.ndarray, every: int) -> Path:
    iq = iq_of(frames, every=every)
    pairs = np.stack([iq.real, iq.imag], axis=-1).astype(np.float32)
    zea(path, pairs.transpose(0, 2, 1, 3)[:, None])
    with h5py.File(path, "r+") as file:
        place = file["tracks/track_0/scan"]
        place["sampling_frequency"][...] = SAMPLING_HZ / every
        place["demodulation_frequency"] = np.float32(CARRIER_HZ)
    return path


@pytest.mark.parametrize("every", [1, 4])
def test_iq_data_with_their_carrier_are_imaged(
    shell: Shell, tmp_path: Path, frames: np.ndarray, angles_deg: np.ndarray, every: int
) -> None:
    """In every form: pairs of zea, pairs along a last axis, complex numbers of NumPy and of MATLAB."""
    imported(shell, zea_of_iq(tmp_path / "zea.hdf5", frames, every), *STEPS)
    found = info(shell, tmp_path / "bank.hdf5")
    assert found["cen_deg"] == pytest.approx(MARKER_DEG, abs=0.1)
    assert found["sampling_hz"] == SAMPLING_HZ
    iq = iq_of(frames, every=every)
    held = {"angle_deg": angles_deg, "sampling_hz": SAMPLING_HZ / every, "demodulation_frequency": CARRIER_HZ}
    np.savez(tmp_path / "scan.npz", frames=iq.astype(np.complex64), **held)
    np.savez(tmp_path / "pairs.npz", frames=np.stack([iq.real, iq.imag], axis=-1).astype(np.float32), **held)
    savemat(tmp_path / "scan.mat", {"frames": iq, **held})
    for name in ("scan.npz", "pairs.npz", "scan.mat"):
        bank = read_bank(tmp_path / name)
        assert isinstance(bank, FrameBank)
        # Between the filter's edges, in the strongest sound behind the pick-up.
        channel, sample = np.unravel_index(np.abs(frames[5, :, 500:].astype(int)).argmax(), frames[5, :, 500:].shape)
        window = np.s_[channel, 500 + sample - 20 : 500 + sample + 20]
        alike = np.corrcoef(bank.frame(5).samples[window], frames[5][window])[0, 1]
        assert alike > (0.999 if every == 1 else 0.95)


def test_iq_data_without_their_carrier_are_read_by_their_envelope(
    shell: Shell, tmp_path: Path, frames: np.ndarray, angles_deg: np.ndarray
) -> None:
    iq = iq_of(frames)
    pairs = np.stack([iq.real, iq.imag], axis=-1).astype(np.float32)
    path = zea(tmp_path / "scan.hdf5", pairs.transpose(0, 2, 1, 3)[:, None])
    said = imported(shell, path, *STEPS)
    assert "its frames are IQ data, and demodulation_frequency is missing, without which there is no image" in said
    assert info(shell, tmp_path / "bank.hdf5")["cen_deg"] == pytest.approx(MARKER_DEG, abs=0.3)
    # Also at a rate that would be too low for an image.
    for every in (1, 4):
        np.savez(
            tmp_path / "scan.npz", frames=iq_of(frames, every=every), angle_deg=angles_deg, sampling_hz=40e6 / every
        )
        assert answer_deg(shell, tmp_path / "scan.npz") == pytest.approx(MARKER_DEG, abs=0.3)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"demodulation_frequency": 6.3},
            r"demodulation_frequency is [6.3], it must be one number in Hz, 100000 to 1e+08",
        ),
        ({"frames": None}, "6.3e+06 Hz, as of IQ data, and its frames are real numbers; save them as complex numbers"),
        ({"sampling_hz": None}, "its frames are IQ data, and sampling_hz is missing; add the rate of the pairs, in Hz"),
    ],
)
def test_a_carrier_that_makes_no_sense_is_refused(
    shell: Shell, tmp_path: Path, frames: np.ndarray, angles_deg: np.ndarray, changes: dict[str, Any], message: str
) -> None:
    held = {"frames": iq_of(frames), "angle_deg": angles_deg, "sampling_hz": 40e6, "demodulation_frequency": CARRIER_HZ}
    held |= changes
    if held["frames"] is None:
        held["frames"] = frames
    np.savez(tmp_path / "scan.npz", **{name: value for name, value in held.items() if value is not None})
    assert message in refused(shell, tmp_path / "scan.npz")


def test_hdf5_with_frames_and_angles_alone(
    shell: Shell, tmp_path: Path, frames: np.ndarray, angles_deg: np.ndarray
) -> None:
    path = tmp_path / "scan.h5"
    with h5py.File(path, "w") as file:
        file["frames"], file["angle_deg"], file["sampling_hz"] = frames, angles_deg, SAMPLING_HZ
    assert answer_deg(shell, path) == pytest.approx(MARKER_DEG, abs=0.1)
    with h5py.File(path, "r+") as file:
        del file["frames"], file["angle_deg"]
        file["angle_deg"] = all_deg = base_scan().angles_deg
        file["intensity"] = 3.0 + 400.0 * np.exp(-(((all_deg - MARKER_DEG) / 3.0) ** 2))
    assert answer_deg(shell, path) == pytest.approx(MARKER_DEG, abs=0.1)


@pytest.mark.parametrize("wrong", ["NaN", "noise"])
def test_a_channel_without_sound_is_left_out_and_named(
    shell: Shell, tmp_path: Path, frames: np.ndarray, angles_deg: np.ndarray, wrong: str
) -> None:
    spoilt = frames.astype(np.float64)
    if wrong == "NaN":
        spoilt[3:, 40] = np.nan
    else:
        spoilt[:, 40] = np.random.default_rng(1).normal(0.0, 500.0, spoilt[:, 40].shape)
    np.savez(tmp_path / "scan.npz", frames=spoilt, angle_deg=angles_deg, sampling_hz=SAMPLING_HZ)
    said = imported(shell, tmp_path / "scan.npz")
    assert ("channel 41 holds NaN" if wrong == "NaN" else "times the noise of the others, and is left out") in said
    assert "channel 41 " in said
    found = info(shell, tmp_path / "bank.hdf5")
    assert found["cen_deg"] == pytest.approx(MARKER_DEG, abs=0.1)
    with h5py.File(tmp_path / "bank.hdf5") as bank:
        assert not bank["binary_time_series_data"][40].any()
        assert bank["binary_time_series_data"][39].any()


@pytest.mark.parametrize("suffix", [".npz", ".hdf5"])
def test_channels_are_left_out_by_hand(
    shell: Shell, tmp_path: Path, frames: np.ndarray, angles_deg: np.ndarray, suffix: str
) -> None:
    np.savez(tmp_path / "scan.npz", frames=frames, angle_deg=angles_deg, sampling_hz=SAMPLING_HZ)
    path = tmp_path / f"scan{suffix}"
    if suffix == ".hdf5":
        imported(shell, tmp_path / "scan.npz")
        (tmp_path / "bank.hdf5").rename(path)
    assert "the channels are 1 to 128" in refused(shell, path, "--without-channel", "129")
    imported(shell, path, "--without-channel", "3", "--without-channel", "128")
    with h5py.File(tmp_path / "bank.hdf5") as bank:
        silent = ~bank["binary_time_series_data"][()].any(axis=(1, 2, 3))
    assert np.flatnonzero(silent).tolist() == [2, 127]
    (tmp_path / "scan.csv").write_text("angle_deg,intensity\n1,2\n2,3\n3,1\n")
    (tmp_path / "bank.hdf5").unlink()
    assert "--without-channel is for frames" in refused(shell, tmp_path / "scan.csv", "--without-channel", "3")


@pytest.mark.parametrize("words", [(), ("--without-channel", "41", "--without-channel", "3")])
def test_channels_of_a_folder_of_frames_are_left_out(
    shell: Shell, tmp_path: Path, frames: np.ndarray, angles_deg: np.ndarray, words: tuple[str, ...]
) -> None:
    """Volts in a file for each angle; one channel is broken in some of them."""
    (folder := tmp_path / "scan").mkdir()
    for number, (angle_deg, frame) in enumerate(zip(angles_deg, frames, strict=True)):
        volts = (1.65 + 1e-6 * frame).astype(np.float32)
        volts[40] = np.nan if number > 2 else 9.0
        np.save(folder / f"{angle_deg:.6f}.npy", volts)
    assert ("channel 41 holds NaN or infinity, and is left out" in imported(shell, folder, *words)) is not bool(words)
    assert info(shell, tmp_path / "bank.hdf5")["cen_deg"] == pytest.approx(MARKER_DEG, abs=0.1)
    with h5py.File(tmp_path / "bank.hdf5") as bank:
        silent = ~bank["binary_time_series_data"][()].any(axis=(1, 2, 3))
    assert np.flatnonzero(silent).tolist() == ([2, 40] if words else [40])
    # One of its frames too.
    code, out, err = shell("frame", folder / f"{angles_deg[6]:.6f}.npy", "--json")
    assert (code, "channel 41 holds NaN" in " ".join(err.split())) == (0, True)
    assert json.loads(out)["depth_m"] == pytest.approx(0.0504, abs=0.2e-3)


LOCKS = """
import sys, h5py, time
with h5py.File(sys.argv[1], "r+") as file:
    print("locked", flush=True)
    sys.stdin.read()
"""


def test_a_locked_file_is_called_locked(shell: Shell, tmp_path: Path, frames: np.ndarray) -> None:
    path = ipasc(tmp_path / "scan.hdf5", frames)
    with subprocess.Popen(
        [sys.executable, "-c", LOCKS, path], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "locked\n"
        code, _, said = shell("replay", path)
        other.communicate("")
    assert code == 2
    assert "another program has it open for writing" in " ".join(said.split())
    assert "damaged" not in said


def test_what_is_left_out_of_a_mat_is_named(shell: Shell, tmp_path: Path, angles_deg: np.ndarray) -> None:
    cells = np.empty(3, object)
    cells[:] = [np.ones(2), np.ones(3), np.ones(4)]
    savemat(tmp_path / "scan.mat", {"frames": cells, "probe": {"pitch": 1.0}, "angle_deg": angles_deg})
    said = refused(shell, tmp_path / "scan.mat")
    assert "what cannot be read: frames (cell), probe (struct)" in said


def test_equal_axes_ask(shell: Shell, tmp_path: Path, frames: np.ndarray, angles_deg: np.ndarray) -> None:
    square = frames[:, 58:70]
    path = tmp_path / "scan.npz"
    np.savez(path, frames=square, angle_deg=angles_deg, sampling_hz=SAMPLING_HZ)
    said = refused(shell, path)
    assert "axes of equal length do not show which is which" in said
    assert "--axes angles,channels,samples or channels,angles,samples" in said
    np.testing.assert_array_equal(first_frame(path, "angles,channels,samples"), square[0])
    np.testing.assert_array_equal(first_frame(path, "channels,angles,samples"), square[:, 0])


def test_a_short_record_is_not_called_transposed(
    shell: Shell, tmp_path: Path, frames: np.ndarray, angles_deg: np.ndarray
) -> None:
    path = tmp_path / "scan.npz"
    np.savez(path, frames=frames[:, :, 800:900], angle_deg=angles_deg, sampling_hz=SAMPLING_HZ)
    said = refused(shell, path)
    assert "128 channels would have 100 samples each: if the record is so short, state it" in said
    assert "--axes angles,channels,samples; else state the order of the axes, --axes angles,samples,channels" in said
    assert "transposed" not in said
    np.testing.assert_array_equal(first_frame(path, "angles,channels,samples"), frames[0, :, 800:900])


def first_frame(path: Path, axes: str) -> np.ndarray:
    """The first frame of arrays with their axes in a stated order."""
    bank = read_bank(path, table=TableFormat(axes=tuple(axes.split(","))))
    assert isinstance(bank, FrameBank)
    return np.asarray(bank.frame(0).samples)


def test_the_lens_of_a_vantage_delays_the_sound(shell: Shell, tmp_path: Path, frames: np.ndarray) -> None:
    """Once: the light does not cross it. 5 wavelengths of 5 MHz are 1 µs, 40 samples."""

    def with_lens(workspace: Any) -> None:
        workspace.value(workspace.file["Trans"], "lensCorrection", 5.0)

    found = []
    for name, change in (("thin", None), ("thick", with_lens)):
        path = tmp_path / f"{name}.mat"
        connector = tuple(range(1, frames.shape[1] + 1))
        write_workspace(path, frames, connector=connector, spacing_mm=0.43, last_saved=True, change=change)
        bank = read_bank(path, table=TableFormat(first_and_step_deg=(7.0, 1.0)))
        assert isinstance(bank, FrameBank)
        found.append(bank.frame(6).samples)
    np.testing.assert_array_equal(found[1], found[0][:, 40:])


def test_damage_is_called_a_change_of_a_checksum_only(shell: Shell, tmp_path: Path, frames: np.ndarray) -> None:
    path = ipasc(tmp_path / "scan.hdf5", frames)
    with h5py.File(path, "r+") as file:
        del file["meta_data/ad_sampling_rate"]
        file["meta_data/ad_sampling_rate"] = np.array([1.0, 2.0])
    said = refused(shell, path, *STEPS)
    assert "ad_sampling_rate holds 2 numbers" in said
    assert "changed since" not in said


def test_variables_of_hdf5_are_named(shell: Shell, tmp_path: Path, frames: np.ndarray, angles_deg: np.ndarray) -> None:
    path = tmp_path / "scan.h5"
    with h5py.File(path, "w") as file:
        file["rf"], file["theta"], file["note"], file["more/x"] = frames, angles_deg, "of Monday", 1
    said = refused(shell, path)
    assert "angle_deg is missing, it holds rf int16 (12, 128, 2080), theta float64 (12,)" in said
    assert "what cannot be read: more (group), note (object); state the first angle" in said
    assert "or name its variables, --columns" in said
    assert answer_deg(shell, path, "--columns", "theta,rf") == pytest.approx(MARKER_DEG, abs=0.1)
    imported(shell, ipasc(tmp_path / "ipasc.hdf5", frames), *STEPS)
    assert "it is no CSV" in shell("bank", "info", tmp_path / "bank.hdf5", "--skip-invalid")[2]
