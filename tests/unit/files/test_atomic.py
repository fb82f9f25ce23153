"""Nothing is written through a link, into a pipe or into a file of somebody else, wherever a name is our own."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from markerseek.core import RecordError, StereoPair
from markerseek.emulators import EmulatedEndoscope, EmulatedSonixDaq
from markerseek.files import create_atomically, new_file, open_for_writing, overwrite, replace_file
from markerseek.records.journal import Journal
from markerseek.registration import SessionRecord
from markerseek.rigs import draw_scene
from markerseek.sim import SimulatedSettings, VirtualClock
from markerseek.studies import Study, run_study, study_policy
from tests.registration_sessions import BEGUN

PRECIOUS = b"a thesis without an end of line"
PAIR = StereoPair(left=np.zeros((64, 64), np.uint8), right=np.zeros((64, 64), np.uint8), at_s=0.0)
STUDY = Study(name="small", trials=1, policies=(study_policy(method="ternary", acquisitions=4, as_published=True),))


def shown(folder: Path) -> None:
    record = SessionRecord.create(folder, BEGUN)
    try:
        record.show(PAIR)
    finally:
        record.close()


def endoscope(folder: Path) -> None:
    settings = SimulatedSettings()
    rng = np.random.default_rng(1)
    world = draw_scene(settings, rng).world(settings, rng)
    clock = VirtualClock()
    emulated = EmulatedEndoscope(world=world, settings=settings, folder=folder, clock=clock, rng=rng)
    for _ in range(4):
        clock.wait(0.05)
        emulated.advance()


def channel_file(folder: Path) -> None:
    settings = SimulatedSettings()
    rng = np.random.default_rng(1)
    world = draw_scene(settings, rng).world(settings, rng)
    EmulatedSonixDaq(world=world, folder=folder)._write(3, b"channel data")


REFUSED: dict[str, Callable[[Path], object]] = {
    "session.jsonl": shown,
    "left.jpg": shown,
    "right.jpg": shown,
    "rows.part.csv": lambda folder: run_study(STUDY, folder, workers=1),
    ".lock": lambda folder: run_study(STUDY, folder, workers=1),
    "left/next.part": endoscope,
    "CH003.part": channel_file,
    "replaced": lambda folder: written(replace_file(folder / "replaced")),
    "new": lambda folder: written(new_file(folder / "new")),
    "created": lambda folder: written(create_atomically(folder / "created")),
    "in place": lambda folder: overwrite(folder / "in place", b"ours"),
    "a.journal": lambda folder: Journal.reopen(folder / "a.journal"),
}
"""Names that are written, below a folder, and what writes each; all refuse what is no file of their own."""

REPLACED: dict[str, Callable[[Path], object]] = {
    ".left.jpg": shown,
    ".right.jpg": shown,
    "right/00.pgm": endoscope,
}
"""Names that are written by no program any more, or that a new file takes as a whole."""

IN_PLACE = ("rows.part.csv", ".lock", "left/next.part", "CH003.part", "in place")


def written(file: object) -> None:
    with file as part:  # type: ignore[attr-defined]
        part.write_bytes(b"ours")


@pytest.fixture
def precious(tmp_path: Path) -> Path:
    path = tmp_path / "elsewhere" / "thesis.tex"
    path.parent.mkdir()
    path.write_bytes(PRECIOUS)
    return path


def place_in(folder: Path, name: str) -> Path:
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    return path


@pytest.mark.parametrize("name", [*REFUSED, *REPLACED])
@pytest.mark.parametrize("target", ["thesis.tex", "nothing-yet"])
def test_no_file_elsewhere_is_written_or_made_through_a_link(
    name: str, target: str, precious: Path, tmp_path: Path
) -> None:
    place = place_in(tmp_path / "ours", name)
    place.symlink_to(precious.with_name(target))
    if name in REFUSED:
        with pytest.raises(RecordError):
            REFUSED[name](tmp_path / "ours")
        assert place.is_symlink()
    else:
        REPLACED[name](tmp_path / "ours")
    assert precious.read_bytes() == PRECIOUS
    assert [*precious.parent.iterdir()] == [precious]


@pytest.mark.parametrize("name", [*REFUSED, *REPLACED])
def test_a_pipe_is_waited_for_by_nobody(name: str, tmp_path: Path) -> None:
    os.mkfifo(place_in(tmp_path / "ours", name))
    if name in REFUSED:
        with pytest.raises(RecordError):
            REFUSED[name](tmp_path / "ours")
    else:
        REPLACED[name](tmp_path / "ours")


@pytest.mark.parametrize("name", IN_PLACE)
def test_a_file_with_another_name_elsewhere_is_not_written_in_place(name: str, precious: Path, tmp_path: Path) -> None:
    place_in(tmp_path / "ours", name).hardlink_to(precious)
    with pytest.raises(RecordError, match=r"it is a hard link, a file with 2 names, .*; copy it, and name the copy"):
        REFUSED[name](tmp_path / "ours")
    assert precious.read_bytes() == PRECIOUS


@pytest.mark.parametrize("content", [PRECIOUS, b"0123456789 not ours", b"deadbee", b"0123abcd {}", b"{}"])
def test_a_record_is_begun_in_no_file_that_is_there(content: bytes, tmp_path: Path) -> None:
    path = place_in(tmp_path / "s", "session.jsonl")
    path.write_bytes(content)
    former = content == b"0123abcd {}"
    said = "it holds a session already" if former else r"session\.jsonl: it is a file of another program"
    with pytest.raises(RecordError, match=said):
        SessionRecord.create(tmp_path / "s", BEGUN)
    assert path.read_bytes() == content


def test_a_link_that_replaces_a_file_after_it_was_looked_at_is_not_followed(
    precious: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    place = tmp_path / "ours"
    place.write_bytes(b"ours")
    before = place.lstat()
    place.unlink()
    place.symlink_to(precious)
    monkeypatch.setattr(Path, "lstat", lambda _: before)
    with pytest.raises(OSError, match="symbolic links"):
        open_for_writing(place, os.O_WRONLY | os.O_TRUNC)
    assert precious.read_bytes() == PRECIOUS


def test_a_new_file_has_one_name(tmp_path: Path) -> None:
    written(new_file(tmp_path / "new"))
    assert (tmp_path / "new").stat().st_nlink == 1
    os.close(open_for_writing(tmp_path / "new", os.O_WRONLY))
    assert (tmp_path / "new").read_bytes() == b"ours"
