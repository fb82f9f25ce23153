"""How well the tip of an instrument is found: ``python -m benchmarks.tooltip [--scans N] [--development]``.

Prints a table: of N scans with a tip (and N without), by the default and as published, with and without a rectangle.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial

import numpy as np

from benchmarks.tooltip.scans import DEVELOPMENT, TEST, Family, Scan, make_scan
from markerseek.vision import Rectangle, SensitiveRange, published_sensitive_range, sensitive_range

WAYS: dict[str, Callable[..., SensitiveRange]] = {
    "default": sensitive_range,
    "--as-published": published_sensitive_range,
}


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """One scan by one way: how far the answer is from the truth."""

    way: str
    roi: bool
    tip: bool
    kind: str
    answered: bool
    for_saturation: bool
    place_mm: float = math.nan
    half_deg: float = math.nan


def outcomes(seed: int, *, family: Family, tip: bool) -> list[Outcome]:
    """One scan, by all ways."""
    scan = make_scan(family, seed, tip=tip)
    return [_outcome(scan, way, roi=roi) for way in WAYS for roi in (True, False)]


def _outcome(scan: Scan, way: str, *, roi: bool) -> Outcome:
    row, column, rows, columns = scan.roi
    rectangle = Rectangle(row=row, column=column, rows=rows, columns=columns) if roi else None
    found = WAYS[way](scan.angles_deg, scan.images, pixel_m=scan.pixel_m, rectangle=rectangle)
    said = partial(Outcome, way=way, roi=roi, tip=scan.tip, kind=scan.kind, for_saturation="saturated" in found.remark)
    if found.reference_deg is None or found.half_deg is None:
        return said(answered=False)
    number = next(k for k, frame in enumerate(found.frames) if frame.angle_deg == found.reference_deg)
    tip = found.frames[number].tip
    assert tip is not None
    down, along = (each - true for each, true in zip((tip.row, tip.column), scan.places[number], strict=True))
    return said(
        answered=True,
        place_mm=1e3 * math.hypot(down * scan.pixel_m[0], along * scan.pixel_m[1]),
        half_deg=found.half_deg - scan.half_deg,
    )


def main() -> None:
    """Draw the scans, and print the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.tooltip", description=__doc__)
    parser.add_argument("--scans", type=int, default=60, help="scans with a tip, and as many without (default 60)")
    parser.add_argument("--development", action="store_true", help="the scans on which the method was developed")
    parser.add_argument("--workers", type=int, default=2, help="processes (default 2)")
    parser.add_argument("--each", action="store_true", help="print each scan, too")
    arguments = parser.parse_args()
    family, first = (DEVELOPMENT, 1000) if arguments.development else (TEST, 5000)
    seeds = range(first, first + arguments.scans)
    found: list[Outcome] = []
    for tip in (True, False):
        with ProcessPoolExecutor(arguments.workers) as pool:
            for each in pool.map(partial(outcomes, family=family, tip=tip), seeds):
                found += each
    if arguments.each:
        print(*found, sep="\n", file=sys.stderr)
    print(
        "| | answered | within 1 mm | half range within 1° | its bias | saturated: answered or said | no tip: claimed |"
    )
    print("|---|---|---|---|---|---|---|")
    for way in WAYS:
        for roi in (True, False):
            print(_line(way, [each for each in found if each.way == way and each.roi == roi], roi=roi))


def _line(way: str, found: list[Outcome], *, roi: bool) -> str:
    with_tip = [each for each in found if each.tip]
    answered = [each for each in with_tip if each.answered]
    near = sum(each.place_mm <= 1 for each in answered)
    halves = np.array([each.half_deg for each in answered])
    bright = [each for each in with_tip if "saturated" in each.kind]
    claimed = sum(each.answered for each in found if not each.tip)
    cells = [
        way + (" with --roi" if roi else ""),
        f"{len(answered)} of {len(with_tip)}",
        f"{near} of {len(answered)}",
        f"{np.sum(np.abs(halves) <= 1)} of {len(answered)}",
        f"{halves.mean():+.2f}° (median {np.median(halves):+.2f}°)" if len(halves) else "–",
        f"{sum(each.answered or each.for_saturation for each in bright)} of {len(bright)}",
        f"{claimed} of {len(found) - len(with_tip)}",
    ]
    return "| " + " | ".join(cells) + " |"


if __name__ == "__main__":
    main()
