"""A folder without images that are read: what it holds is said."""

from __future__ import annotations

from pathlib import Path

import pytest

from markerseek.bmode.series import read_images
from markerseek.core import RecordError
from markerseek.registration.points import read_camera_images


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (["1.webp", "2.webp", "cine.gif"], r"\.gif, \.webp"),
        (["1.TIFF", "README", "._1.png"], r"\.tiff, no ending"),
        ([], "no files"),
    ],
)
def test_the_endings_in_a_folder_without_images_are_named(names: list[str], said: str, tmp_path: Path) -> None:
    for name in names:
        (tmp_path / name).write_bytes(b"something")
    with pytest.raises(RecordError, match=rf"\.png, \.dcm, \.b8 are read, and it holds {said}; export"):
        read_images(tmp_path)
    with pytest.raises(RecordError, match=rf"0 PNG files, 1 to 2000 are read, and it holds {said}; save the"):
        read_camera_images(tmp_path)
