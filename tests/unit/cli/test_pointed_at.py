"""A pixel that another program writes into the folder of a session is taken once, and each new one is."""

from __future__ import annotations

from pathlib import Path

from markerseek.cli.follow_run import PointedAt
from markerseek.files import replace_file
from markerseek.registration import POINTED_AT


def point(folder: Path, text: str) -> None:
    with replace_file(folder / POINTED_AT) as part:
        part.write_text(text)


def test_each_click_is_taken_once_and_none_of_before(tmp_path: Path) -> None:
    point(tmp_path, "1 2")
    pointed = PointedAt(tmp_path)
    assert pointed() is None
    for x in (3.0, 4.5, 4.5):
        point(tmp_path, f"{x} 5")
        assert pointed() == (x, 5.0)
        assert pointed() is None


def test_what_is_no_pixel_is_none(tmp_path: Path) -> None:
    pointed = PointedAt(tmp_path)
    for text in ("", "1", "1 2 3", "here", "9" * 1000):
        point(tmp_path, text)
        assert pointed() is None
    (tmp_path / POINTED_AT).unlink()
    assert pointed() is None
