"""A folder without images that are read, and an image whose library is broken."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from markerseek.bmode.series import _read_png, read_images
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


def test_an_image_whose_library_is_broken_is_not_called_damaged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "cv2.py").write_text("raise ImportError('libGL.so.1: cannot open shared object file')\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "cv2", raising=False)
    image = tmp_path / "tip.png"
    image.write_bytes(b"\x89PNG\r\n\x1a\n")
    with pytest.raises(RecordError, match="because of a library: ImportError: libGL") as raised:
        _read_png(image)
    assert "damaged" not in str(raised.value)
