"""The offline analysis (section 2.5): Fig. 6, errors over the number of acquisitions, and Table 1, errors after 16."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, TypeAlias

from markerseek import rigs
from markerseek.core import Estimate
from markerseek.records.banks import read_bank
from markerseek.studies.paper.banks import OfflineBank
from markerseek.studies.paper.methods import (
    ALL_METHODS,
    AVERAGE_ACQUISITIONS,
    BRACKET_ACQUISITIONS,
    BRACKETS,
    PAPER_METHODS,
    TABLE_ACQUISITIONS,
    AnyMethod,
    QuantisedPolicy,
    policy_of,
)
from markerseek.studies.paper.options import RunOptions
from markerseek.studies.paper.printed import MATERIALS, OwnNumber, paper_number
from markerseek.studies.paper.section import (
    ERRORS,
    Answer,
    Cell,
    Comparison,
    Errors,
    Section,
    Table,
    compared,
    errors_of,
    errors_table,
    make_section,
    make_table,
    summary_of,
)
from markerseek.studies.paper.style import Panel, errors_figure
from markerseek.studies.trial import searched

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, slots=True, kw_only=True)
class OfflineSearch:
    """One search on one bank."""

    bank: OfflineBank
    method: AnyMethod
    acquisitions: int
    estimate: Estimate
    reference_deg: float
    maximum_deg: float
    """``reference_deg`` and ``maximum_deg``: angle that counts as true, and that of the bank's largest intensity."""

    @property
    def answer(self) -> Answer:
        """Its error from the reference, and whether it claims its angle."""
        return Answer.of(self.estimate, truth_deg=self.reference_deg)


def offline_searches(banks: Sequence[OfflineBank], options: RunOptions) -> list[OfflineSearch]:
    """Searches with every method and every number of acquisitions of Fig. 6 on each bank."""
    return [search for found in options.each(_searches, banks, stage="offline searches") for search in found]


def _searches(bank: OfflineBank) -> list[OfflineSearch]:
    rig = rigs.replayed(bank.path, reference_deg=bank.reference_deg, between="interpolated")
    limits = rig.limits.search
    recorded = [rig.scanner.measure(angle_deg) for angle_deg in read_bank(bank.path).angles_deg]
    maximum_deg = max(recorded, key=lambda sample: sample.reading.intensity).angle_deg
    # The angles of TS, GSS and the posterior do not depend on N; the steps of WA do, so that each N is its own search.
    runs: list[tuple[AnyMethod, tuple[int, ...]]] = [
        *((name, BRACKET_ACQUISITIONS) for name in BRACKETS),
        *(("WA", (count,)) for count in AVERAGE_ACQUISITIONS),
        ("posterior", BRACKET_ACQUISITIONS),
    ]
    searches = []
    for name, counts in runs:
        policy = policy_of(name, acquisitions=max(counts), limits=limits, start_deg=limits.low_deg)
        found = searched(QuantisedPolicy(policy, limits=limits), rig.scanner, counts=counts)
        searches += [
            OfflineSearch(
                bank=bank,
                method=name,
                acquisitions=count,
                estimate=answer,
                reference_deg=maximum_deg if bank.reference_deg is None else bank.reference_deg,
                maximum_deg=maximum_deg,
            )
            for count, answer in found.answers.items()
        ]
    return searches


_Group: TypeAlias = tuple[str, float | None, AnyMethod, int]
"""Material, peak SNR, method, number of acquisitions."""

_COLUMNS = "material peak_snr_db method acquisitions"


def fig6(searches: Sequence[OfflineSearch]) -> Section:
    """Fig. 6: mean error over the number of acquisitions, one panel for each material."""
    errors = {group: summary_of(each.answer for each in found) for group, found in _groups(searches).items()}
    rows = (
        (
            each.bank.path.name, each.bank.position, each.method, each.acquisitions, each.estimate.mean_deg,
            each.reference_deg, each.maximum_deg, each.answer.error_deg, "yes" if each.answer.claimed else "no",
        )
        for each in searches
    )  # fmt: skip
    return _section(
        "fig6",
        searches,
        comparisons=_worst_after_28(errors),
        tables=(
            errors_table("fig6", "Errors of the offline searches", _COLUMNS, errors),
            make_table(
                "fig6_searches",
                "Every offline search",
                "bank position method acquisitions angle_deg reference_deg bank_maximum_deg error_deg claimed",
                rows,
                shown=False,
            ),
        ),
        draw=partial(_draw, errors),
    )


def table1(searches: Sequence[OfflineSearch]) -> Section:
    """Table 1: errors after 16 acquisitions."""
    groups = {group: found for group, found in _groups(searches).items() if group[3] == TABLE_ACQUISITIONS}
    errors = {group: summary_of(each.answer for each in found) for group, found in groups.items()}
    # A bank of the user is of no material of the paper, and has no level of noise.
    of_the_paper = [(group, each) for group, each in errors.items() if group[1] is not None]
    rows: list[tuple[Cell, ...]] = []
    for group, found in groups.items():
        from_maximum = errors_of(abs(each.estimate.mean_deg - each.maximum_deg) for each in found)
        rows.append((*group, *errors[group].cells, from_maximum.mean_deg, from_maximum.sd_deg))
    after = f"after {TABLE_ACQUISITIONS} acquisitions, mean error"
    comparisons = (
        compared(
            OwnNumber(quantity=f"posterior (ours) on {material} {after}")
            if name == "posterior"
            else f"table1/{name}/{material}",
            each,
            condition=f"{level_db:g} dB",
        )
        # Of each material by method, then by noise.
        for (material, level_db, name, _), each in sorted(of_the_paper, key=lambda item: _place_in_table1(item[0]))
    )
    return _section(
        "table1",
        searches,
        comparisons=tuple(comparisons),
        tables=(
            make_table(
                "table1",
                "Errors from the reference, and from the largest intensity of the bank itself",
                f"{_COLUMNS} {ERRORS} mean_from_maximum_deg spread_from_maximum_deg",
                rows,
            ),
        ),
    )


def _place_in_table1(group: _Group) -> tuple[int, int, float]:
    material, level_db, name, _ = group
    return MATERIALS.index(material), ALL_METHODS.index(name), level_db or 0.0


def _section(
    name: str,
    searches: Sequence[OfflineSearch],
    *,
    comparisons: tuple[Comparison, ...],
    tables: tuple[Table, ...],
    draw: Callable[[], Figure] | None = None,
) -> Section:
    """Section with the text on the banks; a user's own is of another material, to which no number belongs."""
    bank = searches[0].bank
    own = bank.peak_snr_db is None
    return make_section(
        name,
        method=("offline, own" if own else "offline, simulated", "offline"),
        comparisons=() if own else comparisons,
        tables=tables,
        draw=draw,
        bank=bank.path,
        reference="given" if bank.reference_deg is not None else "the angle of the bank's largest intensity",
        acquisitions=TABLE_ACQUISITIONS,
    )


def _groups(searches: Sequence[OfflineSearch]) -> dict[_Group, list[OfflineSearch]]:
    groups: dict[_Group, list[OfflineSearch]] = {}
    for each in searches:
        group = (each.bank.material, each.bank.peak_snr_db, each.method, each.acquisitions)
        groups.setdefault(group, []).append(each)
    return groups


def _worst_after_28(errors: dict[_Group, Errors]) -> tuple[Comparison, ...]:
    """The conclusion's "below 0.5° on all materials": the largest mean error of TS, of GSS, and of the posterior."""
    ours = OwnNumber(quantity="posterior (ours) on every material after 28 acquisitions, mean error: at most")
    comparisons = []
    for level_db in dict.fromkeys(level_db for _, level_db, _, _ in errors if level_db is not None):
        for name in (*BRACKETS, "posterior"):
            found = [each for (_, *group), each in errors.items() if group == [level_db, name, 28]]
            worst = max(found, key=lambda each: each.mean_deg)
            number = ours if name == "posterior" else "fig6/28"
            comparisons.append(compared(number, worst, condition=f"{name}, the worst material, {level_db:g} dB"))
    return tuple(comparisons)


def _draw(errors: dict[_Group, Errors]) -> Figure:
    places = list(dict.fromkeys((level_db, material) for material, level_db, _, _ in errors))
    # By noise first: each noise has a row of panels, one for each material.
    places.sort(key=lambda place: place[0] or 0.0)
    is_simulated = places[0][0] is not None
    return errors_figure(
        [
            Panel(
                title=material if level_db is None else f"{material}, {level_db:g} dB",
                errors={group[2:]: each for group, each in errors.items() if group[:2] == (material, level_db)},
                printed_deg={
                    (name, TABLE_ACQUISITIONS): paper_number(f"table1/{name}/{material}").value
                    for name in PAPER_METHODS
                    if is_simulated
                },
            )
            for level_db, material in places
        ],
        heading="Offline searches" + (" on simulated stand-ins" if is_simulated else ""),
        columns=5,
        # A panel alone must be wide enough for the legend.
        panel_in=(2.9, 3.0) if len(places) > 1 else (6.0, 4.0),
        printed="paper (Table 1)",
    )
