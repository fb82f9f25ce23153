"""The study's table: target registration errors under all conditions, as Markdown.

``python -m benchmarks.registration [--registrations N] [--searches]`` prints it, or makes the searches anew.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.registration.marker_errors import KEPT, SEARCHES, kept_errors, search_errors, write_errors
from benchmarks.registration.trials import SOURCES, Conditions, Trial, registrations

POINT = "plastisol-phantom"
STAINED = ("chicken-breast", "liver", "muscle", "muscle-icg")
"""Materials whose searches the study draws from: a point, and uneven stained spots."""

CAMERA_M = (0.10, 0.15)
"""Distances of the camera in metres."""


class Case(NamedTuple):
    """One line of the table: its name, conditions at the first distance of the camera, and material of the searches."""

    name: str
    conditions: Conditions
    tissue: str = POINT


def cases() -> list[Case]:
    """All lines of the table.

    Errors that all points share are assumed where they are drawn; else the registration takes them for 0.
    """
    usual = Conditions(shared_assumed=False)
    assumed = Conditions()
    drawn = Conditions(shared_errors=1.0)
    return [
        Case("9 markers, 25 frames", usual),
        Case("one frame", replace(usual, frames=1)),
        *(Case(f"{count} markers", replace(usual, markers=count)) for count in (6, 4, 3)),
        Case("Horn alone, weights by size", replace(usual, refined=False)),
        Case("Horn alone, one frame", replace(usual, refined=False, frames=1)),
        *(Case(f"Horn alone, {count} markers", replace(usual, refined=False, markers=count)) for count in (6, 4, 3)),
        *(Case(f"only the error of {_with_article(source)}", replace(usual, sources=(source,))) for source in SOURCES),
        *(
            Case(f"Horn, only the error of {_with_article(source)}", replace(usual, refined=False, sources=(source,)))
            for source in SOURCES
        ),
        Case("errors of the angle ten times as large", replace(usual, angle_factor=10.0)),
        Case("Horn, angle ten times as large", replace(usual, refined=False, angle_factor=10.0)),
        Case("calibration to 0.1 px", replace(usual, calibration_sigma_px=0.1)),
        Case("Horn, calibration to 0.1 px", replace(usual, refined=False, calibration_sigma_px=0.1)),
        Case("base of 10 mm", replace(usual, base_m=10e-3)),
        Case("Horn, base of 10 mm", replace(usual, refined=False, base_m=10e-3)),
        Case("100 frames", replace(usual, frames=100)),
        Case("flat tissue", replace(usual, relief_m=0.0)),
        Case("calibration off by a common shift", replace(usual, common_calibration=True)),
        *(Case(tissue, usual, tissue) for tissue in STAINED),
        Case("Horn, liver", replace(usual, refined=False), "liver"),
        Case("shared errors assumed, none there", assumed),
        *(Case(f"{tissue}, assumed, none there", assumed, tissue) for tissue in STAINED),
        Case("shared errors drawn", drawn),
        *(Case(f"{tissue}, drawn", drawn, tissue) for tissue in STAINED),
        *(Case(f"drawn, {count} markers", replace(drawn, markers=count)) for count in (6, 4)),
        Case("drawn, taken for 0", replace(drawn, shared_assumed=False)),
        Case("sound speed 1 % off, assumed", replace(assumed, sound_speed_error=0.01)),
        Case("sound speed 1 % off, taken for 0", replace(usual, sound_speed_error=0.01)),
        Case("focal length 0.5 % off, assumed", replace(assumed, focal_error=0.005)),
        Case("focal length 0.5 % off, taken for 0", replace(usual, focal_error=0.005)),
    ]


def _with_article(source: str) -> str:
    return {"angle": "the angle", "spot": "the spot", "calibration": "the calibration"}.get(source, source)


def table(*, count: int, seed: int, on_case: Callable[[str], object] = lambda _name: None) -> str:
    """The table as Markdown.

    Mean and 95th percentile of the TRE, its root mean square as found and as expected, and the share of registrations
    in which it is below the expected 95 %.

    ``seed``: each case draws the same scenes. ``on_case``: is told the name of each case when it begins.
    """
    errors = {tissue: kept_errors(tissue) for tissue in (POINT, *STAINED)}
    heads = "".join(f" camera at {1e3 * far_m:g} mm | 95 % | rms, expected | covered |" for far_m in CAMERA_M)
    lines = [f"| mean TRE in mm |{heads}", "|---" + "|---:" * (4 * len(CAMERA_M)) + "|"]
    for case in cases():
        on_case(case.name)
        cells = []
        for far_m in CAMERA_M:
            trials = registrations(
                replace(case.conditions, camera_m=far_m),
                errors[case.tissue],
                count=count,
                rng=np.random.default_rng(seed),
            )
            cells += _cells(trials)
        lines.append(f"| {case.name} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def _cells(trials: Sequence[Trial]) -> list[str]:
    tre_mm = np.array([1e3 * trial.tre_m for trial in trials])
    expected_mm = np.array([1e3 * trial.expected_tre_m for trial in trials])
    found, said = (np.sqrt(np.mean(values**2)) for values in (tre_mm, expected_mm))
    covered = np.mean([trial.tre_m <= trial.expected_tre95_m for trial in trials])
    return [
        f"{tre_mm.mean():.2f}",
        f"{np.percentile(tre_mm, 95):.2f}",
        f"{found:.2f}, {said:.2f}",
        f"{100 * covered:.0f} %",
    ]


def main() -> None:
    """Print the table, or make the searches anew from which it draws."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.registration",
        description="Errors of registrations with markers found by searches; all is simulated.",
    )
    parser.add_argument("--registrations", type=int, default=1000, help="registrations for each number (1000)")
    parser.add_argument("--seed", type=int, default=1, help="seed of the registrations (1)")
    parser.add_argument("--searches", action="store_true", help="make the searches anew (some minutes), print no table")
    arguments = parser.parse_args()
    if arguments.searches:
        found = [error for tissue, seeds in SEARCHES.items() for error in search_errors(tissue, seeds)]
        write_errors(found, Path(__file__).with_name(KEPT))
        return
    text = table(
        count=arguments.registrations,
        seed=arguments.seed,
        on_case=lambda name: sys.stderr.write(name + "\n"),
    )
    sys.stdout.write(text)


if __name__ == "__main__":
    main()
