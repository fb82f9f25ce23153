"""Print the table of the study: ``python -m markerseek.studies.registration [--registrations N] [--searches]``."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from markerseek.studies.registration.marker_errors import KEPT, SEARCHES, search_errors, write_errors
from markerseek.studies.registration.table import table


def main() -> None:
    """Print the table, or make the searches anew from which it draws."""
    parser = argparse.ArgumentParser(
        prog="python -m markerseek.studies.registration",
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
