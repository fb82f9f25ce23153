"""What a command must tell its user does not hang on Python's warnings: PYTHONWARNINGS changes no output."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

ANGLES_DEG = np.arange(-20.0, 20.1, 1.0)
FILTERS = (None, "error", "ignore")


def turned_table(folder: Path) -> Path:
    """A scan across 0, whose angles below 0 were written as 340 to 359."""
    heights = 30 + 800 * np.exp(-0.5 * ((ANGLES_DEG - 3.2) / 2.6) ** 2)
    rows = [f"{angle_deg % 360:g},{height:.1f}" for angle_deg, height in zip(ANGLES_DEG, heights, strict=True)]
    path = folder / "scan.csv"
    path.write_text("\n".join(["angle_deg,intensity", *rows, ""]), encoding="utf-8")
    return path


def scaled_frames(folder: Path) -> Path:
    """Frames in volts."""
    samples = np.random.default_rng(5).normal(0, 1e-3, (ANGLES_DEG.size, 128, 900)).astype(np.float32)
    samples[:, 40:90, 600:610] += 0.2 * np.exp(-0.5 * (ANGLES_DEG / 5) ** 2)[:, None, None]
    np.savez(folder / "frames.npz", angle_deg=ANGLES_DEG, frames=samples, sampling_hz=40e6)
    return folder / "frames.npz"


def frame_in_volts(folder: Path) -> Path:
    """One of such frames."""
    np.save(folder / "frame.npy", np.load(scaled_frames(folder))["frames"][20])
    return folder / "frame.npy"


def images_with_a_gap(folder: Path) -> Path:
    """B-mode images 1, 2, 3, 5 and 6."""
    images = folder / "images"
    images.mkdir()
    for number in (1, 2, 3, 5, 6):
        image = np.random.default_rng(number).integers(5, 25, (120, 160)).astype(np.uint8)
        cv2.imwrite(str(images / f"image{number}.png"), image)
    return images


POLICY = """
import warnings

warnings.warn("of a library: this will change", FutureWarning)
warnings.warn("of a library: a division", RuntimeWarning)


class Midway:
    def __init__(self, *, limits, acquisitions):
        raise ValueError("it is only imported")
"""

STUDY = """
version = 1
trials = 1

[[policies]]
method = "midway_of_this_test:Midway"
acquisitions = 9
"""


def own_policy(folder: Path) -> Path:
    """A study with a policy of one's own, on whose import libraries warn."""
    (folder / "midway_of_this_test.py").write_text(POLICY, encoding="utf-8")
    (folder / "study.toml").write_text(STUDY, encoding="utf-8")
    return folder / "study.toml"


CASES: dict[str, tuple[Callable[[Path], Path], tuple[str, ...], str]] = {
    "replay": (turned_table, ("replay", "{}", "--json"), "340 to 359 deg are read as -20 to -1 deg"),
    "bank info": (turned_table, ("bank", "info", "{}", "--json"), "340 to 359 deg are read as -20 to -1 deg"),
    "bank import": (scaled_frames, ("bank", "import", "{}", "{}.hdf5", "--json"), "it is scaled by"),
    "frame": (frame_in_volts, ("frame", "{}", "--json"), "it is scaled by"),
    "calibrate": (scaled_frames, ("calibrate", "{}", "--json"), "it is scaled by"),
    "tooltip": (images_with_a_gap, ("tooltip", "{}", "--json"), "the images numbered 4 are missing"),
    "study": (own_policy, ("study", "{}", "--json"), "the study imports the module midway_of_this_test"),
}


@pytest.mark.parametrize("case", CASES)
def test_what_is_said_does_not_hang_on_the_filters_of_warnings(tmp_path: Path, case: str) -> None:
    make, words, said = CASES[case]
    source = make(tmp_path)
    ends = []
    for chosen in FILTERS:
        (tmp_path / f"{source.name}.hdf5").unlink(missing_ok=True)
        environment = {name: each for name, each in os.environ.items() if name != "PYTHONWARNINGS"}
        environment |= {"PYTHONPATH": str(tmp_path)} | ({} if chosen is None else {"PYTHONWARNINGS": chosen})
        command = [sys.executable, "-m", "markerseek", *(word.format(source) for word in words)]
        done = subprocess.run(command, env=environment, cwd=tmp_path, capture_output=True, text=True, check=False)
        ends.append((done.returncode, done.stdout, done.stderr))
    assert ends == ends[:1] * len(FILTERS)
    code, out, err = ends[0]
    assert code not in (1, 70)
    assert sum(line.startswith("warning: ") and said in line for line in err.splitlines()) == 1
    assert "warnings.warn" not in err
    if "--json" in words and "notes" in (answer := json.loads(out)):
        assert [said in each for each in answer["notes"]] == [True]
    else:
        # An error of the command, or of the study, which has no result.
        assert code == 2
