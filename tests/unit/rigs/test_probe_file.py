"""Probes of the user's own: files, keys of a bench, and numbers that are no counts."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest

from markerseek.core import ConfigError, RecordError
from markerseek.records.banks import TableFormat, load_frame, read_arrays, read_bank
from markerseek.rigs import chosen_probe, read_rig_file
from markerseek.rigs.bench_rig import imaging_of
from markerseek.rigs.probe_file import NEEDED, read_probe_file
from markerseek.signals import ProbeKeys, probe_preset
from tests.notes import noted

EXAMPLES = Path(__file__).parents[3] / "examples"
WHOLE = {
    "elements": "64",
    "pitch_m": "3e-4",
    "sampling_hz": "40e6",
    "low_hz": "3e6",
    "high_hz": "8e6",
    "sound_speed_m_s": "1500.0",
}


def written(folder: Path, keys: dict[str, str]) -> Path:
    path = folder / "mine.toml"
    path.write_text("".join(f"{key} = {value}\n" for key, value in keys.items()))
    return path


def test_the_example_shows_every_key_with_its_default() -> None:
    path = EXAMPLES / "probes" / "linear-64.toml"
    shown = tomllib.loads(path.read_text(encoding="utf-8"))
    assert shown.keys() == set(ProbeKeys.__struct_fields__) | {"sampling_hz"}
    preset = read_probe_file(path)
    usual = probe_preset("BPL9-5/55")
    for key in shown.keys() - set(NEEDED):
        assert getattr(preset, key) == getattr(usual, key), key
    assert (preset.name, preset.array.elements, preset.array.pitch_m) == ("linear-64.toml", 64, 0.3e-3)


def test_a_preset_may_be_named_from_which_the_probe_differs(tmp_path: Path) -> None:
    preset = chosen_probe(str(written(tmp_path, {"preset": '"L3-8"', "trigger_offset_s": "1e-6"})))
    usual = probe_preset("L3-8")
    assert (preset.array, preset.low_hz, preset.trigger_offset_s) == (usual.array, usual.low_hz, 1e-6)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"pitch_m": None}, 'the key pitch_m is missing; add it, or name the preset .* preset = "BPL9-5/55"'),
        (
            {"pitch_m": None, "elements": None},
            "the keys .* and .* are missing; add them, or name the preset",
        ),
        ({"elements": "0"}, "elements is 0, it must lie between 2 and 4096"),
        ({"pitch": "1"}, "the key pitch is unknown; did you mean pitch_m"),
        ({"high_hz": "19e6"}, "the band is 3e.06 to 1.9e.07 Hz; it must ascend and end below 0.45 of the sampling"),
        ({"face_radius_m": "10.0"}, "face_radius_m is 10.0 m, it must lie in"),
        ({"sampling_hz": '"fast"'}, 'sampling_hz is text, it must be a number or "none"'),
        ({"preset": '"X"'}, "probe 'X' is not known; choose one of"),
    ],
)
def test_a_probe_file_with_a_fault_is_refused_with_its_name(
    tmp_path: Path, change: dict[str, str | None], message: str
) -> None:
    keys = {key: value for key, value in (WHOLE | change).items() if value is not None}
    with pytest.raises(ConfigError, match=message) as caught:
        read_probe_file(written(tmp_path, keys))
    assert "mine.toml" in str(caught.value)


def bench_file(folder: Path, probe: str) -> Path:
    path = folder / "rig.toml"
    text = 'kind = "bench"\n[stage]\nport = "a"\nzero_deg = 0.0\n[laser]\nport = "b"\n[receiver]\nfolder = "daq"\n'
    path.write_text(text + "[probe]\n" + probe)
    return path


def test_a_bench_takes_the_same_keys(tmp_path: Path) -> None:
    settings = read_rig_file(bench_file(tmp_path, "pitch_m = 3e-4\nlow_hz = 3e6\nhigh_hz = 8e6\n"))
    preset = imaging_of(settings.probe, sampling_hz=settings.receiver.sampling_hz).preset  # type: ignore[union-attr, arg-type]
    assert (preset.array.elements, preset.array.pitch_m, preset.low_hz, preset.high_hz) == (128, 3e-4, 3e6, 8e6)
    assert preset.name == "BPL9-5/55 with own keys"
    usual = read_rig_file(bench_file(tmp_path, ""))
    assert imaging_of(usual.probe, sampling_hz=40e6).preset == probe_preset("BPL9-5/55")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("probe", "message"),
    [
        ("elements = 64\n", r"probe: elements is 64, the receiver \(sonixdaq\) records 128"),
        ("low_hz = 9.5e6\n", "the band is 9.5e"),
    ],
)
def test_a_bench_refuses_a_probe_that_cannot_be(tmp_path: Path, probe: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        read_rig_file(bench_file(tmp_path, probe))


VOLTS = 1e-3 * np.random.default_rng(3).standard_normal((4, 5, 60))


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_floats_of_a_scan_have_one_scale(tmp_path: Path, kind: type) -> None:
    volts = VOLTS.astype(kind)
    np.save(tmp_path / "scan.npy", volts)
    with noted("is taken off float.*; it is scaled by .*, its loudest sound to 16384 counts"):
        array = read_arrays(tmp_path / "scan.npy", table=TableFormat(first_and_step_deg=(-3.0, 2.0)))
    folder = tmp_path / "scan"
    folder.mkdir()
    for index, angle_deg in enumerate(array.angles_deg):
        np.save(folder / f"{angle_deg:g}.npy", volts[index])
    with noted("is scaled by"):
        files = read_bank(folder)
    sound = volts.astype(float) - np.median(volts.astype(float), axis=2, keepdims=True)
    # Of five channels the loudest has no say.
    loudest = np.sort(np.abs(sound).max(axis=2), axis=1)[:, -2].max()
    expected = np.rint(16384 * sound / loudest)
    for index in range(4):
        for bank in (array, files):
            np.testing.assert_array_equal(bank.frame(index).samples, expected[index])  # type: ignore[union-attr]


@pytest.mark.parametrize("kind", [np.float64, np.int32, np.uint8, np.int64])
def test_whole_numbers_of_any_type_are_counts(tmp_path: Path, kind: type) -> None:
    counts = np.random.default_rng(1).integers(0, 200, (5, 60))
    np.save(tmp_path / "frame.npy", counts.astype(kind))
    np.testing.assert_array_equal(load_frame(tmp_path / "frame.npy").samples, counts)


def test_numbers_that_are_no_samples_are_refused(tmp_path: Path) -> None:
    for name, values, message in (
        ("nan", np.full((2, 9), np.nan), "a sample is not finite"),
        ("truth", np.zeros((2, 9), bool), "bool found, real numbers are expected"),
    ):
        np.save(tmp_path / f"{name}.npy", values)
        with pytest.raises(RecordError, match=message):
            load_frame(tmp_path / f"{name}.npy")
    folder = tmp_path / "mixed"
    folder.mkdir()
    for angle_deg, values in ((1, np.ones((5, 60), np.int16)), (2, VOLTS[0]), (3, VOLTS[1])):
        np.save(folder / f"angle_{angle_deg}.npy", values)
    with pytest.raises(RecordError, match="float64 and int16 found side by side; save all frames of a scan alike"):
        read_bank(folder).frame(1)  # type: ignore[union-attr]
