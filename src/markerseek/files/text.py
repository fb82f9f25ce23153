"""Reads text and JSON that users name; an error says which kind of file is expected."""

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

Content = TypeVar("Content")


def read_text(path: Path, *, most_bytes: int, what: str, cure: str, also: Sequence[str] = ()) -> str:
    """Text of a file in UTF-8, or in UTF-16 with its byte order mark, which Windows writes.

    ``what``: kind of file that is expected, with its article, for the message; ``cure``: what to do then. ``also``:
    encodings that are tried where it is not in UTF-8.
    """
    with as_read_error(path):
        data = read_input(path, most_bytes=most_bytes)
    # Excel and Notepad write a byte order mark, which is no part of the text.
    for encoding in ["utf-16"] if data.startswith(_UTF_16) else ["utf-8-sig", *also]:
        with suppress(UnicodeDecodeError):
            text = data.decode(encoding)
            # Of binary files, also a spreadsheet or an image, and of UTF-16 without its mark.
            if not {"\0", "\x03"} & set(text):
                return text
    raise RecordError(f"{path}: this is no text in UTF-8 but another kind of file, and {what} is expected; {cure}")


def read_json(path: Path, content: type[Content], *, most_bytes: int, what: str, cure: str) -> Content:
    """Content of a JSON file; parameters as of `read_text`."""
    text = read_text(path, most_bytes=most_bytes, what=what, cure=cure)
    try:
        return msgspec.json.decode(text, type=content)
    except (msgspec.MsgspecError, UnicodeError, RecursionError) as problem:
        found = f"none: {problem}" if text.strip() else "empty"
        raise RecordError(f"{path}: {what} is expected, and this is {found}; {cure}") from problem
