"""Messages of the packages as the command line prints them."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from benchmarks import house
from markerseek.cli import app
from markerseek.cli.in_options import _COMMANDS, _CURES, in_options

ROOT = Path(__file__).parents[3]

CASES = {
    "an argument": ("leave `first_frame` out", "leave --first-frame out"),
    "with a value": ("`columns=ANGLE,INTENSITY` or none", "--columns ANGLE,INTENSITY or none"),
    "of another name": ("`without_channels` is 9", "--without-channel is 9"),
    "of two options": ("state `first_and_step_deg=(-35, 0.5)`", "state --first-deg -35 --step-deg 0.5"),
    "both named": ("leave `first_and_step_deg` and `angles_deg` out", "leave --first-deg, --step-deg and --angles out"),
    "a function": ("see `read_journal(a.journal)`", "see 'markerseek journal show a.journal'"),
    "of two paths": ("`journal_bank(a.journal, a.hdf5)`", "'markerseek bank import a.journal a.hdf5'"),
    "a comma in a path": ("`read_bank('a, b.mat')`", "\"markerseek bank info 'a, b.mat'\""),
    "without arguments": ("for `load_frame()`", "for 'markerseek frame'"),
    "a flag of a function": (
        "`resumed_run(a.journal, reset_fault=True)`",
        "'markerseek resume a.journal --reset-fault'",
    ),
    "a function without a command": ("see `nobody_knows(a)`", "see nobody_knows(a)"),
    "a cure": (
        "check the cable, and measure the delay",
        "check the cable, and measure the delay ('markerseek calibrate --delay')",
    ),
    "a cure with its command": ("register points ('markerseek')", "register points ('markerseek')"),
    "a cure in a path": ("register points.csv: it has no column x", "register points.csv: it has no column x"),
    "no name": ("the key `[probe]`, and `A`", "the key `[probe]`, and `A`"),
}


@pytest.mark.parametrize(("message", "printed"), CASES.values(), ids=CASES.keys())
def test_a_message_has_the_words_of_the_command_line(message: str, printed: str) -> None:
    assert in_options(message) == printed


def options_of(command: Any) -> set[str]:
    """Options of a command, and of all below it."""
    own = {name for each in command.params for name in each.opts}
    return own.union(*(options_of(each) for each in getattr(command, "commands", {}).values()))


@pytest.fixture(scope="module")
def texts() -> list[str]:
    """All texts of the packages below the command line."""
    return [text for module in house.Checkout(ROOT).below_cli for _, text in house._texts(module.tree)]


def test_every_argument_that_a_message_names_is_an_option(texts: list[str]) -> None:
    marked = [in_options(text) for text in texts if "`" in text]
    named = {option for text in marked for option in re.findall(r"(?<![\w-])--[a-z-]+[a-z]", text)}
    assert len(named) > 20
    assert named <= options_of(app.all_commands())


def test_every_function_that_a_message_names_has_a_command(texts: list[str]) -> None:
    named = {name for text in texts for name in re.findall(r"`([a-z_]+)\(", text)}
    assert named == _COMMANDS.keys()


def test_every_cure_stands_in_a_message(texts: list[str]) -> None:
    assert [cure for cure in _CURES if not any(cure in text for text in texts)] == []


def commands() -> list[str]:
    """Each command that a function or a cure has, and each option that a cure has alone, with the command it is of."""
    cures = [cure.strip("'").removeprefix("markerseek ") for cure in _CURES.values() if "markerseek" in cure]
    return [*_COMMANDS.values(), *cures]


@pytest.mark.parametrize("words", commands())
def test_every_command_is_one(words: str) -> None:
    command = app.all_commands()
    for word in words.split():
        if word.startswith("--"):
            assert word in {name for each in command.params for name in each.opts}
        elif hasattr(command, "commands"):
            command = command.commands[word]
