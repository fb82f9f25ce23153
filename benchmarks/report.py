"""The results as Markdown for people, and as one JSON object for programs."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass

from benchmarks.targets import Target
from benchmarks.timing import PROVES_NOTHING, Pair, Single


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """Everything that one run of the benchmarks found out."""

    machine: dict[str, str]
    pairs: Sequence[Pair]
    singles: Sequence[Single]
    targets: Sequence[Target]
    remarks: Sequence[str]

    def as_json(self) -> str:
        """One object with the same content as the tables."""
        return json.dumps(
            {
                "machine": self.machine,
                "pairs": [{**asdict(pair), "proves_nothing": pair.proves_nothing} for pair in self.pairs],
                "singles": [asdict(single) for single in self.singles],
                "targets": [asdict(target) for target in self.targets],
                "remarks": list(self.remarks),
            },
            indent=2,
            ensure_ascii=False,
        )

    def as_markdown(self) -> str:
        """Tables, with the targets last."""
        parts = [
            "\n".join(f"- {name}: {value}" for name, value in self.machine.items()),
            "### Beside other programs, in turn (processor time)",
            _table(
                ("work", "peer", "ours, ms", "peer, ms", "peer / ours", "least – most", "rounds", "outputs differ by"),
                map(_pair_row, self.pairs),
            ),
            f"\\* Ratios between 1/{PROVES_NOTHING:g} and {PROVES_NOTHING:g} prove nothing.",
            "### Ours alone (time on the clock)",
            _table(
                ("work", "median, ms", "least – most, ms", "processor time, ms", "rounds"),
                map(_single_row, self.singles),
            ),
            "\n".join(f"- {remark}" for remark in self.remarks),
            "### Targets",
            _table(("work", "target", "measured", "met"), map(_target_row, self.targets)),
        ]
        return "\n\n".join(part for part in parts if part)


def _pair_row(pair: Pair) -> tuple[str, ...]:
    ratio = f"{pair.ratio:.3g}" + (" \\*" if pair.proves_nothing else "")
    spread = f"{pair.least_ratio:.3g} – {pair.most_ratio:.3g}"
    times = (f"{pair.ours_ms:.3g}", f"{pair.peer_ms:.3g}")
    return (pair.work, pair.peer, *times, ratio, spread, str(pair.rounds), pair.agreement)


def _single_row(single: Single) -> tuple[str, ...]:
    spread = f"{single.least_ms:.3g} – {single.most_ms:.3g}"
    return (single.work, f"{single.ms:.3g}", spread, f"{single.processor_ms:.3g}", str(single.rounds))


def _target_row(target: Target) -> tuple[str, ...]:
    met = {True: "met", False: "**missed**", None: "not measured"}[target.met]
    return (target.work, target.limit, target.figure, met)


def _table(head: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    lines = [head, ("---",) * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)
