"""`markerseek calibrate` as a user types it: scans that calibrate, and scans that cannot."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from markerseek.core import ChannelFrame, SearchPlan
from markerseek.records.journal import Journal
from markerseek.rigs import simulated
from markerseek.runs import configuration_of
from markerseek.sim import MarkerSettings, SimulatedSettings

Shell = Callable[..., tuple[int, str, str]]

SOURCE_DEG = 1.3


@pytest.fixture(scope="module")
def scan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A scan of the simulated rig over its marker, one file an angle."""
    folder = tmp_path_factory.mktemp("scan")
    settings = SimulatedSettings(marker=MarkerSettings(angle_deg=SOURCE_DEG, lateral_m=0.0))
    scanner = simulated(seed=5, settings=settings).scanner
    for angle_deg in np.arange(-12.0, 13.0, 1.0):
        frame = scanner.measure(float(angle_deg)).frame
        assert isinstance(frame, ChannelFrame)
        np.save(folder / f"{angle_deg:+.0f}deg.npy", frame.samples)
    return folder


def test_a_scan_over_a_source_gives_the_lines_of_rig_toml(shell: Shell, scan: Path) -> None:
    code, out, err = shell("calibrate", scan, "--json")
    assert code == 0, err
    report = json.loads(out)
    assert report["zero_deg"]["value"] == pytest.approx(SOURCE_DEG, abs=0.1)
    assert f"zero_deg = {report['zero_deg']['value']:.3f}" in report["rig_toml"]


def test_the_pick_up_of_a_scan_says_how_steady_the_laser_is(shell: Shell, scan: Path, tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    for path in scan.iterdir():
        samples = np.load(path)
        samples[:, :40] += np.int16(1000 * (1 + 0.05 * rng.standard_normal()))
        np.save(tmp_path / path.name, samples)
    code, out, err = shell("calibrate", tmp_path, "--pickup-us", 0.0, 0.9, "--json")
    assert code == 0, err
    report = json.loads(out)
    assert report["energy_spread"] == pytest.approx(0.05, rel=0.4)
    assert 'energy_from = "pickup"\npickup_us = [0.0, 0.9]\nusual_energy = ' in report["rig_toml"]


@pytest.mark.parametrize("window_us", [(5, 1), ("nan", 1), (0, "nan"), (0, 2000)])
def test_a_pick_up_that_is_nowhere_in_a_frame_is_refused(shell: Shell, scan: Path, window_us: tuple[str, str]) -> None:
    code, _, err = shell("calibrate", scan, "--pickup-us", *window_us)
    assert (code, "it must be a first and a later moment of 0 to 1000 us" in " ".join(err.split())) == (2, True)


@pytest.mark.long
@pytest.mark.parametrize(
    ("direction", "zero_deg"), [("forward", 10 + SOURCE_DEG - 2), ("reverse", 10 - SOURCE_DEG + 2)]
)
def test_angle_zero_follows_the_sense_of_rotation(shell: Shell, scan: Path, direction: str, zero_deg: float) -> None:
    words = ("--zero-deg", 10, "--source-deg", 2, "--direction", direction, "--json")
    code, out, err = shell("calibrate", scan, *words)
    assert code == 0, err
    report = json.loads(out)
    low, high = report["zero_deg"]["interval95"]
    assert low < report["zero_deg"]["value"] < high
    assert report["zero_deg"]["value"] == pytest.approx(zero_deg, abs=0.1)
    assert f'direction = "{direction}"' in report["rig_toml"]


def another_probe(_scan: Path, to: Path) -> Path:
    to.mkdir()
    for number in range(10):
        np.save(to / f"{number}deg.npy", np.zeros((64, 2080), np.int16))
    return to


def intensities(_scan: Path, to: Path) -> Path:
    to.write_text("angle_deg,intensity\n1,2\n2,3\n3,1\n")
    return to


def journal(_scan: Path, to: Path) -> Path:
    begun = configuration_of(simulated(seed=1), SearchPlan(method="ternary", acquisitions=8, as_published=False,
        start_deg=0.0, dark_frames=0, stay=False))  # fmt: skip
    Journal.create(to, begun).close()
    return to


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (another_probe, "at 0 deg: frame of 64 channels: probe BPL9-5/55 has 128; choose the probe"),
        (intensities, "it holds intensities only, and calibration needs the channel data of each angle; name a folder"),
        (journal, "it is the journal of a run and no bank"),
        (lambda scan, _: scan.parent / "nowhere", "there is no such file or folder"),
    ],
)
def test_a_scan_that_cannot_calibrate_is_a_sentence_with_its_name_and_exit_code_2(
    shell: Shell, scan: Path, tmp_path: Path, make: Callable[[Path, Path], Path], said: str
) -> None:
    path = make(scan, tmp_path / "given")
    code, out, err = shell("calibrate", path, "--json")
    assert (code, json.loads(out)["kind"] in ("RecordError", "ConfigError")) == (2, True)
    assert f"error: {path}: " in err
    assert said in err
    assert err.count("error:") == 1
