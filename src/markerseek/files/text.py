"""Reads text and JSON that users name; an error says which kind of file is expected, and which kind this one is."""

from __future__ import annotations

import codecs
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import TypeVar

import msgspec

from markerseek.core import RecordError
from markerseek.files.inputs import as_read_error, read_input

_UTF_16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)

_KINDS = {
    b"\x89PNG": "a PNG image",
    b"\xff\xd8\xff": "a JPEG image",
    b"\x89HDF": "an HDF5 file",
    b"MATLAB 5.0 MAT-file": "a MATLAB file",
    b"MATLAB 7.3 MAT-file": "a MATLAB file",
    b"\x93NUMPY": "a NumPy array",
    b"\x89MCAP": "an MCAP file",
    b"%PDF": "a PDF document",
    b"PK\x03\x04": "a ZIP archive, as .xlsx and .docx are",
    b"\x1f\x8b": "a gzip archive",
}
"""Kinds of files that are no text, by their first bytes."""

Content = TypeVar("Content")


def read_text(path: Path, *, most_bytes: int, what: str, cure: str, also: Sequence[str] = ()) -> str:
    """Text of a file in UTF-8, or in UTF-16 with its byte order mark, which Windows writes.

    ``what``: kind of file that is expected, with its article, for the message; ``cure``: what to do then. ``also``:
    encodings that are tried where it is not in UTF-8.
    """
    with as_read_error(path):
        data = read_input(path, most_bytes=most_bytes)
    kind = next((kind for start, kind in _KINDS.items() if data.startswith(start)), None)
    if kind is None:
        # Excel and Notepad write a byte order mark, which is no part of the text.
        for encoding in ["utf-16"] if data.startswith(_UTF_16) else ["utf-8-sig", *also]:
            with suppress(UnicodeDecodeError):
                text = data.decode(encoding)
                # Of UTF-16 without its mark, each second byte is 0.
                if "\0" not in text:
                    return text
        kind = "no text in UTF-8"
    raise RecordError(f"{path}: this is {kind}, and {what} is expected; {cure}")


def read_json(path: Path, content: type[Content], *, most_bytes: int, what: str, cure: str) -> Content:
    """Content of a JSON file; parameters as of `read_text`."""
    text = read_text(path, most_bytes=most_bytes, what=what, cure=cure)
    try:
        return msgspec.json.decode(text, type=content)
    except (msgspec.MsgspecError, UnicodeError, RecursionError) as problem:
        found = f"none: {problem}" if text.strip() else "empty"
        raise RecordError(f"{path}: {what} is expected, and this is {found}; {cure}") from problem
