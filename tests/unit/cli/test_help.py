"""The help of the commands, as it is printed in a terminal of 100 columns."""

from __future__ import annotations

import subprocess
import sys

import pytest

from markerseek.cli.app import FIRST, MANY, PANELS, all_commands


def printed(*words: str) -> list[str]:
    command = [sys.executable, "-m", "markerseek", *words, "--help"]
    done = subprocess.run(command, capture_output=True, text=True, check=True, env={"COLUMNS": "100"})
    return done.stdout.splitlines()


def test_examples_and_the_ten_most_used_options_of_a_search_fit_one_screen() -> None:
    lines = printed("search")
    begin, end = (next(at for at, line in enumerate(lines) if line.startswith(corner)) for corner in "╭╰")
    assert end < 40
    assert any("markerseek search --seed 1" in line for line in lines[:begin])
    first = [line.split()[1] for line in lines[begin:end] if line.startswith("│ --")]
    assert first[:-1] == [option for option in FIRST if option in first]
    assert len(first[:-1]) == 10
    panels = [line.split()[1] for line in lines if line.startswith("╭─")]
    assert panels == ["Options", "Search", "Simulation", "Output"]


def test_every_option_of_a_command_with_many_has_a_panel() -> None:
    known = {*FIRST, *(name for names in PANELS.values() for name in names)}
    met: set[str] = set()
    groups = [all_commands()]
    for group in groups:
        for command in group.commands.values():
            if hasattr(command, "commands"):
                groups.append(command)
                continue
            options = {each.opts[-1] for each in command.params if each.param_type_name == "option" and not each.hidden}
            assert len(options) <= MANY or options <= known, command.name
            met |= options
    assert known <= met, "no command has these options"


@pytest.mark.parametrize("words", [("--help",), ("journal", "list", "--help")])
def test_a_reader_that_ends_early_is_no_error(words: tuple[str, ...]) -> None:
    command = ["sh", "-c", f"{sys.executable} -m markerseek {' '.join(words)} | head -c 1"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stderr == ""
