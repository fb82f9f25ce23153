"""Answers from all angles of recordings that the package did not simulate, counted.

``python -m tests.reference.search.whole_scans --scans 200 --two-peaks 200`` prints how often one marker among clutter
is found, and two peaks are ambiguous. `independent_scans` makes both.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest import mock

from markerseek import replayed
from markerseek.cli import main
from markerseek.core import Estimate, Found, NotFound, SearchPlan
from markerseek.runs import answer_from_all
from markerseek.show import answer_name
from tests.reference.search.independent_scans import Scan, scan_of, two_peaks_of

WRONG_DEG = 1.0
"""Farther off than this, an answer is of another place."""


@dataclass
class Count:
    """Answers of many recordings."""

    names: Counter[str] = field(default_factory=Counter)
    wrong: int = 0
    """Found, and at another place."""
    intervals: int = 0
    covered: int = 0

    def add(self, answer: Estimate, true_deg: float) -> None:
        """Count one answer."""
        self.names[answer_name(answer)] += 1
        self.wrong += isinstance(answer, Found) and abs(answer.mean_deg - true_deg) > WRONG_DEG
        interval = None if isinstance(answer, NotFound) else answer.interval95_deg
        if interval is not None:
            self.intervals += 1
            self.covered += interval.low_deg <= true_deg <= interval.high_deg

    def __str__(self) -> str:
        """In one line."""
        said = ", ".join(f"{count} {name}" for name, count in self.names.most_common())
        return f"{said}; {self.covered} of {self.intervals} intervals cover; {self.wrong} found at another place"


def bank_of(scan: Scan, folder: Path) -> Path:
    """The scan as ``markerseek bank import`` makes a bank of it."""
    arrays = folder / "scan.npz"
    bank = folder / "scan.hdf5"
    scan.write(arrays)
    bank.unlink(missing_ok=True)
    with mock.patch("sys.argv", ["markerseek", "bank", "import", str(arrays), str(bank)]):
        try:
            main()
        except SystemExit as ended:
            if ended.code:
                raise
    return bank


def whole(path: Path, *, others: float | None = None) -> Estimate:
    """The answer from all angles of a recording; ``others``: 0 states a single source."""
    answer = answer_from_all(replayed(path), SearchPlan(method="posterior", others=others))
    assert answer is not None
    return answer


def counted_scans(seeds: range, folder: Path) -> tuple[Count, Count]:
    """Answers of scans of one marker among clutter, without and with the statement that there is a single source."""
    usual = Count()
    single = Count()
    for seed in seeds:
        scan = scan_of(seed)
        bank = bank_of(scan, folder)
        usual.add(whole(bank), scan.marker_deg)
        single.add(whole(bank, others=0.0), scan.marker_deg)
    return usual, single


def counted_two_peaks(seeds: range, folder: Path) -> Count:
    """Answers of tables of two peaks; wrong is the weaker one found."""
    count = Count()
    for seed in seeds:
        two_peaks = two_peaks_of(seed)
        table = folder / "two-peaks.csv"
        two_peaks.write(table)
        count.add(whole(table), two_peaks.stronger_deg)
    return count


def run(words: list[str]) -> None:
    """Print the counts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scans", type=int, default=0)
    parser.add_argument("--two-peaks", type=int, default=0)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    asked = parser.parse_args(words)
    with TemporaryDirectory() as name:
        folder = Path(name)
        if asked.scans:
            usual, single = counted_scans(range(asked.first, asked.first + asked.scans), folder)
            sys.stdout.write(f"one marker among clutter: {usual}\nthe same, single: {single}\n")
        if asked.two_peaks:
            count = counted_two_peaks(range(asked.first, asked.first + asked.two_peaks), folder)
            sys.stdout.write(f"two peaks: {count}\n")


if __name__ == "__main__":
    run(sys.argv[1:])
