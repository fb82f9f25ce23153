"""Files that users name: regular files only, of the size that their format needs, and of the kind that is expected."""

from __future__ import annotations

import os
import struct
from collections.abc import Callable
from pathlib import Path

import cv2
import h5py
import numpy as np
import pytest

from markerseek.core import ConfigError, MarkerseekError, RecordError
from markerseek.files import (
    csv_rows,
    open_input,
    read_input,
    read_json,
    read_text,
    read_toml,
    replace_file,
    require_input,
    require_new,
)
from markerseek.records.banks import read_bank
from markerseek.records.banks.arrays import read_arrays
from markerseek.records.banks.frames import load_frame, open_ultrasonix
from markerseek.records.journal import read_journal
from markerseek.show import write_page
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
    target = tmp_path / "precious"
    place = tmp_path / "search.html"
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


def png(path: Path) -> None:
    path.write_bytes(cv2.imencode(".png", np.zeros((4, 4), np.uint8))[1].tobytes())


def hdf5(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file["x"] = np.arange(4.0)


KINDS: dict[str, Callable[[Path], object]] = {
    "a PNG image": png,
    "an HDF5 file": hdf5,
    "UTF-16 without its mark": lambda path: path.write_text("a = 1", encoding="utf-16-le"),
}
TEXT_READERS: dict[str, Callable[[Path], object]] = {
    "a story": lambda path: read_text(path, most_bytes=9999, what="a story", cure="write one"),
    "a table": lambda path: csv_rows(path, most_bytes=9999, what="a table", cure="write one"),
    "numbers as JSON": lambda path: read_json(
        path, list[int], most_bytes=9999, what="numbers as JSON", cure="write one"
    ),
    "a rig file": lambda path: read_toml(path, what="rig file"),
}


@pytest.mark.parametrize("what", TEXT_READERS)
@pytest.mark.parametrize("kind", KINDS)
def test_a_file_of_another_kind_is_named(kind: str, what: str, tmp_path: Path) -> None:
    path = tmp_path / "given"
    KINDS[kind](path)
    with pytest.raises((RecordError, ConfigError), match=f"this is no text in UTF-8 .*, and {what} is expected; "):
        TEXT_READERS[what](path)


@pytest.mark.parametrize("what", ["a table", "numbers as JSON"])
def test_an_empty_file_is_said_to_be_empty(what: str, tmp_path: Path) -> None:
    path = tmp_path / "given"
    path.write_text("\n")
    with pytest.raises(RecordError, match=r"given: .*this is empty"):
        TEXT_READERS[what](path)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_the_encodings_of_windows_are_read(encoding: str, tmp_path: Path) -> None:
    path = tmp_path / "given"
    path.write_text('name = "äöü"\n', encoding=encoding)
    assert read_toml(path, what="rig file") == {"name": "äöü"}
    path.write_text("[1, 2]", encoding=encoding)
    assert TEXT_READERS["numbers as JSON"](path) == [1, 2]


@pytest.mark.parametrize("text", ["[1, 2", '["x"]', '{"a": "\\ud800"}', "[" * 100_000])
def test_json_of_another_content_is_named(text: str, tmp_path: Path) -> None:
    path = tmp_path / "given"
    path.write_text(text)
    with pytest.raises(RecordError, match=r"given: numbers as JSON is expected, and this is none: .*; write one"):
        read_json(path, list[int], most_bytes=1 << 20, what="numbers as JSON", cure="write one")
