"""Messages of the packages as the command line prints them."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from benchmarks import house
from markerseek.cli import app
from markerseek.cli.in_options import _COMMANDS, in_options

ROOT = Path(__file__).parents[3]

CASES = {
    "an argument": ("leave `first_frame` out", "leave --first-frame out"),
    "with a value": ("`columns=ANGLE,INTENSITY` or none", "--columns ANGLE,INTENSITY or none"),
    "of another name": ("`without_channels` is 9", "--without-channel is 9"),
    "of two options": ("state `first_and_step_deg=(-35, 0.5)`", "state --first-deg -35 --step-deg 0.5"),
    "both named": ("leave `first_and_step_deg` and `angles_deg` out", "leave --first-deg, --step-deg and --angles out"),
    "a function": ("see `read_journal(a.journal)`", "see 'markerseek journal show a.journal'"),
    "of two paths": ("`journal_bank(a.journal, a.hdf5)`", "'markerseek bank import a.journal a.hdf5'"),
    "a comma in a path": ("`read_bank('a, b.mat')`", "'markerseek bank info 'a, b.mat''"),
    "without arguments": ("for `load_frame()`", "for 'markerseek frame'"),
    "no name": ("the key `[probe]`, and `A`", "the key `[probe]`, and `A`"),
}


@pytest.mark.parametrize(("message", "printed"), CASES.values(), ids=CASES.keys())
def test_a_message_has_the_words_of_the_command_line(message: str, printed: str) -> None:
    assert in_options(message) == printed


def options() -> set[str]:
    """Every option of every command."""
    return {name for command in app._every_command(app._built()) for each in command.params for name in each.opts}


def test_every_argument_that_a_message_names_is_an_option() -> None:
    texts = [text for module in house.Checkout(ROOT).below_cli for _, text in house._texts(module.tree) if "`" in text]
    named = {option for text in texts for option in re.findall(r"(?<![\w-])--[a-z-]+[a-z]", in_options(text))}
    assert len(named) > 20
    assert named <= options()


def test_every_function_has_a_command() -> None:
    group = app._built()
    for words in _COMMANDS.values():
        command = group
        for word in words.split():
            if not word.startswith("--"):
                command = command.commands[word]
