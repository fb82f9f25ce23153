"""Folders into which another process writes images, in the manners of programs in laboratories."""

from __future__ import annotations

import errno
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from markerseek.core import AcquisitionError, ConfigError, DeviceError, NotConnectedError, StereoImages, StereoPair
from markerseek.drivers import FolderImages, folder_images, open_stereo_images
from markerseek.geometry import Camera
from tests.notes import noted
from tests.unit.drivers.image_writer import encoded, in_two_halves

pytestmark = pytest.mark.real_time

CAMERA = Camera(focal_px=(150.0, 150.0), centre_px=(79.5, 63.5), size_px=(160, 128))
WRITER = Path(__file__).with_name("image_writer.py")


@pytest.fixture
def folders(tmp_path: Path) -> tuple[Path, Path]:
    made = tmp_path / "left", tmp_path / "right"
    for folder in made:
        folder.mkdir()
    return made


@pytest.fixture
def source(folders: tuple[Path, Path]) -> Iterator[StereoImages]:
    with FolderImages(folders, (CAMERA, CAMERA)) as opened:
        yield opened


def pairs_of(source: StereoImages, *, until: Callable[[list[StereoPair]], bool], limit_s: float) -> list[StereoPair]:
    found: list[StereoPair] = []
    ends_s = time.monotonic() + limit_s
    while not until(found) and time.monotonic() < ends_s:
        found += source.newest()
        time.sleep(0.02)
    return found


def written(folders: tuple[Path, Path], manner: str, pairs: int) -> subprocess.Popen[str]:
    command = [sys.executable, str(WRITER), *map(str, folders), manner, str(pairs)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True)


@pytest.mark.parametrize(
    ("manner", "values", "off"),
    [
        ("in halves", range(1, 31), 0),
        ("renamed", range(1, 31), 0),
        ("right late", range(1, 22), 0),
        ("restarting", range(1, 31), 0),
        ("by time", range(1, 31, 2), 1),
    ],
)
def test_every_pair_comes_once_in_order_and_whole(
    folders: tuple[Path, Path], manner: str, values: range, off: int
) -> None:
    for folder in folders:
        for number in range(1000 if manner == "in halves" else 8):
            (folder / f"{number}.bmp").write_bytes(b"of before")
        (folder / "notes.txt").write_text("no image")
        (folder / "folder.png").mkdir()
    with open_stereo_images([*map(str, folders)], left=CAMERA, right=CAMERA) as source:
        began_s = time.monotonic()
        with written(folders, manner, 30) as process:
            found = pairs_of(source, until=lambda pairs: len(pairs) >= len(values), limit_s=30)
            times_s = [float(line) for line in process.stdout]
        assert pairs_of(source, until=bool, limit_s=0.3) == []
    # JPEG is not exact.
    lefts = [int(pair.left.min()) for pair in found]
    assert lefts == list(values)
    for pair in found:
        assert pair.left.shape == pair.right.shape == (128, 160)
        assert np.abs(pair.right.astype(int) - int(pair.left[0, 0])).max() <= off
        assert began_s < pair.at_s
    if manner != "right late":
        late_s = [pair.at_s - times_s[value - 1] for pair, value in zip(found, values, strict=True)]
        assert np.median(np.abs(late_s)) < 0.1


def test_what_never_pairs_is_said(
    folders: tuple[Path, Path], source: StereoImages, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("markerseek.drivers._pair_source._FIRST_S", 3.0)
    with written(folders, "apart", 40) as process:
        with pytest.raises(
            AcquisitionError, match="of the right came, and no pair among them; a pair has the same num"
        ):
            pairs_of(source, until=lambda _: False, limit_s=20)
        process.kill()


def test_an_incomplete_file_is_named_once_and_others_come_all_the_same(
    folders: tuple[Path, Path], source: StereoImages
) -> None:
    for folder in folders:
        (folder / "1.png").write_bytes(encoded(1)[:-30] if folder is folders[1] else encoded(1))
        (folder / "2.png").write_bytes(encoded(2))
    with noted("not complete") as said:
        found = pairs_of(source, until=lambda _: False, limit_s=3.5)
    assert [each.split(" for 2 s, and is left out")[0] for each in said] == [
        f"{folders[1] / '1.png'}: it is not complete, or no image,"
    ]
    assert [int(pair.left[0, 0]) for pair in found] == [2]


@pytest.mark.parametrize("takes_s", [0.15, 1.2])
def test_where_reading_is_too_slow_whole_pairs_are_left_out_and_the_rates_are_said(
    folders: tuple[Path, Path], source: StereoImages, monkeypatch: pytest.MonkeyPatch, takes_s: float
) -> None:
    decoded = folder_images.decoded_image

    def slowly(data: bytes) -> np.ndarray | None:
        # A slow decoder.
        time.sleep(takes_s)
        return decoded(data)

    monkeypatch.setattr(folder_images, "decoded_image", slowly)
    with written(folders, "renamed", 250) as process:
        with noted("are read more slowly") as said:
            found = pairs_of(source, until=lambda pairs: len(pairs) >= 3 and process.poll() is not None, limit_s=16)
        process.kill()
    assert len(found) >= 3
    for pair in found:
        assert (pair.left == pair.right).all()
    values = [int(pair.left[0, 0]) for pair in found]
    assert values == sorted(values)
    # Of the newest, and not one after another of those that wait.
    assert values[-1] > 1.5 * len(values)
    (sentence,) = set(said)
    rates = re.search(r"than they come \(([0-9.]+) of ([0-9.]+) a second\); save BMP or JPEG", sentence)
    assert rates is not None
    assert float(rates[1]) <= 1.2 / takes_s
    assert float(rates[2]) > 2 * float(rates[1])


def test_slow_reading_that_gives_no_pair_is_the_reason_that_is_said(
    folders: tuple[Path, Path], source: StereoImages, monkeypatch: pytest.MonkeyPatch
) -> None:
    decoded = folder_images.decoded_image

    def slowly(data: bytes) -> np.ndarray | None:
        time.sleep(4.0)
        return decoded(data)

    monkeypatch.setattr(folder_images, "decoded_image", slowly)
    with written(folders, "renamed", 500) as process:
        with (
            noted("are read more slowly"),
            pytest.raises(AcquisitionError, match=r"images are read more slowly than they come \(0\.[0-9] of"),
        ):
            pairs_of(source, until=lambda _: False, limit_s=25)
        process.kill()


@pytest.mark.parametrize("suffix", [".webp", ".gif", ".JP2"])
def test_files_of_another_kind_are_named_if_no_images_come(
    folders: tuple[Path, Path], source: StereoImages, suffix: str
) -> None:
    for folder in folders:
        (folder / f"1{suffix}").write_bytes(b"of another kind")
    with pytest.raises(
        AcquisitionError,
        match=rf"no images come, but files that end with {suffix.lower()}; \.png, \.jpg, .*: have the program",
    ):
        pairs_of(source, until=lambda _: False, limit_s=6)


def test_files_beside_the_images_are_no_error(folders: tuple[Path, Path], source: StereoImages) -> None:
    for folder in folders:
        (folder / "preview.gif").write_bytes(b"of another kind")
        (folder / "1.png").write_bytes(encoded(4))
    assert len(pairs_of(source, until=lambda _: False, limit_s=4)) == 1


@pytest.mark.parametrize("trailer", [b"\r\n", b"\xff", b"a maker's data" * 200])
def test_an_image_with_a_trailer_comes_once(folders: tuple[Path, Path], source: StereoImages, trailer: bytes) -> None:
    for folder in folders:
        for number in (1, 2, 3):
            in_two_halves(folder / f"{number}.jpg", encoded(20 * number, ".jpg") + trailer)
    found = pairs_of(source, until=lambda _: False, limit_s=1.5)
    assert [round(int(pair.left[0, 0]) / 20) for pair in found] == [1, 2, 3]


@pytest.mark.parametrize("number", [errno.EACCES, errno.EBUSY, errno.ESTALE])
def test_a_file_that_is_kept_closed_for_a_while_is_awaited(
    folders: tuple[Path, Path], source: StereoImages, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    closed = [OSError(number, "closed")] * 8
    read = folder_images.read_input

    def held(path: Path, **limits: int) -> bytes:
        if closed:
            raise closed.pop()
        return read(path, **limits)

    monkeypatch.setattr(folder_images, "read_input", held)
    for folder in folders:
        in_two_halves(folder / "7.ppm", encoded(9, ".ppm"))
    found = pairs_of(source, until=bool, limit_s=5)
    assert [(int(pair.left.min()), int(pair.right.min())) for pair in found] == [(9, 9)]
    assert not closed


def test_a_folder_that_is_gone_is_an_error_and_one_that_comes_back_goes_on(
    folders: tuple[Path, Path], source: StereoImages
) -> None:
    shutil.rmtree(folders[0])
    with pytest.raises(NotConnectedError, match=r"left: it cannot be read for [23] s .ENOENT.*network drive"):
        pairs_of(source, until=lambda _: False, limit_s=5)
    folders[0].mkdir()
    for folder in folders:
        (folder / "1.png").write_bytes(encoded(3))
    # The source looks at the folder again; until then it raises the error.
    time.sleep(0.3)
    assert len(pairs_of(source, until=bool, limit_s=5)) == 1


def test_images_of_before_stay_so_where_a_network_drive_was_away(folders: tuple[Path, Path], tmp_path: Path) -> None:
    """The folder to which a drive is attached is there without it, and empty."""
    for folder in folders:
        for number in range(1, 8):
            (folder / f"{number}.png").write_bytes(encoded(number))
    with FolderImages(folders, (CAMERA, CAMERA)) as source:
        for folder in folders:
            folder.rename(tmp_path / f"drive {folder.name}")
            folder.mkdir()
        # The source looks at the empty folders meanwhile.
        time.sleep(0.3)
        for folder in folders:
            folder.rmdir()
            (tmp_path / f"drive {folder.name}").rename(folder)
            (folder / "20.png").write_bytes(encoded(20))
        found = pairs_of(source, until=lambda _: False, limit_s=1.0)
    assert [int(pair.left[0, 0]) for pair in found] == [20]


@pytest.mark.parametrize(
    ("image", "message"),
    [
        (np.zeros((160, 128), np.uint8), "right: images of 128 x 160 pixels.*turned by a quarter of a turn"),
        (np.zeros((128, 161), np.uint8), "right: images of 161 x 128 pixels, the camera's calibration is of 160 x 128"),
        (np.zeros((128, 160), np.uint16), "1.png: the image has pixels of uint16, they must have 8 bits; save or send"),
    ],
)
def test_images_that_cannot_be_of_this_camera_are_refused(
    folders: tuple[Path, Path], source: StereoImages, image: np.ndarray, message: str
) -> None:
    cv2.imwrite(str(folders[1] / "1.png"), image)
    with pytest.raises(AcquisitionError, match=message):
        pairs_of(source, until=lambda _: False, limit_s=5)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("", "0 words were given"),
        ("left nowhere", "nowhere: two folders are needed"),
        ("nowhere right", "two folders are needed"),
        ("nowhere no.mp4", "there is no folder, video or camera nowhere"),
        ("left left", "given for both cameras"),
        ("left", "two folders are needed"),
        ("topic:/left right", "two topics are needed"),
    ],
)
def test_words_that_name_no_source_are_refused_with_the_choices(
    folders: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch, words: str, message: str
) -> None:
    monkeypatch.chdir(folders[0].parent)
    with pytest.raises((ConfigError, DeviceError), match=message):
        open_stereo_images(words, left=CAMERA, right=CAMERA)
