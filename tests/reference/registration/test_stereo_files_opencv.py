"""Calibrations of a stereo endoscope in files that OpenCV writes."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from markerseek.core import ConfigError
from markerseek.registration import read_stereo
from tests.sensor_parts import DISTORTION, MATRIX, SENSOR


@pytest.fixture(autouse=True)
def _elsewhere(monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory) -> None:
    """``register`` writes registration.json into the current folder."""
    monkeypatch.chdir(tmp_path_factory.mktemp("here"))


RIGHT = np.array([[1088.0, 0, 640.0], [0, 1101.0, 505.0], [0, 0, 1]])


PAIR_TURN = Rotation.from_rotvec([0.01, -0.02, 0.005]).as_matrix()


PAIR_SHIFT_M = np.array([-5.2e-3, 1e-4, 2e-4])


def opencv_values(*, unit_m: float = 1e-3) -> dict[str, object]:
    """What ``stereo_calib`` writes, with the size of the images."""
    values: dict[str, object] = {
        "M1": MATRIX, "D1": DISTORTION, "M2": RIGHT, "D2": DISTORTION[None, :4],
    }  # fmt: skip
    return values | {"R": PAIR_TURN, "T": PAIR_SHIFT_M[:, None] / unit_m, "image_width": 1280, "image_height": 1024}


def written(path: Path, values: dict[str, object]) -> Path:
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, value in values.items():
        storage.write(name, value)
    storage.release()
    return path


@pytest.mark.parametrize("suffix", [".yml", ".yaml", ".xml", ".json"])
@pytest.mark.parametrize("parts", [1, 2])
@pytest.mark.parametrize("unit_m", [1e-3, 1.0])
def test_calibrations_of_opencv_are_read(tmp_path: Path, suffix: str, parts: int, unit_m: float) -> None:
    values = opencv_values(unit_m=unit_m)
    names = list(values)
    pieces = [names] if parts == 1 else [names[:4], names[4:]]
    paths = [
        written(tmp_path / f"{number}{suffix}", {name: values[name] for name in piece})
        for number, piece in enumerate(pieces)
    ]
    found = read_stereo(paths, calibration_sigma_px=0.2)
    assert (found.left.focal_px, found.left.centre_px, found.left.size_px) == ((1090.0, 1105.0), (652.0, 498.0), SENSOR)
    assert found.right.centre_px == (640.0, 505.0)
    assert found.left.distortion == pytest.approx(DISTORTION)
    assert found.right.distortion == pytest.approx([*DISTORTION[:4], 0.0])
    assert found.rotation_vector == pytest.approx([0.01, -0.02, 0.005])
    assert found.translation_m == pytest.approx(PAIR_SHIFT_M)


def test_plain_json_with_other_names_is_read(tmp_path: Path) -> None:
    values = {
        "cameraMatrix1": MATRIX.tolist(), "distCoeffs1": [DISTORTION.tolist()], "cameraMatrix2": RIGHT.tolist(),
        "distCoeffs2": DISTORTION.tolist(), "R": PAIR_TURN.tolist(), "T": [[1e3 * each] for each in PAIR_SHIFT_M],
        "imageSize": [1280, 1024],
    }  # fmt: skip
    (tmp_path / "a.json").write_text(json.dumps(values))
    found = read_stereo([tmp_path / "a.json"], calibration_sigma_px=0.2)
    assert found.translation_m == pytest.approx(PAIR_SHIFT_M)
    assert found.right.size_px == SENSOR


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"image_width": None, "image_height": None}, "size of the images is missing; add two lines"),
        ({"M2": None}, "the right camera matrix is missing; it is read as one of: M2, K2"),
        ({"T": PAIR_SHIFT_M * 40}, "was the size of the target's squares given"),
        ({"D1": np.array([0.1, 0, 0, 0, 0, 0.2, 0, 0])}, "left distortion has 8 coefficients, five are understood"),
        ({"R": np.eye(3) * 2}, "rotation .R. is no rotation"),
        ({"D1": np.zeros(3)}, "holds 3 numbers, 4 or 5 or 8"),
        ({"M1": MATRIX * np.nan}, "9 finite ones are expected"),
        ({"M2": RIGHT.T}, "right camera matrix has the rows 0 1101 0 and 640 505 1 .* MATLAB writes it transposed"),
    ],
)
def test_what_is_no_calibration_of_opencv_says_why(tmp_path: Path, changes: dict[str, object], said: str) -> None:
    values = {name: value for name, value in (opencv_values() | changes).items() if value is not None}
    with pytest.raises(ConfigError, match=f"a.yml: .*{said}"):
        read_stereo([written(tmp_path / "a.yml", values)], calibration_sigma_px=0.2)


def test_text_that_opencv_cannot_read_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.yml").write_text("%YAML:1.0\n---\nM1: [1, 2")
    with pytest.raises(ConfigError, match=r"a\.yml: OpenCV cannot read it"):
        read_stereo([tmp_path / "a.yml"], calibration_sigma_px=0.2)


def test_two_calibrations_of_opencv_are_not_mixed(tmp_path: Path) -> None:
    first = written(tmp_path / "a.yml", opencv_values())
    second = written(tmp_path / "b.yml", opencv_values())
    assert read_stereo([first, second], calibration_sigma_px=0.2).left.size_px == SENSOR
    written(second, opencv_values() | {"D2": DISTORTION * 0.5})
    with pytest.raises(ConfigError, match=r"b\.yml: the right distortion differs from that of .*a\.yml"):
        read_stereo([first, second], calibration_sigma_px=0.2)
