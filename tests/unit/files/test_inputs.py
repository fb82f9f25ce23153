"""Opening of user-named files: regular files only, up to the size that their format needs."""

from __future__ import annotations

import os
import struct
from collections.abc import Callable
from pathlib import Path

import pytest

from markerseek.core import ConfigError, MarkerseekError, RecordError
from markerseek.files import open_input, read_input, read_toml, replace_file, require_input, require_new
from markerseek.pictures import write_page
from markerseek.records.banks import read_bank
from markerseek.records.banks.arrays import read_arrays
from markerseek.records.banks.frames import load_frame, open_ultrasonix
from markerseek.records.journal import read_journal
from markerseek.studies import read_study

READERS: dict[str, tuple[Callable[[Path], object], int]] = {
    "rig.toml": (lambda path: read_toml(path, what="rig file"), 1 << 18),
    "study.toml": (read_study, 1 << 18),
    "scan.csv": (read_bank, 1 << 26),
    "frame.npy": (load_frame, 1 << 28),
    "frame.mat": (load_frame, 1 << 28),
    "frames.npy": (read_arrays, 1 << 33),
    "frames.npz": (read_arrays, 1 << 33),
    "frames.mat": (read_arrays, 1 << 33),
    "image.rf": (open_ultrasonix, 1 << 36),
    "run.journal": (read_journal, 1 << 36),
    "scan.hdf5": (read_bank, 1 << 42),
}
"""Each reader, and the largest file that it opens."""


@pytest.mark.parametrize("name", READERS)
@pytest.mark.parametrize("make", [os.mkfifo, lambda path: path.symlink_to("/dev/zero")])
def test_each_reader_refuses_what_is_no_regular_file(name: str, make: Callable[[Path], None], tmp_path: Path) -> None:
    make(tmp_path / name)
    with pytest.raises(MarkerseekError, match=f"({name}|/dev/zero): it is not a regular file") as refused:
        READERS[name][0](tmp_path / name)
    assert refused.value.exit_code == 2


@pytest.mark.parametrize("name", READERS)
def test_each_reader_refuses_a_larger_file_than_its_format_has(name: str, tmp_path: Path) -> None:
    read, most_bytes = READERS[name]
    with (tmp_path / name).open("wb") as file:
        file.truncate(most_bytes + 1)
    with pytest.raises(MarkerseekError, match=f"{name}: {most_bytes + 1} bytes found, at most {most_bytes} expected"):
        read(tmp_path / name)


def test_a_folder_is_no_file(tmp_path: Path) -> None:
    for look in (open_input, read_input, require_input):
        with pytest.raises(RecordError, match="it is a folder, and a file is expected"):
            look(tmp_path, most_bytes=10)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a = " + "[\n" * 5000 + "]\n" * 5000, "nests lists or tables too deeply"),
        ("seed = 1" + "0" * 4400, "the rig file cannot be read: Exceeds the limit"),
    ],
    ids=["5,000 lists", "4,401 digits"],
)
def test_settings_nested_too_deeply_or_too_large_are_refused(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=rf"rig\.toml: .*{message}"):
        read_toml(path, what="rig file")


def test_a_channel_file_of_a_million_samples_is_refused_before_there_is_room_for_128_of_them(tmp_path: Path) -> None:
    for number in range(128):
        with (tmp_path / f"CH{number:03d}.daq").open("wb") as file:
            file.write(struct.pack("<3i", number, 1, 30_000_000))
            file.truncate(12 + 60_000_000)
    with pytest.raises(RecordError, match="it holds 30000000 samples of each pulse, at most 65536 are read"):
        load_frame(tmp_path)


WORDS = dict.fromkeys(("kind", "word", "angle", "sigma", "lead", "interval", "reason", "next_step"), "")
REST = {
    "note": None,
    "verdict": WORDS,
    "curve": "",
    "facts": [],
    "picture_uri": "",
    "alt": "",
    "rows": [[]],
    "json": "",
}


@pytest.mark.parametrize("make", [lambda path, _: os.mkfifo(path), lambda path, target: path.symlink_to(target)])
def test_nothing_is_written_through_a_link_or_a_pipe(make: Callable[[Path, Path], None], tmp_path: Path) -> None:
    target, place = tmp_path / "precious", tmp_path / "search.html"
    target.write_text("precious")
    make(place, target)
    with pytest.raises(RecordError, match=r"search\.html: it is a symbolic link, a pipe or a device"):
        write_page(place, "search.html.jinja", title="", **REST)
    with pytest.raises(RecordError), replace_file(place) as part:
        part.write_text("another")
    assert target.read_text() == "precious"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["precious", "search.html"]


def test_a_link_that_leads_nowhere_is_no_free_name(tmp_path: Path) -> None:
    (tmp_path / "scan.csv").symlink_to(tmp_path / "nowhere")
    with pytest.raises(RecordError, match="there is a file already"):
        require_new(tmp_path / "scan.csv")


def test_a_page_that_cannot_be_finished_leaves_the_one_before(tmp_path: Path) -> None:
    place = tmp_path / "search.html"
    place.write_text("the page before")
    with pytest.raises(UnicodeEncodeError):
        write_page(place, "search.html.jinja", title="\udcff", **REST)
    assert place.read_text() == "the page before"
    assert list(tmp_path.iterdir()) == [place]
