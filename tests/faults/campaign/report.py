"""The page of the campaign: each promise with its count and bound, and each fault with its outcomes."""

from __future__ import annotations

from .checker import OFF_DEG
from .tally import PROMISES, Tally, summed, upper95
from .vocabulary import FAULTS, Fault

_WORDS = {
    "P1": "the probe never leaves its limits, nor the permit of its sweep when the host has died, in truth",
    "P2": "the laser is dark within its lease after a fault or the death of the host, at once after the end of a run",
    "P3": "pulses ≤ permitted, none while the stage moves but under the permit of a sweep, inside its angles and rate",
    "P6": "every fault that acted is reported, and no answer contains a faulty frame",
    "P7": "FAULT is left only by a person's reset (every verb tried in each run that ended there)",
    "P8": "every run ends within its caps",
}


def key_of(fault: Fault) -> str:
    """Name under which a tally holds a fault."""
    return f"{fault.device} {fault.name}"


def observable_keys() -> list[str]:
    """Faults of which the evidence is in what the devices send, and which do no harm before."""
    return [key_of(each) for each in FAULTS.values() if each.harm == "none"]


def promises(tally: Tally) -> list[str]:
    """Lines of the table of promises."""
    lines = ["| | promise | broken | runs | upper 95 % limit |", "|---|---|---|---|---|"]
    for promise in PROMISES:
        runs = tally.in_fault if promise == "P7" else tally.runs
        hits = tally.runs_that_broke(promise)
        lines.append(f"| {promise} | {_WORDS[promise]} | {hits} | {runs:,} | {upper95(hits, runs):.2g} |")
    single, none = (summed(tally.rows, keys) for keys in (observable_keys(), ["none"]))
    swept, swept_none = (summed(tally.swept, keys) for keys in (observable_keys(), ["none"]))
    for words, row in (
        ("under a single observable fault", single),
        ("without fault", none),
        ("by sweeps, under a single observable fault", swept),
        ("by sweeps, without fault", swept_none),
    ):
        limit = upper95(row.off, row.runs)
        covered = f", the interval covers {row.covered:,}" if words.startswith("by sweeps") else ""
        lines.append(
            f"| P10 | found and off by more than {OFF_DEG:g}° (twice the tolerance of intensities), {words} "
            f"({row.found:,} found{covered}) | {row.off} | {row.runs:,} | {limit:.2g} |"
        )
    reported = single.reported / single.acted if single.acted else 1.0
    missed = single.acted - single.reported
    lines.append(
        f"| P6 | single observable faults that acted and were not reported ({reported:.2%} reported) | {missed} | "
        f"{single.acted:,} | {upper95(missed, single.acted):.2g} |"
    )
    return lines


def faults(tally: Tally) -> list[str]:
    """One line for each fault, and one without: whether it shows in what the devices send before it does harm, and what
    covers a fault that no program can prevent."""
    evident = set(observable_keys())
    words = _in_words()
    lines = [
        (
            "| fault | to be seen | what happens | runs | acted | reported | ended with an answer | found | off | "
            "farthest beyond the travel, deg | of it more than injected | most pulses too many | most while moving |"
        ),
        "|---|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for name, row in sorted(tally.rows.items()):
        visible = "" if name in ("none", "two") else "yes" if name in evident else "no, or too late"
        lines.append(
            f"| {name} | {visible} | {words.get(name, '')} | {row.runs:,} | {row.acted:,} | {row.reported:,} | "
            f"{row.answers:,} | {row.found:,} | {row.off} | {row.excess_deg:.2f} | {row.beyond_deg:.2f} | "
            f"{row.excess_pulses} | {row.moving_pulses} |"
        )
    return lines


def _in_words() -> dict[str, str]:
    """By fault, its kind, what happens, and what covers it."""
    return {
        key_of(each): f"{each.kind.value}: {each.meaning}"
        + (f"; covered by: {each.covered_by}" if each.covered_by else "")
        for each in FAULTS.values()
    }
