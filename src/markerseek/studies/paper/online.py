"""The online analysis (section 2.5 C) and Table 2: the searches drive the simulated rig, in virtual time.

Stage motion, play, pulses, noise and averaging are those of the simulated rig; each acquisition is a frame of channel
data. The probe begins at −35°, and a search ends with a move to the angle found.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

import numpy as np

from markerseek import rigs
from markerseek.core import PAPER_RANGE, Estimate, Policy, PolicyPlan, SearchError
from markerseek.search import build
from markerseek.sim import MarkerSettings, NoiseSettings, ReceiverSettings, SimulatedSettings
from markerseek.studies.paper.banks import LEVELS_DB, PEAK_COUNTS, grid
from markerseek.studies.paper.methods import (
    BRACKET_ACQUISITIONS,
    BRACKETS,
    ONLINE_STEPS,
    PAPER_METHODS,
    TABLE_ACQUISITIONS,
    PaperMethod,
    policy_of,
    searched,
)
from markerseek.studies.paper.options import RunOptions
from markerseek.studies.paper.printed import OwnNumber, paper_number
from markerseek.studies.paper.section import Answer, Cell, Comparison, Section, Table, compared, errors_of, summary_of

REPEATS = 4
"""Times that the nine positions are visited, each time with another grid, other spots and other noise."""

TISSUE = "plastisol-phantom"
"""The simulated stand-in for the phantom of the online analysis."""

Ours: TypeAlias = Literal["posterior", "posterior, 16", "posterior, survey"]
"""The posterior in three forms; see `_FORMS`."""

OnlineMethod: TypeAlias = PaperMethod | Ours

_ORDER: tuple[OnlineMethod, ...] = (*PAPER_METHODS, *get_args(Ours))

ENDS_BY_ITSELF: tuple[OnlineMethod, ...] = ("WA", "posterior", "posterior, survey")
"""Methods whose number of acquisitions is a result."""

_FORMS = (
    "The posterior is markerseek's own search, and not in the paper. It takes three dark frames first, and is shown in "
    'three forms: "posterior" ends by itself after at most 16 acquisitions, "posterior, 16" makes exactly 16; both '
    'know that there is one source, as the paper\'s searches assume. "posterior, survey", the default of `markerseek '
    "search`, does not know it, and also makes sure that no other source as strong lies in the range. Their mean error "
    "is that of all their answers; those without a claim are not found, at bound, ambiguous or unsure."
)

METHOD = (
    (
        "The searches drive the simulated rig in virtual time, from −35°: stage with its encoder, play and approach "
        "from below, laser pulses with jitter, 16 of them averaged, frames of 128 channels with noise, beamforming. "
        "The phantom is a simulated stand-in. TS and GSS make 28 acquisitions; the answers of shorter searches are "
        "those of the same run, because the angles of a bracket search do not depend on its length. WA steps by 5° and "
        "ends once the peak is recorded and passed. The reference is the true angle."
    ),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class OnlineSearch:
    """One search on the rig."""

    method: OnlineMethod
    peak_snr_db: float
    repeat: int
    position: int
    """``method``, ``peak_snr_db``, ``repeat`` and ``position``: method, noise and place: the position is counted from
    1, the repeat from 0."""
    truth_deg: float
    track_deg: tuple[float, ...]
    """Angles reached, one for each acquisition."""
    estimates: dict[int, Estimate]
    """Answers by number of acquisitions; of WA and ours the last only."""
    travel_deg: float
    """Rotation from −35° to the angle found."""
    elapsed_s: float
    acquiring_s: float
    """``elapsed_s`` and ``acquiring_s``: virtual time from the first move to the end, and the part of it that
    acquisitions took."""

    @property
    def table_acquisitions(self) -> int:
        """Acquisitions of Table 2: 16 of a bracket search, all of the others."""
        return TABLE_ACQUISITIONS if self.method in BRACKETS else len(self.track_deg)

    def answer(self, acquisitions: int) -> Answer:
        """Answer after this number of acquisitions."""
        return Answer.of(self.estimates[acquisitions], truth_deg=self.truth_deg)

    @property
    def table_answer(self) -> Answer:
        """Answer of Table 2."""
        return self.answer(self.table_acquisitions)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Job:
    method: OnlineMethod
    peak_snr_db: float
    repeat: int
    position: int
    marker: MarkerSettings
    seed: int


def online_searches(options: RunOptions) -> list[OnlineSearch]:
    """Searches of TS, GSS (28 acquisitions), WA (5° steps, early end) and ours at the nine positions under each noise.

    The markers are the same for all methods and noises. With fewer markers than the paper's there are fewer repeats.
    """
    jobs = []
    for repeat in range(max(1, round(REPEATS * options.share))):
        seeds = np.random.SeedSequence([options.seed, 77, repeat])
        for position, marker in enumerate(grid(np.random.Generator(np.random.PCG64(seeds))), start=1):
            # The seed depends on the place only: methods and noises are compared on the same random numbers.
            seed = int(seeds.generate_state(1)[0]) + position
            jobs += [
                _Job(method=name, peak_snr_db=level_db, repeat=repeat, position=position, marker=marker, seed=seed)
                for level_db in LEVELS_DB
                for name in _ORDER
            ]
    return options.each(_search, jobs, stage="online searches, from channel data")


def _search(job: _Job) -> OnlineSearch:
    settings = SimulatedSettings(
        tissue=TISSUE,
        marker=job.marker,
        noise=NoiseSettings(peak_snr_db=job.peak_snr_db),
        receiver=ReceiverSettings(peak_counts=PEAK_COUNTS),
        start_deg=PAPER_RANGE.low_deg,
    )
    rig = rigs.simulated(seed=job.seed, settings=settings)
    if rig.facts.truth_deg is None:
        raise SearchError("online: the rig has no marker, so that there is no error")
    is_ours = job.method in get_args(Ours)
    found = searched(
        _policy(job.method),
        rig.scanner,
        stay=False,
        dark_frames=rig.dark_frames if is_ours else 0,
        counts=BRACKET_ACQUISITIONS if job.method in BRACKETS else (),
    )
    samples, finished = found.samples, found.finished
    each_s = settings.receiver.readout_s + settings.laser.pulses / settings.laser.rate_hz
    return OnlineSearch(
        method=job.method,
        peak_snr_db=job.peak_snr_db,
        repeat=job.repeat,
        position=job.position,
        truth_deg=rig.facts.truth_deg,
        track_deg=tuple(sample.angle_deg for sample in samples),
        estimates=found.answers or {len(samples): finished.estimate},
        travel_deg=finished.travel_deg,
        elapsed_s=finished.elapsed_s,
        # The confirmation at the end is one more acquisition.
        acquiring_s=each_s * found.frames,
    )


def _policy(method: OnlineMethod) -> Policy:
    start_deg = PAPER_RANGE.low_deg
    match method:
        case "TS" | "GSS":
            # With the largest N only: it contains the shorter searches.
            return policy_of(method, acquisitions=max(BRACKET_ACQUISITIONS))
        case "WA":
            return policy_of(method, acquisitions=ONLINE_STEPS, early_end=True)
        case "posterior, survey":
            return build(PolicyPlan(method="posterior", start_deg=start_deg))
    return policy_of("posterior", acquisitions=TABLE_ACQUISITIONS, start_deg=start_deg, early_end=method == "posterior")


def levels_of(searches: Sequence[OnlineSearch]) -> list[float]:
    """Peak SNR of the searches in dB, each once."""
    return list(dict.fromkeys(search.peak_snr_db for search in searches))


def table2(searches: Sequence[OnlineSearch]) -> Section:
    """Table 2: errors of WA with its early end, and of TS and GSS after 16 acquisitions."""
    comparisons: list[Comparison] = []
    rows: list[dict[str, Cell]] = []
    for level_db in levels_of(searches):
        for name in _ORDER:
            found = [search for search in searches if (search.method, search.peak_snr_db) == (name, level_db)]
            errors = summary_of(search.table_answer for search in found)
            counts = errors_of(float(search.table_acquisitions) for search in found)
            rows.append({"method": name, "peak_snr_db": level_db, "acquisitions": counts.mean_deg, **errors.cells})
            condition = f"{level_db:g} dB"
            is_ours = name in get_args(Ours)
            number = OwnNumber(quantity=f"{name} (ours) online, mean error") if is_ours else f"table2/{name}"
            comparisons.append(compared(number, errors, condition=condition))
            if name in ENDS_BY_ITSELF:
                comparisons.append(
                    Comparison(
                        paper=OwnNumber(
                            quantity=f"{name} (ours) online, acquisitions until it ended", unit="acquisitions"
                        )
                        if is_ours
                        else paper_number(f"table2/{name}/N"),
                        ours=counts.mean_deg,
                        sd=counts.sd_deg,
                        half=counts.half_deg,
                        condition=condition,
                    )
                )
    return Section(
        name="table2",
        title="Table 2: online analysis",
        method=(*METHOD, _FORMS),
        comparisons=tuple(comparisons),
        tables=(
            Table(name="table2", caption="Errors of the online searches", rows=tuple(rows)),
            Table(
                name="table2_searches",
                caption="Every online search",
                rows=tuple(
                    {
                        "method": each.method,
                        "peak_snr_db": each.peak_snr_db,
                        "repeat": each.repeat,
                        "position": each.position,
                        "truth_deg": each.truth_deg,
                        "acquisitions": each.table_acquisitions,
                        "answer_deg": each.estimates[each.table_acquisitions].mean_deg,
                        "error_deg": each.table_answer.error_deg,
                        "travel_of_whole_run_deg": each.travel_deg,
                        "elapsed_s": each.elapsed_s,
                        "acquiring_s": each.acquiring_s,
                        "claimed": "yes" if each.table_answer.claimed else "no",
                    }
                    for each in searches
                ),
                shown=False,
            ),
        ),
    )
