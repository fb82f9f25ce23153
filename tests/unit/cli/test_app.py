"""An unexpected error ends in one sentence and an exit code of its own, in text and in JSON."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from markerseek import cli
from markerseek.cli import app


def ended(monkeypatch: pytest.MonkeyPatch, run: Callable[[], None], *words: str) -> int:
    monkeypatch.setattr(app, "run_command", run)
    monkeypatch.setattr(sys, "argv", ["markerseek", *words])
    with pytest.raises(SystemExit) as end:
        cli.main()
    assert isinstance(end.value.code, int)
    return end.value.code


def raising(error: BaseException) -> Callable[[], None]:
    def run() -> None:
        raise error

    return run


@pytest.mark.parametrize(
    ("error", "code", "said"),
    [
        (TypeError("an integer is required"), 70, "a defect of markerseek"),
        (RecursionError("maximum recursion depth exceeded"), 70, "RecursionError: maximum recursion depth exceeded"),
        (ZeroDivisionError("float\ndivision"), 70, "ZeroDivisionError: float division; please report it"),
        (KeyError(), 70, "KeyError: no message"),
        (MemoryError(), 1, "not enough memory"),
        (MemoryError("Unable to allocate 119. GiB"), 1, "Unable to allocate 119. GiB"),
        (OSError(36, "File name too long", "/a"), 2, "/a: File name too long; check the name"),
        (KeyboardInterrupt(), 130, "stopped by the user"),
    ],
)
def test_any_error_is_one_sentence_and_one_object(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], error: BaseException, code: int, said: str
) -> None:
    assert ended(monkeypatch, raising(error), "search") == code
    output = capsys.readouterr()
    assert output.out == ""
    assert output.err.startswith("error: ")
    assert said in output.err
    assert output.err.count("\n") == 1
    assert ended(monkeypatch, raising(error), "search", "--json") == code
    output = capsys.readouterr()
    answer = json.loads(output.out)
    assert said in answer["error"]
    assert answer["kind"] in (type(error).__name__, "OSError")


def test_the_traceback_is_shown_where_it_is_asked_for(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("MARKERSEEK_TRACEBACK", "1")
    assert ended(monkeypatch, raising(TypeError("odd")), "search") == 70
    err = capsys.readouterr().err
    assert "Traceback (most recent call last)" in err
    assert "in run" in err


@pytest.mark.parametrize(
    "program", [[Path(sys.executable).with_name("markerseek")], [sys.executable, "-m", "markerseek"]]
)
def test_the_installed_command_and_the_package_are_a_program(program: list[str | Path]) -> None:
    done = subprocess.run([*program, "--version"], capture_output=True, text=True, check=True)
    assert done.stdout == f"{cli.__version__}\n"
