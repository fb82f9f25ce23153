"""Prints a registration as a table or JSON, and draws it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import msgspec
import typer
from rich.markup import escape

from markerseek.cli.terminal import new_table, print_facts, print_json, save_picture, stdout
from markerseek.runs import RegistrationReport, SimulatedTruth

if TYPE_CHECKING:
    from matplotlib.figure import Figure

REGISTERED, OTHER_ANSWER = 0, 3
"""Exit codes."""


def conclude(
    report: RegistrationReport, truth: SimulatedTruth | None, *, title: str, as_json: bool, picture: Path | None
) -> NoReturn:
    """Print a registration, draw it, and end the command with its exit code.

    Parameters
    ----------
    report
        The registration.
    truth
        What a simulation knows beside; None otherwise.
    title
        What was registered.
    as_json
        Print JSON instead of a table.
    picture
        File of the picture; None for none.
    """
    if as_json:
        print_json(msgspec.to_builtins(report) | ({} if truth is None else {"simulation": msgspec.to_builtins(truth)}))
    else:
        _print_tables(report, truth, title)
    if picture is not None:
        save_picture(_figure(report, title), picture, as_json=as_json)
    raise typer.Exit(REGISTERED if report.registered else OTHER_ANSWER)


def _print_tables(report: RegistrationReport, truth: SimulatedTruth | None, title: str) -> None:
    answer = "[bold green]registered[/]" if report.registered else "[bold yellow]not registered[/]"
    stdout.print(f"{answer}: {escape(title)}, {len(report.points)} points")
    if report.reason is not None:
        stdout.print(escape(report.reason))
    print_facts(_facts(report, truth))
    points = new_table("point", "x [mm]", "y [mm]", "z [mm]", "residual [mm]", "left out [mm]")
    for point in report.points:
        points.add_row(
            escape(point.name),
            *(f"{1e3 * value:.2f}" for value in point.trus_m),
            f"{1e3 * point.residual_m:.2f}",
            "–" if point.left_out_m is None else f"{1e3 * point.left_out_m:.2f}",
        )
    stdout.print(points)
    if report.davinci_to_trus is not None:
        stdout.print("[dim]davinci_to_trus, translation in metres:[/]")
        for row in report.davinci_to_trus:
            stdout.print("  ".join(f"{value:+.6f}" for value in row))


def _facts(report: RegistrationReport, truth: SimulatedTruth | None) -> list[tuple[str, str]]:
    x, y, z = (1e3 * value for value in report.target_trus_m)
    expected = f", {1e3 * report.expected_fre_m:.2f} mm expected" if report.weights != "equal" else ""
    rows = [
        ("FRE", f"{1e3 * report.fre_m:.2f} mm{expected}"),
        ("expected TRE", f"{1e3 * report.tre_m:.2f} mm at x {x:.1f}, y {y:.1f}, z {z:.1f} mm of the TRUS frame"),
        ("weights", report.weights),
    ]
    if truth is None:
        return rows
    if truth.target_error_m is not None:
        rows.append(("true error there (simulated)", f"{1e3 * truth.target_error_m:.2f} mm"))
    counts = ", ".join(str(search.acquisitions) for search in truth.searches)
    low_min, high_min = (seconds / 60 for seconds in truth.by_hand_s)
    rows.append(("searches (simulated)", f"{len(truth.searches)} with {counts} acquisitions"))
    all_min, rest_min = truth.elapsed_s / 60, truth.without_readout_s / 60
    rows.append(("time (virtual)", f"{all_min:.1f} min, {rest_min:.1f} min without reading SonixDAQ files"))
    rows.append(("time by hand (the paper)", f"{low_min:g} to {high_min:g} min"))
    return rows


def _figure(report: RegistrationReport, title: str) -> Figure:
    import numpy as np

    from markerseek.pictures import registration_figure

    return registration_figure(
        np.array([point.trus_m for point in report.points]),
        np.array([point.transformed_m for point in report.points]),
        names=[point.name for point in report.points],
        target_m=report.target_trus_m,
        title=f"{title}: FRE {1e3 * report.fre_m:.2f} mm, expected TRE {1e3 * report.tre_m:.2f} mm"
        + ("" if report.registered else " (not accepted)"),
    )
