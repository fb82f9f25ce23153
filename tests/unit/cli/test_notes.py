"""What packages log as warnings is printed once; a trace and a program's own handlers get it too."""

from __future__ import annotations

import logging
from pathlib import Path

import pytest

from markerseek.cli.notes import notes_printed, notes_said
from markerseek.drivers import trace_to
from tests.notes import notes_collected

LOG = logging.getLogger("markerseek.drivers.of_this_test")


def test_a_sentence_is_printed_once_and_kept_for_the_result(capsys: pytest.CaptureFixture[str]) -> None:
    with notes_collected(), notes_printed():
        LOG.warning("%s [bold] is late by %g s", "left", 2.5)
        LOG.warning("%s [bold] is late by %g s", "left", 2.5)
        LOG.error("the second")
        LOG.info("quiet")
        assert notes_said() == ("left [bold] is late by 2.5 s", "the second")
    assert capsys.readouterr().err.splitlines() == ["warning: left [bold] is late by 2.5 s", "warning: the second"]
    with notes_printed():
        assert notes_said() == ()


def test_a_trace_has_all_and_the_terminal_warnings_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with notes_collected(), notes_printed():
        with trace_to(tmp_path / "trace.txt"):
            LOG.debug("stage > 'MOVE'")
            LOG.warning("the stage is slow")
        LOG.warning("after the trace")
        LOG.debug("nobody asks")
    traced = (tmp_path / "trace.txt").read_text(encoding="utf-8").splitlines()[1:]
    assert [line.split(maxsplit=2)[2] for line in traced] == ["stage > 'MOVE'", "the stage is slow"]
    assert capsys.readouterr().err.splitlines() == ["warning: the stage is slow", "warning: after the trace"]
