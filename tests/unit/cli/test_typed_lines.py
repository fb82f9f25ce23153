"""Lines that come together are all read, though more may come later."""

from __future__ import annotations

import os
import sys

import pytest

from markerseek.cli.emulate import _TypedLines


def test_lines_of_one_write_come_one_by_one(monkeypatch: pytest.MonkeyPatch) -> None:
    read_end, write_end = os.pipe()
    with os.fdopen(read_end) as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        typed = _TypedLines()
        assert typed.next() == ""
        os.write(write_end, b"spot 1 2\nspot 3 4\nsp")
        assert [typed.next() for _ in range(3)] == ["spot 1 2", "spot 3 4", ""]
        os.write(write_end, b"ot 5 6\n")
        assert typed.next() == "spot 5 6"
        os.close(write_end)
        assert typed.next() == ""


def test_without_an_input_nothing_is_typed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdin", None)
    assert _TypedLines().next() == ""
