"""The page of the campaign: each promise with its count and bound, and each fault with its outcomes."""

from __future__ import annotations

from collections.abc import Iterable

from markerseek.emulators.faults import FAULTS as EMULATED

from .bytes_runs import LASER_AND_DAQ
from .checker import OFF_DEG
from .tally import PROMISES, Row, Tally, upper95
from .vocabulary import FAULTS, Injected

_WORDS = {
    "P1": "the probe never leaves its limits, nor the permit of its sweep when the host has died, in truth",
    "P3": "pulses ≤ permitted, none while the stage moves but under the permit of a sweep, inside its angles and rate",
    "P6": "every fault that acted is reported, and no answer contains a faulty frame",
    "P7": "FAULT is left only by a person's reset (every verb tried in each run that ended there)",
    "P8": "every run ends within its caps",
}


def key_of(injected: Injected) -> str:
    """Name under which a tally holds a fault."""
    return f"{injected.fault.device} {injected.fault.name}"


def observable_keys() -> list[str]:
    """Faults of which the evidence is in what the devices send, and which do no harm before."""
    return [key_of(each) for each in FAULTS.values() if each.harm == "none"]


def promises(tally: Tally, *, preventable: Iterable[str], acts: bool = True) -> list[str]:
    """Lines of the table of promises; ``acts``: whether it is known which faults acted."""
    lines = ["| | promise | broken | runs | upper 95 % limit |", "|---|---|---|---|---|"]
    for promise in PROMISES:
        runs = tally.in_fault if promise == "P7" else tally.runs
        hits = tally.runs_that_broke(promise)
        lines.append(f"| {promise} | {_WORDS[promise]} | {hits} | {runs:,} | {upper95(hits, runs):.2g} |")
    single = tally.of(preventable)
    none = tally.of(["none"])
    for words, row in (("under a single observable fault", single), ("without fault", none)):
        limit = upper95(row.off, row.runs)
        lines.append(
            f"| P10 | found and off by more than {OFF_DEG:g}° (twice the tolerance of intensities), {words} "
            f"({row.found:,} found) | {row.off} | {row.runs:,} | {limit:.2g} |"
        )
    if not acts:
        return lines
    reported = single.reported / single.acted if single.acted else 1.0
    missed = single.acted - single.reported
    lines.append(
        f"| P6 | single observable faults that acted and were not reported ({reported:.2%} reported) | {missed} | "
        f"{single.acted:,} | {upper95(missed, single.acted):.2g} |"
    )
    return lines


def kinds(tally: Tally) -> list[str]:
    """Observable faults by device and kind."""
    groups: dict[tuple[str, str], list[str]] = {}
    for each in FAULTS.values():
        if each.harm == "none":
            groups.setdefault((each.fault.device, each.fault.kind.value), []).append(key_of(each))
    lines = [
        f"| device | kind | runs | acted | reported | found | found and off > {OFF_DEG:g}° | upper 95 % limit |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for (device, kind), keys in sorted(groups.items()):
        row = tally.of(keys)
        lines.append(
            f"| {device} | {kind} | {row.runs:,} | {row.acted:,} | {row.reported:,} | {row.found:,} | {row.off} | "
            f"{upper95(row.off, row.runs):.2g} |"
        )
    return lines


def observable(tally: Tally) -> list[str]:
    """One line for each observable fault."""
    lines = [
        "| fault | kind | what happens | runs | acted | reported | found | off |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for each in FAULTS.values():
        if each.harm != "none":
            continue
        row = tally.rows.get(key_of(each), Row())
        fault = each.fault
        lines.append(
            f"| {key_of(each)} | {fault.kind.value} | {fault.meaning} | {row.runs:,} | {row.acted:,} | "
            f"{row.reported:,} | {row.found:,} | {row.off} |"
        )
    return lines


def uncovered(tally: Tally) -> list[str]:
    """One line for each fault that no program can prevent: what it did, and what must cover it."""
    lines = [
        (
            "| fault | seen | what happens | runs | farthest beyond the travel, deg | of it more than injected | "
            "most pulses too many | most pulses while moving | found | off | what covers it |"
        ),
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for each in FAULTS.values():
        if each.harm == "none":
            continue
        row = tally.rows.get(key_of(each), Row())
        seen = "afterwards" if each.fault.observable else "no"
        lines.append(
            f"| {key_of(each)} | {seen} | {each.fault.meaning} | {row.runs:,} | {row.excess_deg:.2f} | "
            f"{row.beyond_deg:.2f} | {row.excess_pulses} | {row.moving_pulses} | {row.found:,} | {row.off} | "
            f"{each.covered_by} |"
        )
    return lines


def byte_keys() -> list[str]:
    """Faults of emulated devices of which the evidence is in their bytes, and which do no harm before."""
    stage = [f"stage {name}" for name, fault in EMULATED["stage"].items() if fault.observable]
    return stage + [fault.name for fault in LASER_AND_DAQ if fault.harm == "none"]


def over_the_line(tally: Tally) -> list[str]:
    """One line for each fault of an emulated device."""
    seen = set(byte_keys())
    lines = [
        (
            "| fault | to be seen | runs | reported | ended with an answer | found | off | beyond the travel, deg | "
            "pulses too many |"
        ),
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for name, row in sorted(tally.rows.items()):
        visible = "" if name == "none" else "yes" if name in seen else "no, or too late"
        lines.append(
            f"| {name} | {visible} | {row.runs:,} | {row.reported:,} | {row.answers:,} | {row.found:,} | {row.off} | "
            f"{row.excess_deg:.2f} | {row.excess_pulses} |"
        )
    return lines
