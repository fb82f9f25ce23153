"""Scans whose angles cross 360 or ±180 degrees."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from markerseek.records.banks import read_bank
from markerseek.search import Curve, peak_of
from tests.notes import noted
from tests.written_tables import read, small

Shell = Callable[..., tuple[int, str, str]]

WRAPPED = {
    # angles as recorded, where the marker is among them, the range and the marker's place once unwrapped
    "0": (np.r_[312:360:0.5, 0:23:0.5], 355.2, (-48, 22.5), -4.8),
    "0, no 0": (np.r_[312:360:0.5, 0.5:23:0.5], 0.4, (-48, 22.5), 0.4),
    "360 and 0": (np.r_[312:360.5:0.5, 0:23:0.5], 3.0, (-48, 22.5), 3.0),
    "180": (np.r_[150:180:0.5, -180:-149.5:0.5], -178.3, (150, 210), 181.7),
    "180, mostly below": (np.r_[170:180:0.5, -180:-129.5:0.5], 176.0, (-190, -130), -184.0),
    "tenths": (np.r_[340:360:0.7, 0.3:30:0.7], 359.0, (-20, 29.7), -1.0),
    "more than half a turn": (np.r_[200:360:1.0, 0:101:1.0], 359.0, (-160, 100), -1.0),
}


ORDERS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "as scanned": lambda angles: angles,
    "down": lambda angles: angles[::-1],
    "sorted": np.sort,
    "shuffled": lambda angles: np.random.default_rng(2).permutation(angles),
}


def curve(angles: np.ndarray, marker_deg: float) -> np.ndarray:
    off = (angles - marker_deg + 180) % 360 - 180
    return 400 + 7900 * np.exp(-0.5 * (off / 2) ** 2) + np.random.default_rng(1).normal(0, 20, angles.size)


def wrapped_table(folder: Path, angles: np.ndarray, marker_deg: float) -> Path:
    return small(folder, "angle_deg,intensity", *map("{0:.1f},{1:.2f}".format, angles, curve(angles, marker_deg)))


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("name", WRAPPED)
@pytest.mark.usefixtures("notes_allowed")
def test_a_scan_across_a_turn_is_unwrapped(tmp_path: Path, name: str, order: str) -> None:
    recorded, marker_deg, (low_deg, high_deg), found_deg = WRAPPED[name]
    path = wrapped_table(tmp_path, ORDERS[order](recorded), marker_deg)
    with noted(f"it runs from {low_deg:g} to {high_deg:g} deg, and all angles of the answer"):
        bank = read_bank(path)
    assert (bank.range.low_deg, bank.range.high_deg) == (low_deg, high_deg)
    assert max(np.diff(bank.angles_deg)) <= 1.000001
    peak = peak_of(Curve(angle_deg=np.array(bank.angles_deg), intensity=np.array(bank.intensities)))
    assert [peak.com_deg, peak.cen_deg] == pytest.approx([found_deg] * 2, abs=0.2)


@pytest.mark.parametrize(
    ("angles", "says"),
    [
        (np.arange(170, 231.0), None),  # beyond 180 without a jump
        (np.arange(300, 361.0), None),
        (np.r_[-60:-29.0, 30:61.0], None),  # two parts of a scan: the gap is not the rest of the turn
        (np.array([-100.0, 0, 100]), None),
        (np.arange(-179, 180, 2.0), "cover the full circle"),
        (np.arange(0, 361, 5.0), "cover the full circle"),
        (np.delete(np.arange(0, 360, 5.0), 20), "cover the full circle"),  # one angle is missing
    ],
)
def test_other_scans_keep_their_angles(tmp_path: Path, angles: np.ndarray, says: str | None) -> None:
    path = small(tmp_path, "angle_deg,intensity", *(f"{angle},{1 + index}.5" for index, angle in enumerate(angles)))
    if says is None:
        assert read(path)[0] == angles.tolist()
    else:
        with noted(says):
            assert read(path)[0] == angles.tolist()


def test_the_unwrapped_scan_is_searched_and_that_is_said_once(shell: Shell, tmp_path: Path) -> None:
    angles, marker_deg, _, found_deg = WRAPPED["0"]
    path = wrapped_table(tmp_path, angles[::2], marker_deg)
    code, out, err = shell("replay", path, "--tolerance-deg", 2, "--reference-deg", marker_deg, "--json")
    said = json.loads(out)
    assert (code, said["angle_deg"]) == (0, pytest.approx(found_deg, abs=1))
    assert said["reference_deg"] == pytest.approx(found_deg)
    assert " ".join(err.split()).count("jump by a full turn") == 1
