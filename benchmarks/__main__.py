"""Run all benchmarks: ``python -m benchmarks [--quick] [--json] [--cores N]``."""

from __future__ import annotations

import argparse
import sys

from benchmarks import machine


def main() -> None:
    """Measure, and print the tables (or one JSON object)."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description="Time markerseek beside other programs.")
    parser.add_argument("--quick", action="store_true", help="fewer repetitions")
    parser.add_argument("--json", action="store_true", help="print one JSON object for programs")
    parser.add_argument("--cores", type=int, default=1, help="cores that all programs are held to (default 1)")
    arguments = parser.parse_args()
    # Before anything that starts threads is imported.
    machine.hold_to_cores(arguments.cores)
    circumstances = machine.describe(cores=arguments.cores)

    from benchmarks import beamforming, chain, commands, forward, journal, targets, timing
    from benchmarks.report import Report

    effort = timing.QUICK if arguments.quick else timing.FULL
    pairs: list[timing.Pair] = []
    singles: list[timing.Single] = []
    remarks: list[str] = []
    for name, section in (("beamforming", beamforming), ("simulation", forward)):
        print(f"comparing {name} ...", file=sys.stderr)
        found, said = section.compare(effort)
        pairs += found
        remarks += said
    for name, section in (
        ("the imaging chain", chain),
        ("simulation", forward),
        ("the journal", journal),
        ("commands", commands),
    ):
        print(f"timing {name} ...", file=sys.stderr)
        measured, said = section.measure(effort)
        singles += measured
        remarks += said
    report = Report(
        machine=circumstances,
        pairs=pairs,
        singles=singles,
        targets=targets.judge(pairs, singles),
        remarks=remarks,
    )
    print(report.as_json() if arguments.json else report.as_markdown())


if __name__ == "__main__":
    main()
