"""`bank import` of channel data as arrays: offsets, pick-up, types of numbers, records that begin late, energies."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from tests.base_scan import MARKER_DEG, SAMPLING_HZ

Shell = Callable[..., tuple[int, str, str]]


pytestmark = pytest.mark.usefixtures("notes_allowed")


STRONGEST = 7
"""Number of the frame at 13°, counted from 1."""


LATE = 400
"""Samples before the record that begins late: 10 µs."""


@pytest.fixture(scope="module")
def counts(frames: np.ndarray) -> np.ndarray:
    return frames.astype(np.int64)


@pytest.fixture(scope="module")
def volts(counts: np.ndarray) -> np.ndarray:
    """The marker's peak is 1 mV, the noise 0.08 mV."""
    return np.asarray(counts * (1e-3 / 711))


@pytest.fixture
def save(tmp_path: Path, angles_deg: np.ndarray) -> Callable[..., Path]:
    def write(frames: np.ndarray, *, suffix: str = ".npz", **known: float) -> Path:
        path = tmp_path / f"scan{suffix}"
        arrays = {"frames": frames, "angle_deg": angles_deg, "sampling_hz": SAMPLING_HZ, **known}
        if suffix == ".mat":
            savemat(path, arrays)
        else:
            np.savez(path, **arrays)
        return path

    return write


def imported(shell: Shell, path: Path, *words: object) -> tuple[Path, str]:
    """The bank of a file of arrays, and what its import said."""
    bank = path.with_name("bank.hdf5")
    code, _, said = shell("bank", "import", path, bank, *words)
    assert code == 0, said
    return bank, " ".join(said.split())


def centre_deg(shell: Shell, bank: Path) -> float:
    """Middle of the intensities at half height, of ``bank info``; 12.495° of the counts themselves."""
    code, out, err = shell("bank", "info", bank, "--json")
    assert code == 0, err
    return float(json.loads(out)["cen_deg"])


def strongest(shell: Shell, path: Path, *words: object) -> dict[str, Any]:
    """What ``frame`` says of one frame."""
    code, out, err = shell("frame", path, *words, "--json")
    assert code == 0, err
    found: dict[str, Any] = json.loads(out)
    return found


def found_at_the_marker(shell: Shell, bank: Path, *words: object) -> None:
    code, out, err = shell("replay", bank, "--json", *words)
    answer = json.loads(out)
    assert code == 0, (answer["reason"], err)
    assert answer["angle_deg"] == pytest.approx(MARKER_DEG, abs=0.2)
    assert answer["sigma_deg"] < 0.2
    assert answer["others"] == []


RANDOM = np.random.default_rng(45)


OFFSETS_V = {
    "1.65 V": 1.65,
    "-0.3 V": -0.3,
    "another of each channel": RANDOM.uniform(-2.5, 2.5, (1, 128, 1)),
    "another of each channel and frame": RANDOM.uniform(-2.5, 2.5, (12, 128, 1)),
}


@pytest.mark.parametrize("offset", OFFSETS_V)
def test_volts_with_an_offset_are_read_as_those_without(
    shell: Shell, save: Callable[..., Path], volts: np.ndarray, offset: str
) -> None:
    kind, suffix = (np.float32, ".mat") if offset == "1.65 V" else (np.float64, ".npz")
    bank, said = imported(shell, save((volts + OFFSETS_V[offset]).astype(kind), suffix=suffix))
    assert f"the median of each channel is taken off {np.dtype(kind)}; it is scaled by" in said
    assert "clipped" not in said
    assert centre_deg(shell, bank) == pytest.approx(12.495, abs=0.01)
    # The counts themselves have 39.46 dB at 13°.
    assert strongest(shell, bank, "--number", STRONGEST)["peak_snr_db"] == pytest.approx(39.46, abs=0.3)


def test_noise_below_a_count_is_said(shell: Shell, save: Callable[..., Path], volts: np.ndarray) -> None:
    """Something of 5 V in a quarter of the channels, where it is imaged: it may be sound, and is kept."""
    loud = volts.copy()
    loud[:, ::4, 1900] = 5.0
    _, said = imported(shell, save(loud))
    assert "counts only, and what is weaker than a count is lost" in said, said


@pytest.mark.parametrize("marker_mv", [0.3, 0.1])
def test_a_pick_up_of_a_volt_is_passed_over(
    shell: Shell, save: Callable[..., Path], volts: np.ndarray, marker_mv: float
) -> None:
    frames = marker_mv * volts
    frames[:, :, :90] += np.exp(-np.arange(90) / 20)
    bank, said = imported(shell, save(frames))
    assert "138240 samples (4.3 %) lie beyond int16 and are clipped" in said
    assert "counts only" not in said
    found_at_the_marker(shell, bank)


def test_what_a_probe_of_ones_own_blanks_is_passed_over(
    shell: Shell, volts: np.ndarray, angles_deg: np.ndarray, tmp_path: Path
) -> None:
    """A pick-up of 9 µs, in a third of the channels; a folder of frames, and one of them."""
    (probe := tmp_path / "mine.toml").write_text('preset = "BPL9-5/55"\npickup_samples = 400\n')
    frames = 0.1 * volts
    frames[:, ::3, :360] += 1.0
    (folder := tmp_path / "scan").mkdir()
    for angle_deg, frame in zip(angles_deg, frames, strict=True):
        np.save(folder / f"{angle_deg:.6f}.npy", frame.astype(np.float32))
    found = strongest(shell, sorted(folder.iterdir())[0].with_name(f"{angles_deg[6]:.6f}.npy"), "--probe", probe)
    assert (found["found"], found["depth_m"]) == (True, pytest.approx(0.0504, abs=0.2e-3))
    code, out, err = shell("bank", "info", folder, "--probe", probe, "--json")
    assert code == 0, err
    assert json.loads(out)["cen_deg"] == pytest.approx(12.495, abs=0.01)


TYPES: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "int32": lambda counts: (counts * 3000).astype(np.int32),
    "int32 with a glitch": lambda counts: np.where(
        np.arange(counts[0].size).reshape(counts[0].shape) == 77_777, 9_000_000, counts
    ).astype(np.int32),
    "int32, 24 bits offset binary": lambda counts: (counts * 9000 + 2**23).astype(np.int32),
    "uint16, offset binary": lambda counts: (counts + 32768).astype(np.uint16),
    "uint16, with a glitch at full scale": lambda counts: np.where(
        np.arange(counts[0].size).reshape(counts[0].shape) == 77_777, 65_535, counts + 32768
    ).astype(np.uint16),
    "int16 with a glitch at full scale": lambda counts: np.where(
        np.arange(counts[0].size).reshape(counts[0].shape) == 99_999, -32768, counts
    ).astype(np.int16),
    "uint16, 16 bits offset binary": lambda counts: (counts * 40 + 32768).astype(np.uint16),
    "uint16, another offset": lambda counts: (counts + 41_000).astype(np.uint16),
    "uint16, 12 bits offset binary": lambda counts: (counts + 2048).astype(np.uint16),
    "int16, 14 bits offset binary": lambda counts: (counts * 9 + 8192).astype(np.int16),
    "int16 of 16 bits": lambda counts: np.rint(counts * (25_000 / 733)).astype(np.int16),
    "int16 of 16 bits with an offset": lambda counts: (counts * 30 + 3000).astype(np.int16),
    "uint8": lambda counts: np.rint(counts / 6 + 128).astype(np.uint8),
    "float64 of whole numbers": lambda counts: (counts * 30).astype(np.float64),
}


@pytest.mark.parametrize("kind", TYPES)
def test_numbers_of_any_type_are_read(shell: Shell, save: Callable[..., Path], counts: np.ndarray, kind: str) -> None:
    bank, _ = imported(shell, save(TYPES[kind](counts)))
    assert centre_deg(shell, bank) == pytest.approx(12.495, abs=0.03)
    found = strongest(shell, bank, "--number", STRONGEST)
    assert found["peak_snr_db"] == pytest.approx(39.46, abs=0.3)
    assert found["saturated_channels"] == 0


LIMITED: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "12 bits": lambda counts: (counts * 9).clip(-2048, 2047).astype(np.int16),
    "12 bits, offset binary": lambda counts: ((counts * 9).clip(-2048, 2047) + 2048).astype(np.uint16),
    "16 bits": lambda counts: (counts * 90).clip(-32768, 32767).astype(np.int16),
    "16 bits, offset binary": lambda counts: ((counts * 90).clip(-32768, 32767) + 32768).astype(np.uint16),
    "16 bits of a receiver that ends at 20,000": lambda counts: (counts * 90).clip(-20_000, 20_000).astype(np.int16),
    "volts": lambda counts: 1.65 + (counts * 9).clip(-2048, 2047) * 1e-6,
}


@pytest.mark.parametrize("kind", LIMITED)
def test_saturation_is_seen_at_the_limit_of_the_data(
    shell: Shell, tmp_path: Path, counts: np.ndarray, kind: str
) -> None:
    np.save(tmp_path / "frame.npy", LIMITED[kind](counts[STRONGEST - 1]))
    assert strongest(shell, tmp_path / "frame.npy")["saturated_channels"] > 10


STARTS: dict[str, tuple[int, Callable[[np.ndarray], np.ndarray]]] = {
    "uint16, offset binary": (LATE, lambda counts: (counts + 32768).astype(np.uint16)),
    "uint16, 12 bits": (LATE, lambda counts: (counts + 2048).astype(np.uint16)),
    "int16 with an offset": (LATE, lambda counts: (counts + 9000).astype(np.int16)),
    "volts": (LATE, lambda counts: 2.5 + counts * 1e-6),
    "within the pick-up": (60, lambda counts: (counts + 2048).astype(np.uint16)),
    "half a sample": (777, lambda counts: (counts + 2048).astype(np.uint16)),
}


@pytest.mark.parametrize("kind", STARTS)
def test_a_record_that_begins_late_is_imaged_from_there(
    shell: Shell, save: Callable[..., Path], counts: np.ndarray, kind: str
) -> None:
    late, as_kind = STARTS[kind]
    first_s = (late + 0.4 * (kind == "half a sample")) / SAMPLING_HZ
    bank, _ = imported(shell, save(as_kind(counts)[:, :, late:], first_sample_s=first_s))
    assert centre_deg(shell, bank) == pytest.approx(12.495, abs=0.01)
    found = strongest(shell, bank, "--number", STRONGEST)
    assert found["depth_m"] == pytest.approx(0.0504, abs=0.1e-3)
    # No second source at the record's beginning.
    assert found["others"] == strongest(shell, save_npy(bank, counts))["others"] == []


def save_npy(beside: Path, counts: np.ndarray) -> Path:
    """The strongest frame as it was."""
    np.save(beside.with_name("whole.npy"), counts[STRONGEST - 1].astype(np.int16))
    return beside.with_name("whole.npy")


def test_a_record_that_begins_before_the_trigger_is_cut(
    shell: Shell, save: Callable[..., Path], counts: np.ndarray
) -> None:
    early = np.pad(counts, ((0, 0), (0, 0), (80, 0))) + 2048
    bank, _ = imported(shell, save(early.astype(np.uint16), first_sample_s=-2e-6))
    assert centre_deg(shell, bank) == pytest.approx(12.495, abs=0.01)
    assert strongest(shell, bank, "--number", STRONGEST)["depth_m"] == pytest.approx(0.0504, abs=0.1e-3)


def test_initial_times_of_zea(shell: Shell, counts: np.ndarray, angles_deg: np.ndarray, tmp_path: Path) -> None:
    late = (counts + 32768).astype(np.uint16)[:, :, LATE:]
    with h5py.File(path := tmp_path / "scan.zea.hdf5", "w") as file:
        file["tracks/track_0/data/raw_data"] = late.transpose(0, 2, 1)[:, None, :, :, None]
        file["tracks/track_0/scan/sampling_frequency"] = np.float32(SAMPLING_HZ)
        file["tracks/track_0/scan/initial_times"] = np.array([10e-6], np.float32)
        file["metadata/probe_pose/rotation"] = np.radians(np.pad(angles_deg[:, None], ((0, 0), (0, 2))))
        file["metadata/probe_pose/rotation_representation"] = "euler_xyz"
    bank, _ = imported(shell, path)
    assert centre_deg(shell, bank) == pytest.approx(12.495, abs=0.01)
    # It goes out as it came in.
    code, _, err = shell("bank", "export", bank, again := tmp_path / "again.zea.hdf5")
    assert code == 0, err
    assert centre_deg(shell, again) == pytest.approx(12.495, abs=0.01)
    with h5py.File(again) as file:
        assert file["tracks/track_0/scan/initial_times"][0] == pytest.approx(10e-6)


def test_a_window_may_begin_later_than_it_is_long(shell: Shell, save: Callable[..., Path], volts: np.ndarray) -> None:
    bank, _ = imported(shell, save(1.65 + volts[:, :, 1000:1900], first_sample_s=25e-6))
    found_at_the_marker(shell, bank)
    found = strongest(shell, bank, "--number", STRONGEST)
    assert (found["depth_m"], found["others"]) == (pytest.approx(0.0504, abs=0.1e-3), [])


@pytest.mark.parametrize(
    ("first_sample_s", "message"),
    [
        (25.0, "the first sample is 2.5e+07 µs after the trigger, at most 200 µs may be"),
        (250e-6, "the first sample is 250 µs after the trigger, at most 200 µs may be"),
        (-60e-6, "the first sample is 60 µs before the trigger, and the 2080 samples of a frame end before it"),
    ],
)
def test_a_first_sample_that_cannot_be_is_refused(
    shell: Shell, save: Callable[..., Path], counts: np.ndarray, first_sample_s: float, message: str
) -> None:
    path = save(counts.astype(np.int16), first_sample_s=first_sample_s)
    code, _, err = shell("bank", "import", path, path.with_name("bank.hdf5"))
    assert code == 2
    assert message in " ".join(err.split())
    assert "correct it, in seconds" in " ".join(err.split())


def test_an_energy_of_each_angle_takes_the_laser_out_of_the_intensities(
    shell: Shell, counts: np.ndarray, angles_deg: np.ndarray, tmp_path: Path
) -> None:
    energy_mj = 20 * RANDOM.uniform(0.5, 1.5, len(counts))
    scaled = np.rint(counts * (energy_mj / energy_mj.mean())[:, None, None]).astype(np.int16)
    held = {"angle_deg": angles_deg[::-1], "frames": scaled[::-1]}
    np.savez(tmp_path / "plain.npz", **held)
    np.savez(tmp_path / "scan.npz", **held, energy=energy_mj[::-1])
    plain, _ = imported(shell, tmp_path / "plain.npz")
    assert abs(centre_deg(shell, plain) - 12.495) > 0.02
    plain.unlink()
    bank, _ = imported(shell, tmp_path / "scan.npz")
    assert centre_deg(shell, bank) == pytest.approx(12.495, abs=0.01)
    found_at_the_marker(shell, bank)
    np.savez(tmp_path / "short.npz", **held, energy=energy_mj[1:])
    code, _, err = shell("bank", "import", tmp_path / "short.npz", tmp_path / "short.hdf5")
    assert (code, f"energy must be {len(counts)} positive numbers, one for each angle" in err) == (2, True), err
