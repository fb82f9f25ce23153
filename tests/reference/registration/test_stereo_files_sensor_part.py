"""Cameras that read a region of their sensor or join its pixels (camera_info): OpenCV finds the same pixels."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from markerseek.core import ConfigError
from markerseek.registration import read_stereo
from tests.sensor_parts import BASE_M, DISTORTION, MOVE_M, PARTS, TRUS_M, TURN, Part, cameras, seen


@pytest.fixture(autouse=True)
def _elsewhere(monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory) -> None:
    """``register`` writes registration.json into the current folder."""
    monkeypatch.chdir(tmp_path_factory.mktemp("here"))


@pytest.mark.parametrize("name", PARTS)
def test_its_cameras_project_to_the_pixels_of_the_images(tmp_path: Path, name: str) -> None:
    left, right = PARTS[name]
    cameras(tmp_path, left, right)
    stereo = read_stereo([tmp_path / "l.yaml", tmp_path / "r.yaml"], calibration_sigma_px=0.2)
    camera_m = TURN.inv().apply(TRUS_M - MOVE_M)
    for found, expected in zip(stereo.cameras.project(camera_m), seen(left, right), strict=True):
        np.testing.assert_allclose(found, expected, atol=1e-6)
    assert (stereo.left.size_px, stereo.right.size_px) == (left.image_size, right.image_size)


@pytest.mark.parametrize(
    ("part", "says"),
    [
        (Part(first=(400, 0), size=(1000, 800)), "roi: width is 1000 from 400, the sensor's width is 1280"),
        (Part(first=(0, 200), size=(0, 0)), "roi: height is 0 from 200"),
        (Part(first=(-4, 0), size=(1000, 800)), "roi: x_offset is -4"),
        (Part(joined=(-2, 1)), "binning_x is -2"),
        (Part(joined=(100, 1)), "size_px is 12"),
    ],
)
def test_a_part_that_cannot_be_is_refused(tmp_path: Path, part: Part, says: str) -> None:
    cameras(tmp_path, part, Part())
    with pytest.raises(ConfigError) as problem:
        read_stereo([tmp_path / "l.yaml", tmp_path / "r.yaml"], calibration_sigma_px=0.2)
    assert says in str(problem.value)


@pytest.mark.parametrize(("more", "said"), [((0.0, 0.0, 0.0), None), ((0.0, 0.1, 0.0), "8 coefficients, five are")])
def test_plumb_bob_of_eight_numbers(tmp_path: Path, more: tuple[float, ...], said: str | None) -> None:
    for name, shift_m in (("l", 0.0), ("r", -BASE_M)):
        text = Part().camera_info(shift_m, printed=True)
        (tmp_path / f"{name}.yaml").write_text(
            text.replace(str(DISTORTION.tolist()), str([*DISTORTION.tolist(), *more]))
        )
    paths = [tmp_path / "l.yaml", tmp_path / "r.yaml"]
    if said is None:
        assert read_stereo(paths, calibration_sigma_px=0.2).left.distortion == pytest.approx(DISTORTION)
    else:
        with pytest.raises(ConfigError, match=said):
            read_stereo(paths, calibration_sigma_px=0.2)
