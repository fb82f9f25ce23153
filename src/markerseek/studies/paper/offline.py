"""The offline analysis (section 2.5): Fig. 6, errors over the number of acquisitions, and Table 1, errors after 16."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
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
    searched,
)
from markerseek.studies.paper.options import RunOptions
from markerseek.studies.paper.printed import MATERIALS, OwnNumber, paper_number
from markerseek.studies.paper.section import (
    Answer,
    Cell,
    Comparison,
    Errors,
    Section,
    Table,
    compared,
    errors_of,
    summary_of,
)
from markerseek.studies.paper.style import Panel, errors_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SIMULATED = (
    (
        "Each bank is a scan of ±35° in 0.5° steps on the simulated rig: channel data, noise, beamforming, envelope. "
        "The materials are simulated stand-ins with properties of our choice, not measured: nine positions of a rough "
        "3 × 3 grid of 20 mm for each material, one for the stained muscle. The reference is the true angle."
    ),
    (
        "Every bank was made at a peak SNR of 40 dB, the default of the simulated rig, and at 60 dB. Our numbers at "
        "both are compared with the paper's."
    ),
)
_SEARCHES = (
    (
        "TS, GSS and WA are the published ones. All run on the bank through the same loop as on a rig, at angles "
        "rounded to the motor's encoder counts, with linear interpolation between recorded angles. WA makes full scans "
        "and omits samples below 0.2 of the largest."
    ),
    (
        "The posterior is markerseek's own search, and not in the paper. It makes exactly N acquisitions, has "
        "intensities only, as the others, and knows that there is one source, as they assume. Its mean error is that "
        "of all its answers; those without a claim are not found, at bound, ambiguous or unsure."
    ),
)


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


def _named(group: _Group) -> dict[str, Cell]:
    return dict(zip(("material", "peak_snr_db", "method", "acquisitions"), group, strict=True))


def fig6(searches: Sequence[OfflineSearch]) -> Section:
    """Fig. 6: mean error over the number of acquisitions, one panel for each material."""
    errors = {group: summary_of(each.answer for each in found) for group, found in _groups(searches).items()}
    return Section(
        name="fig6",
        title="Fig. 6: offline analysis, mean error over the number of acquisitions",
        method=_method(searches),
        comparisons=_worst_after_28(errors) if _is_simulated(searches) else (),
        tables=(
            Table(
                name="fig6",
                caption="Errors of the offline searches",
                rows=tuple({**_named(group), **each.cells} for group, each in errors.items()),
                shown=False,
            ),
            Table(
                name="fig6_searches",
                caption="Every offline search",
                rows=tuple(
                    {
                        "bank": each.bank.path.name,
                        "position": each.bank.position,
                        "method": each.method,
                        "acquisitions": each.acquisitions,
                        "angle_deg": each.estimate.mean_deg,
                        "reference_deg": each.reference_deg,
                        "bank_maximum_deg": each.maximum_deg,
                        "error_deg": each.answer.error_deg,
                        "claimed": "yes" if each.answer.claimed else "no",
                    }
                    for each in searches
                ),
                shown=False,
            ),
        ),
        draw=partial(_draw, errors),
        alt="Mean error over the number of acquisitions for TS, GSS, WA and the posterior, one panel for each material",
    )


def table1(searches: Sequence[OfflineSearch]) -> Section:
    """Table 1: errors after 16 acquisitions."""
    groups = {group: found for group, found in _groups(searches).items() if group[3] == TABLE_ACQUISITIONS}
    errors = {group: summary_of(each.answer for each in found) for group, found in groups.items()}
    rows = []
    for group, found in groups.items():
        from_maximum = errors_of(abs(each.estimate.mean_deg - each.maximum_deg) for each in found)
        rows.append(
            {
                **_named(group),
                **errors[group].cells,
                "mean_from_maximum_deg": from_maximum.mean_deg,
                "spread_from_maximum_deg": from_maximum.sd_deg,
            }
        )
    # A user's own bank is of another material, to which none of the paper's numbers belongs.
    comparisons = [
        compared(_number(name, material), errors[material, level_db, name, 16], condition=f"{level_db:g} dB")
        for material in MATERIALS
        for name in ALL_METHODS
        for level_db in _levels(groups)
        if _is_simulated(searches)
    ]
    return Section(
        name="table1",
        title=f"Table 1: offline analysis after {TABLE_ACQUISITIONS} acquisitions",
        method=_method(searches),
        comparisons=tuple(comparisons),
        tables=(
            Table(
                name="table1",
                caption="Errors from the reference, and from the largest intensity of the bank itself",
                rows=tuple(rows),
            ),
        ),
    )


def _number(name: AnyMethod, material: str) -> str | OwnNumber:
    """Key of the number of Table 1, or of the posterior its name."""
    if name != "posterior":
        return f"table1/{name}/{material}"
    return OwnNumber(quantity=f"posterior (ours) on {material} after {TABLE_ACQUISITIONS} acquisitions, mean error")


def _is_simulated(searches: Sequence[OfflineSearch]) -> bool:
    return searches[0].bank.peak_snr_db is not None


def _method(searches: Sequence[OfflineSearch]) -> tuple[str, ...]:
    if _is_simulated(searches):
        return (*_SIMULATED, *_SEARCHES)
    bank = searches[0].bank
    reference = "given" if bank.reference_deg is not None else "the angle of the bank's largest intensity"
    return (f"The bank is the user's own, {bank.path}; the reference angle is {reference}.", *_SEARCHES)


def _groups(searches: Sequence[OfflineSearch]) -> dict[_Group, list[OfflineSearch]]:
    groups: dict[_Group, list[OfflineSearch]] = {}
    for each in searches:
        group = (each.bank.material, each.bank.peak_snr_db, each.method, each.acquisitions)
        groups.setdefault(group, []).append(each)
    return groups


def _levels(groups: Iterable[_Group]) -> list[float | None]:
    return list(dict.fromkeys(level_db for _, level_db, _, _ in groups))


def _worst_after_28(errors: dict[_Group, Errors]) -> tuple[Comparison, ...]:
    """The conclusion's "below 0.5° on all materials": the largest mean error of TS, of GSS, and of the posterior."""
    ours = OwnNumber(quantity="posterior (ours) on every material after 28 acquisitions, mean error: at most")
    comparisons = []
    for level_db in _levels(errors):
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
