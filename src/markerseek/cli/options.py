"""Options that several commands share."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass
from functools import wraps
from inspect import Parameter, signature
from pathlib import Path
from typing import Annotated, Any, TypeAlias, get_type_hints

import msgspec
import typer
from msgspec.structs import replace

from markerseek.core import AnglePrior, ConfigError, Option, SearchPlan, options_of

AsJson: TypeAlias = Annotated[bool, typer.Option("--json", help="Print one JSON object for programs.")]
Out: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        help="Folder for the picture, with --plot; or the picture itself: a name in .png, .svg or .pdf.",
        show_default="out",
    ),
]
RigFile: TypeAlias = Annotated[
    Path | None, typer.Option(help="Rig file (TOML); without one, the simulated rig with its defaults.")
]
Trace: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        help="Append to this file all that devices say and are told, a line each with its time: to send to those who "
        "help with a fault."
    ),
]
Arm: TypeAlias = Annotated[
    bool, typer.Option("--arm", help="Arm a rig of devices without being asked; not needed for a simulated rig.")
]
ProbeName: TypeAlias = Annotated[
    str | None,
    typer.Option(
        "--probe",
        help="Preset of the imaging chain for channel data, or FILE.toml that describes your own probe.",
        show_default="that of the bank, else BPL9-5/55",
    ),
]


def _named_methods(incomplete: str) -> Iterator[str]:
    """Return the names of methods for the shell."""
    from markerseek.search import METHODS

    return (each.name for each in METHODS if each.name.startswith(incomplete))


def _angle_prior(text: str) -> AnglePrior:
    """Return the prior of an option's text."""
    try:
        return AnglePrior.parse(text)
    except ConfigError as problem:
        raise typer.BadParameter(str(problem)) from problem


def _annotated(found: Option) -> Any:
    """Return the type of a command's parameter, for an option that is a field of a struct (`core.Help`)."""
    declared = typer.Option(
        found.flag,
        help=found.help,
        min=found.least,
        show_default=found.default is not None if found.shown is None else found.shown,
        autocompletion=_named_methods if found.name == "method" else None,
        parser=_angle_prior if found.kind is AnglePrior else None,
        metavar="ANGLE±SIGMA" if found.kind is AnglePrior else None,
    )
    return Annotated[found.kind if found.default is not None else found.kind | None, declared]


def with_values(command: Callable[..., None]) -> Callable[..., None]:
    """Return a command, with an option for each field of the values that it takes as parameters, in their order.

    A value is a struct whose fields are options (`markerseek.core.Help`), or a dataclass whose fields are annotated as
    options of commands; so an option is declared once for all commands.
    """
    hints = get_type_hints(command, include_extras=True)
    values: dict[str, Any] = {name: kind for name, kind in hints.items() if _is_value(kind)}
    options: list[Parameter] = []
    for name, parameter in signature(command).parameters.items():
        if name in values:
            options += _options(values[name])
        else:
            options.append(parameter.replace(kind=Parameter.KEYWORD_ONLY, annotation=hints[name]))

    @wraps(command)
    def with_options(**given: Any) -> None:
        made = {name: _value(kind, given) for name, kind in values.items()}
        command(**given, **made)

    with_options.__signature__ = signature(command).replace(parameters=options)  # type: ignore[attr-defined]
    with_options.__annotations__ = {each.name: each.annotation for each in options}
    return with_options


def _is_value(kind: object) -> bool:
    """Return whether a command takes options for the fields of this class."""
    return isinstance(kind, type) and (issubclass(kind, msgspec.Struct) or is_dataclass(kind))


def _value(kind: type[Any], given: dict[str, Any]) -> Any:
    """Return a value of the options that are its fields, which are taken away.

    A field that is refused is named as typed.
    """
    names = [each.name for each in _options(kind)]
    try:
        return kind(**{name: given.pop(name) for name in names})
    except ConfigError as refusal:
        name, _, rest = str(refusal).partition(" ")
        if name not in names:
            raise
        raise ConfigError(f"--{name.replace('_', '-')} {rest}") from refusal


def _options(kind: type[Any]) -> list[Parameter]:
    """Return the parameters of a command for the fields of a value."""
    if issubclass(kind, msgspec.Struct):
        found = {each.name: (each.default, _annotated(each)) for each in options_of(kind)}
    else:
        hints = get_type_hints(kind, include_extras=True)
        found = {each.name: (each.default, hints[each.name]) for each in fields(kind)}
    return [
        Parameter(name, Parameter.KEYWORD_ONLY, default=default, annotation=annotation)
        for name, (default, annotation) in found.items()
    ]


Single: TypeAlias = Annotated[
    bool, typer.Option("--single", help="State that there is one source only, as --others 0 does.")
]


def single_source(plan: SearchPlan, *, single: bool) -> SearchPlan:
    """Return the plan with what ``--single`` states."""
    if single and plan.others:
        raise ConfigError(f"--others is {plan.others:g}, and --single states that it is 0; leave one of them out")
    return replace(plan, others=0.0) if single else plan
