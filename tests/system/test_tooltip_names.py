"""`tooltip` with images whose names are numbers or angles, and with image regions of several scales."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import pytest
from pydicom.dataset import Dataset

from tests.tip_images import dicom, eleven_tip_images, region

Shell = Callable[..., tuple[int, str, str]]


Grey = npt.NDArray[np.uint8]


HALF_DEG = pytest.approx(4.41, abs=0.05)
"""Half range of the simulated tip with pixels of 0.15 mm."""


PIXEL_MM = 0.15


def folder_of(path: Path, names: Sequence[str], images: Grey | None = None) -> Path:
    path.mkdir()
    for name, image in zip(names, eleven_tip_images() if images is None else images, strict=True):
        cv2.imwrite(str(path / f"{name}.png"), image)
    return path


def answer(shell: Shell, *words: object) -> dict[str, Any]:
    code, out, err = shell("tooltip", *words, "--json")
    assert code == 0, err
    found: dict[str, Any] = json.loads(out)
    return found


@pytest.mark.parametrize(
    "names",
    [
        [f"frame{number}" for number in range(1, 12)],
        [f"{number}" for number in range(95, 106)],
        [f"img-{number}" for number in range(11)],
    ],
    ids=lambda names: names[0],
)
def test_images_are_counted_by_their_numbers(shell: Shell, tmp_path: Path, names: list[str]) -> None:
    report = answer(shell, folder_of(tmp_path / "scan", names), "--pixel-mm", PIXEL_MM)
    assert (report["reference_deg"], report["half_range_deg"]) == (0, HALF_DEG)
    assert [each["image"] for each in report["images"]] == [f"{name}.png" for name in names]


@pytest.mark.parametrize(
    ("pattern", "step_deg", "first_deg"),
    [("{:.1f}", 1, -5), ("angle_{:g}", 2.5, -12.5), ("{:g}deg", 1, 3), ("img_{:+.2f}", 0.25, -1)],
)
def test_names_that_are_angles_are_the_angles(
    shell: Shell, tmp_path: Path, pattern: str, step_deg: float, first_deg: float
) -> None:
    angles_deg = [first_deg + step_deg * number for number in range(11)]
    scan = folder_of(tmp_path / "scan", [pattern.format(angle_deg) for angle_deg in angles_deg])
    report = answer(shell, scan, "--pixel-mm", PIXEL_MM)
    assert [each["angle_deg"] for each in report["images"]] == angles_deg
    assert report["reference_deg"] == first_deg
    assert report["half_range_deg"] == pytest.approx(4.41 * step_deg, abs=0.05 * step_deg)
    code, _, err = shell("tooltip", scan, "--step-deg", 2 * step_deg)
    assert (code, "the names of the images are angles" in err) == (2, True), err


@pytest.mark.parametrize(
    "names", [["img-1.5", "img-0.5", "img0.5"], ["img-0.5", "img-1.5", "img-2.5"], ["−1", "0", "1"]]
)
def test_a_hyphen_that_may_be_a_minus_is_not_guessed(shell: Shell, tmp_path: Path, names: list[str]) -> None:
    scan = folder_of(tmp_path / "scan", names, eleven_tip_images()[[0, 3, 7]])
    code, _, err = shell("tooltip", scan)
    assert (code, "its hyphen may be a minus or not" in err) == (2, True), err
    angles = tmp_path / "angles.csv"
    angles.write_text("".join(f"{name}.png,{number}\n" for number, name in enumerate(names)), encoding="utf-8")
    assert answer(shell, scan, "--angles", angles, "--pixel-mm", PIXEL_MM)["reference_deg"] == 0


def test_an_image_keeps_its_number_where_others_are_missing(shell: Shell, tmp_path: Path) -> None:
    kept = [0, 1, 3, 4, 5, 7, 8, 9, 10]
    names = [f"frame{number + 1}" for number in kept]
    scan = folder_of(tmp_path / "scan", names, eleven_tip_images()[kept])
    code, out, err = shell("tooltip", scan, "--first-deg", 2, "--step-deg", 0.5, "--pixel-mm", PIXEL_MM, "--json")
    assert code == 0
    assert "the images numbered 3, 7 are missing; the others keep their angles" in " ".join(err.split())
    report = json.loads(out)
    assert [each["angle_deg"] for each in report["images"]] == [2 + 0.5 * number for number in kept]
    # Every tenth number is another way to count, not nine missing images each time.
    tens = folder_of(tmp_path / "tens", [f"frame{10 * number}" for number in range(11)])
    assert answer(shell, tens, "--pixel-mm", PIXEL_MM)["half_range_deg"] == HALF_DEG


def two_regions(*, tip_right: bool) -> tuple[Grey, list[Dataset], str]:
    """The images beside another image region of 1 mm pixels; the regions, and a rectangle around the tip."""
    images = eleven_tip_images()
    _, rows, columns = images.shape
    other = np.full_like(images, 40)
    offset = columns if tip_right else 0
    first = ((0, 0), (rows - 1, columns - 1))
    second = ((0, columns), (rows - 1, 2 * columns - 1))
    scales = (1.0, PIXEL_MM) if tip_right else (PIXEL_MM, 1.0)
    regions = [region(*place, scale) for place, scale in zip((first, second), scales, strict=True)]
    pair = (other, images) if tip_right else (images, other)
    return np.concatenate(pair, axis=2), regions, f"125,{111 + offset},57,72"


@pytest.mark.parametrize("tip_right", [True, False])
def test_the_region_that_holds_the_rectangle_gives_the_scale(shell: Shell, tmp_path: Path, tip_right: bool) -> None:
    images, regions, roi = two_regions(tip_right=tip_right)
    path = dicom(tmp_path / "scan.dcm", images, SequenceOfUltrasoundRegions=regions, PixelSpacing=[1, 1])
    report = answer(shell, path, "--roi", roi)
    assert (report["half_range_deg"], report["pixel_mm"]) == (HALF_DEG, pytest.approx([PIXEL_MM, PIXEL_MM]))
    code, _, err = shell("tooltip", path)
    assert code == 2
    assert "image regions of several scales" in err
    assert "name a rectangle that lies in one of them" in err
    report = answer(shell, path, "--pixel-mm", PIXEL_MM)
    assert (report["half_range_deg"], report["pixel_size"]) == (HALF_DEG, "as given")


def item(**tags: object) -> Dataset:
    made = Dataset()
    for name, value in tags.items():
        setattr(made, name, value)
    return made
