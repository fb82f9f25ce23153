"""The command that goes on with a session has the options with which it was begun."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
from msgspec import structs

from markerseek import registration
from markerseek.cli import registering
from markerseek.core import ConfigError, DeviceError
from tests.registration_sessions import BEGUN


@pytest.mark.parametrize(
    ("words", "again"),
    [
        (
            ["--rig", "my rig.toml", "--images", "left right", "--target-mm", "0", "1", "40", "--json"],
            "--rig 'my rig.toml' --images 'left right' --target-mm 0 1 40 --json",
        ),
        (["--simulate", "--record", "first", "--seed", "31"], "--simulate --seed 31"),
        (["--heartbeat=/dev/fd/3", "--simulate", "--continue", "kept"], "--simulate"),
        (["--simulate", "--asked-by=a browser at 10.0.0.7", "--heartbeat", "/dev/fd/3"], "--simulate"),
    ],
)
def test_a_session_goes_on_with_the_options_it_was_begun_with(
    monkeypatch: pytest.MonkeyPatch, words: list[str], again: str
) -> None:
    monkeypatch.setattr(sys, "argv", ["markerseek", "register", *words])
    assert registering._continue_command(Path("kept")) == f"markerseek register {again} --continue kept"


@pytest.mark.parametrize("wait_s", [-1.0, 0.0, float("nan"), 1e9])
def test_a_wait_that_is_none_is_refused(wait_s: float) -> None:
    with pytest.raises(ConfigError, match=r"wait_s is .* s, it must lie in \[1, 3600\] s"):
        registration.SessionPlan(wait_s=wait_s)


def test_a_fault_names_the_command_that_goes_on(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    class Broken:
        view = registration.SessionView()

        def steps(self) -> Iterator[registration.Step]:
            yield registration.Ended(registered=False, said="over", rig_s=0.0)
            raise DeviceError("the line 'stage' is gone")

    monkeypatch.setattr(sys, "argv", ["markerseek", "register"])
    with pytest.raises(DeviceError):
        registering._watch(Broken(), Path("kept"), as_json=False, hold=False)  # type: ignore[arg-type]
    said = " ".join(capsys.readouterr().err.split())
    assert "once the fault is repaired, continue with: markerseek register --continue kept" in said


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"rig": "f2", "description": "another rig"}, "begun on a rig, not on another rig; name the same"),
        ({"rig": "f2"}, "begun on a rig, with other settings of it; name the same"),
        ({"seed": 5}, "begun with --seed 31, and not 5; name the same"),
        ({"cameras": "{}"}, "begun with another calibration (--cameras); name the same"),
    ],
)
def test_a_session_that_is_continued_otherwise_says_how_it_was_begun(
    tmp_path: Path, changed: dict[str, object], said: str
) -> None:
    begun = structs.replace(BEGUN, cameras="[]", seed=31)
    registration.SessionRecord.create(tmp_path / "first", begun).close()
    with closing(registration.SessionRecord.reopen(tmp_path / "first")) as record:
        registering._require_same(record, begun)
        with pytest.raises(ConfigError, match=re.escape(said)):
            registering._require_same(record, structs.replace(begun, **changed))


def test_a_spot_is_set_by_the_file_of_another_program_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdin", None)
    is_set = registering.SpotIsSet(tmp_path)
    assert not is_set()
    (tmp_path / registration.SPOT_IS_SET).touch()
    assert [is_set(), is_set()] == [True, False]
    assert list(tmp_path.iterdir()) == []


def test_a_spot_is_set_by_enter_on_the_terminal_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ours, theirs = os.openpty()
    with os.fdopen(theirs, encoding="utf-8") as terminal:
        monkeypatch.setattr(sys, "stdin", terminal)
        monkeypatch.setattr(os, "tcgetpgrp", lambda _descriptor: os.getpgrp())
        is_set = registering.SpotIsSet(tmp_path)
        assert not is_set()
        for typed, expected in ((b"x", False), (b"\n", True), (b"\n\n", True), (b"", False)):
            os.write(ours, typed)
            assert is_set() is expected
        # The terminal goes.
        os.close(ours)
        assert not is_set()
        assert not is_set()


def test_a_job_in_the_background_does_not_read_its_terminal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ours, theirs = os.openpty()
    with os.fdopen(theirs, encoding="utf-8") as terminal:
        monkeypatch.setattr(sys, "stdin", terminal)
        monkeypatch.setattr(os, "tcgetpgrp", lambda _descriptor: os.getpgrp() + 1)
        os.write(ours, b"\n")
        assert not registering.SpotIsSet(tmp_path)()
    os.close(ours)
