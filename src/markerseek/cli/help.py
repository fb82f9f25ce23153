"""The help of the commands: examples before the options, the most used options first, the others in panels."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from typing import Any

import typer

from markerseek.core import SearchPlan, SimulationOptions, options_of

FIRST = (
    *("--method", "--rig", "--arm", "--sweep", "--single", "--tolerance-mm", "--seed"),
    # Of other commands than search.
    *("--probe", "--number", "--angles", "--first-deg", "--step-deg", "--reference-deg", "--cameras", "--frames"),
    *("--simulate", "--continue", "--once"),
    *("--journal", "--plot", "--json"),
)
"""Options that most people need; they stand in the first panel of a command with many options, in this order."""

PANELS = {
    "Search": (*(each.flag for each in options_of(SearchPlan)), "--prior", "--compare", "--registration"),
    "Rig": ("--trust", "--wavelength-nm", "--pulse-energy-mj"),
    "Session": ("--images", "--tre-mm", "--markers", "--again", "--record", "--wait-s"),
    "Points": ("--target-mm", "--without", "--calibration-sigma-px"),
    "Arrays and sequences": (
        *("--axes", "--first-frame", "--without-channel", "--angle-field", "--sampling-mhz"),
        "--face-radius-mm",
    ),
    "Images": ("--roi", "--pixel-mm"),
    "Tables": ("--columns", "--unit", "--db", "--skip-invalid"),
    "Simulation": (*(each.flag for each in options_of(SimulationOptions)),),
    "Output": ("--out", "--force", "--no-journal", "--events"),
}
"""Panels of the other options; "More" has those that no panel names."""

MANY = 10
"""Number of options from which on a command has panels."""


def add_command(
    app: typer.Typer, name: str, command: Callable[..., None], examples: str, *, panel: str | None = None
) -> None:
    """Add a command, with its examples (a command line each) below its description."""
    lines = [line.strip() for line in examples.splitlines() if line.strip().startswith("markerseek")]
    # Two spaces at the end break a line in Markdown.
    text = "  \n".join([f"{inspect.cleandoc(command.__doc__ or '')}\n\nExamples:", *lines])
    app.command(name=name, help=text, rich_help_panel=panel)(command)


def arranged(group: Any) -> Any:
    """The group, with the options of all its commands in their panels."""
    for command in _commands(group):
        options = [each for each in command.params if each.param_type_name == "option"]
        for each in [*options, command.get_help_option(typer.Context(command))]:
            if getattr(each, "is_flag", False):
                # Not "<bool>": a flag takes no value.
                each.metavar = ""
        for each in command.params:
            if each not in options:
                each.metavar = each.metavar or each.name.upper()
        if len(options) > MANY:
            for each in options:
                each.rich_help_panel = _panel(each.opts[-1])
            command.params.sort(key=lambda each: _rank(each.opts[-1]))
    return group


def _commands(command: Any) -> Iterator[Any]:
    """A command, and all that it has below it where it is a group."""
    yield command
    for each in getattr(command, "commands", {}).values():
        yield from _commands(each)


_PANEL_OF = {name: panel for panel, names in PANELS.items() for name in names}


def _panel(option: str) -> str | None:
    return None if option in FIRST else _PANEL_OF.get(option, "More")


def _rank(option: str) -> int:
    """Place of an option in the help; arguments, and options of the later panels, keep their order."""
    order = [*FIRST, *_PANEL_OF]
    return order.index(option) if option in order else len(order) if option.startswith("--") else -1
