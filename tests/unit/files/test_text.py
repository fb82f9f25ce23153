"""A file of another kind is refused in words that say which kind is expected."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import h5py
import numpy as np
import pytest

from markerseek.core import ConfigError, RecordError
from markerseek.files import csv_rows, read_json, read_text, read_toml


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
READERS: dict[str, Callable[[Path], object]] = {
    "a story": lambda path: read_text(path, most_bytes=9999, what="a story", cure="write one"),
    "a table": lambda path: csv_rows(path, most_bytes=9999, what="a table", cure="write one"),
    "numbers as JSON": lambda path: read_json(
        path, list[int], most_bytes=9999, what="numbers as JSON", cure="write one"
    ),
    "a rig file": lambda path: read_toml(path, what="rig file"),
}


@pytest.mark.parametrize("what", READERS)
@pytest.mark.parametrize("kind", KINDS)
def test_a_file_of_another_kind_is_named(kind: str, what: str, tmp_path: Path) -> None:
    path = tmp_path / "given"
    KINDS[kind](path)
    with pytest.raises(
        (RecordError, ConfigError),
        match=f"this is no text in UTF-8 .*, and {what} is expected; ",
    ):
        READERS[what](path)


@pytest.mark.parametrize("what", ["a table", "numbers as JSON"])
def test_an_empty_file_is_said_to_be_empty(what: str, tmp_path: Path) -> None:
    path = tmp_path / "given"
    path.write_text("\n")
    with pytest.raises(RecordError, match=r"given: .*this is empty"):
        READERS[what](path)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_the_encodings_of_windows_are_read(encoding: str, tmp_path: Path) -> None:
    path = tmp_path / "given"
    path.write_text('name = "äöü"\n', encoding=encoding)
    assert read_toml(path, what="rig file") == {"name": "äöü"}
    path.write_text("[1, 2]", encoding=encoding)
    assert READERS["numbers as JSON"](path) == [1, 2]


@pytest.mark.parametrize("text", ["[1, 2", '["x"]', '{"a": "\\ud800"}', "[" * 100_000])
def test_json_of_another_content_is_named(text: str, tmp_path: Path) -> None:
    path = tmp_path / "given"
    path.write_text(text)
    with pytest.raises(RecordError, match=r"given: numbers as JSON is expected, and this is none: .*; write one"):
        read_json(path, list[int], most_bytes=1 << 20, what="numbers as JSON", cure="write one")
