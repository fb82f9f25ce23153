"""Prints a table of bugs seeded into the package and whether the check of each detects it.

A bug is one piece of source text replaced by another. ``python -m tests.faults.seeded_bugs`` prints the table.
"""

# ruff: noqa: T201 - a program, which prints

from __future__ import annotations

from tests.faults.seeding import table
from tests.faults.test_seeded_driver_bugs import DRIVER_BUGS
from tests.faults.test_seeded_guard_bugs import GUARD_BUGS
from tests.faults.test_seeded_journal_bugs import JOURNAL_BUGS
from tests.faults.test_seeded_supervisor_bugs import SEEDED, SUPERVISOR_BUGS


def main() -> None:
    """Print the table."""
    print("| bug | where | caught by | |\n|---|---|---|---|")
    print(*table(GUARD_BUGS), sep="\n")
    for name, bug in SUPERVISOR_BUGS.items():
        SEEDED.append(name)
        print(*table({name: bug}))
        SEEDED.pop()
    print(*table(JOURNAL_BUGS), *table(DRIVER_BUGS), sep="\n")


if __name__ == "__main__":
    main()
