"""Frames of another probe than ours, described in a TOML file, through every command that images them."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from markerseek.acoustics import Absorber, AcousticModel, GaussianAbsorber, Probe, RectanglePulse
from markerseek.core import LinearArray

# Printed by the command as one line on standard error.
pytestmark = pytest.mark.filterwarnings("always:.*it is scaled by")

Shell = Callable[..., tuple[int, str, str]]

SOURCE_DEG = 1.3
SOURCE_M = 0.05
FACE_M = 10e-3


@dataclass(frozen=True, kw_only=True)
class Recorded:
    """A folder of frames and the file that describes their probe."""

    folder: Path
    probe: Path
    lateral_m: float


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    """A scan in volts, as float32, by our forward model: another array and another sampling frequency."""
    elements = 64
    pitch_m = 0.6e-3
    sampling_hz = 50e6
    folder = tmp_path_factory.mktemp(f"scan{elements}")
    rng = np.random.default_rng(elements)
    model = AcousticModel(
        probe=Probe(
            array=LinearArray(elements=elements, pitch_m=pitch_m), element_width_m=0.9 * pitch_m, face_radius_m=FACE_M
        ),
        laser=RectanglePulse(duration_s=200e-9),
        sampling_hz=sampling_hz,
        samples=2080,
    )
    source = Absorber(
        source=GaussianAbsorber(radius_m=0.15e-3), radius_m=SOURCE_M, angle_deg=SOURCE_DEG, lateral_m=4e-3, strength=1.0
    )
    largest = float(np.abs(model.channel_data([source], angle_deg=SOURCE_DEG)).max())
    frames = folder / "frames"
    frames.mkdir()
    for angle_deg in np.arange(-12.0, 12.1, 1.0).tolist():
        received = model.channel_data([source], angle_deg=angle_deg) / largest
        volts = 1e-3 * (received + 0.02 * rng.standard_normal(received.shape))
        np.save(frames / f"{angle_deg:+.0f}.npy", volts.astype(np.float32))
    probe = folder / "mine.toml"
    probe.write_text(
        f"elements = {elements}\npitch_m = {pitch_m}\nsampling_hz = {sampling_hz}\nlow_hz = 5e6\nhigh_hz = 9e6\n"
        f"sound_speed_m_s = 1540.0\nface_radius_m = {FACE_M}\n"
    )
    return Recorded(folder=frames, probe=probe, lateral_m=4e-3)


def test_one_frame_is_imaged_at_its_true_place(shell: Shell, recorded: Recorded) -> None:
    code, out, err = shell("frame", recorded.folder / "+1.npy", "--probe", recorded.probe, "--json")
    assert code == 0, err
    assert "is taken off float32; it is scaled by" in " ".join(err.split())
    found = json.loads(out)
    assert (found["found"], found["probe"], found["saturated_channels"]) == (True, "mine.toml", 0)
    assert found["lateral_m"] == pytest.approx(recorded.lateral_m, abs=0.2e-3)
    # The strongest edge of a wave that the element's height spreads lies within half a millimetre of the middle.
    assert found["depth_m"] == pytest.approx(SOURCE_M - FACE_M, abs=0.6e-3)
    code, _, err = shell("frame", recorded.folder / "+1.npy")
    assert code == 2
    assert "channels: probe BPL9-5/55 has 128; choose the probe" in " ".join(err.split())


def test_an_imported_bank_keeps_its_probe(shell: Shell, recorded: Recorded, tmp_path: Path) -> None:
    bank = tmp_path / "scan.hdf5"
    code, _, err = shell("bank", "import", recorded.folder, bank, "--probe", recorded.probe)
    assert code == 0, err
    # From here on nobody names the probe.
    code, out, err = shell("bank", "info", bank, "--json")
    info = json.loads(out)
    assert (code, err, info["probe"], info["face_radius_m"]) == (0, "", "mine.toml", FACE_M)
    assert info["cen_deg"] == pytest.approx(SOURCE_DEG, abs=0.2)
    journal = tmp_path / "run.journal"
    words = ("--method", "ternary", "--reference-deg", SOURCE_DEG, "--json")
    code, out, err = shell("replay", bank, *words, "--journal", journal)
    result = json.loads(out)
    assert result["error_deg"] < 1.0, err
    named = json.loads(shell("replay", recorded.folder, "--probe", recorded.probe, *words)[1])
    assert (named["angle_deg"], named["samples"]) == (result["angle_deg"], result["samples"])
    if result["found"]:
        _, y, z = result["marker_trus_m"]
        assert (y, z) == (pytest.approx(recorded.lateral_m, abs=0.3e-3), pytest.approx(SOURCE_M, abs=1e-3))
    assert shell("journal", "replay", journal)[0] == 0
    assert shell("resume", journal)[0] in (0, 3)


def test_a_probe_that_contradicts_the_bank_is_refused(shell: Shell, recorded: Recorded, tmp_path: Path) -> None:
    bank = tmp_path / "scan.hdf5"
    other = tmp_path / "other.toml"
    assert shell("bank", "import", recorded.folder, bank, "--probe", recorded.probe)[0] == 0
    other.write_text(recorded.probe.read_text().replace("pitch_m = 0.000", "pitch_m = 0.001"))
    code, _, err = shell("replay", bank, "--probe", other)
    assert code == 2
    assert "probe other.toml: pitch_m is 0.001" in " ".join(err.split())
    assert "and the recording says 0.000" in " ".join(err.split())
