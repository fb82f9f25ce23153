"""Fig. 5: the three searches on 1000 random markers (section 2.4), on simulated intensity curves.

Markers, noise and rigs are those of `markerseek.studies.trial`: every method searches for the same markers. A row of a
study is one search; here the longest search of TS or GSS also gives the answers of all shorter ones.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from markerseek.core import PAPER_RANGE
from markerseek.search import Curve, peak_of
from markerseek.sim import LaserSettings, MarkerSettings, NoiseSettings, ReceiverSettings, SimulatedSettings
from markerseek.studies.paper.methods import (
    AVERAGE_ACQUISITIONS,
    BRACKET_ACQUISITIONS,
    BRACKETS,
    PEAK_COUNTS,
    RUNS,
    PaperMethod,
    PaperSearch,
    RunOptions,
    paper_search,
    policy_of,
)
from markerseek.studies.paper.section import (
    Comparison,
    Errors,
    Group,
    Panel,
    Section,
    compared,
    errors_by_group,
    errors_figure,
    errors_table,
    make_section,
    paper_number,
    printed_value,
)
from markerseek.studies.policies import study_policy
from markerseek.studies.study import CurveSettings, Study, cells
from markerseek.studies.worlds import draw_trial, intensity_curve, study_rig

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, slots=True, kw_only=True)
class Condition:
    """Width of the intensity curve, as the radius of the absorber, and noise."""

    source_radius_m: float
    """Radius of the Gaussian absorber."""
    peak_snr_db: float

    @property
    def settings(self) -> SimulatedSettings:
        """Simulated rig of this condition: the probe begins at −35°, the marker lies at the middle of the array.

        The energy of the pulses does not vary, because the paper's simulation has white Gaussian noise only.
        """
        return SimulatedSettings(
            start_deg=PAPER_RANGE.low_deg,
            marker=MarkerSettings(lateral_m=0.0, source_radius_m=self.source_radius_m),
            noise=NoiseSettings(peak_snr_db=self.peak_snr_db),
            laser=LaserSettings(energy_jitter=0.0),
            receiver=ReceiverSettings(peak_counts=PEAK_COUNTS),
        )

    @property
    def radius_mm(self) -> str:
        """Radius of the absorber, for a table."""
        return f"{1e3 * self.source_radius_m:g}"

    @property
    def words(self) -> str:
        """Width and noise in words."""
        return f"FWHM {_fwhm_deg(self.source_radius_m):.1f}°, {self.peak_snr_db:g} dB"


@lru_cache(maxsize=32)
def _fwhm_deg(source_radius_m: float) -> float:
    """Return the full width at half maximum of the noise-free curve."""
    settings = Condition(source_radius_m=source_radius_m, peak_snr_db=40.0).settings
    curve, _ = intensity_curve(CurveSettings(), settings, seed=0)
    if curve is None:
        return float("nan")
    # Steps of 0.05°, a hundredth of the narrowest width.
    angles = np.linspace(PAPER_RANGE.low_deg, PAPER_RANGE.high_deg, 1401)
    heights = np.array([max(curve.peaks(float(angle))) for angle in angles])
    return peak_of(Curve(angle_deg=angles, intensity=heights)).fwhm_deg or float("nan")


_USUAL = Condition(source_radius_m=0.15e-3, peak_snr_db=40.0)
"""The defaults of the simulated rig (physics notes)."""

FITTED = Condition(source_radius_m=0.35e-3, peak_snr_db=80.0)
"""The combination of width and noise with the Fig. 5 nearest to the paper's: not chosen by hand, but the result of
`docs/validation/measure_consistency.py`."""


class Marker(NamedTuple):
    """A marker to be searched for, by its number in a condition, and the searches."""

    condition: Condition
    seed: int
    trial: int
    runs: tuple[tuple[PaperMethod, tuple[int, ...]], ...] = RUNS
    """Methods, with the numbers of acquisitions after which each is asked for its answer."""


def study_of(condition: Condition, *, seed: int) -> Study:
    """Return the study in which markers, curves and noise of one condition are drawn."""
    return Study(name="paper", policies=(study_policy(method="ternary"),), seed=seed, rig=condition.settings)


def searches_for(marker: Marker) -> list[PaperSearch]:
    """Search for one marker with every method."""
    study = study_of(marker.condition, seed=marker.seed)
    cell = cells(study)[0]
    draw = draw_trial(study, cell, marker.trial)
    searches = []
    for name, counts in marker.runs:
        rig = study_rig(study, cell, draw)
        searches.append(
            paper_search(
                policy_of(name, acquisitions=max(counts), limits=rig.limits.search),
                rig,
                truth_deg=draw.marker_deg,
                counts=counts,
                place=marker.condition.radius_mm,
                peak_snr_db=marker.condition.peak_snr_db,
                method=name,
            )
        )
    return searches


def fig5(options: RunOptions) -> Section:
    """Fig. 5: mean error over the number of acquisitions, for the rig's defaults and for the nearest condition."""
    markers = [
        Marker(condition, options.seed, trial) for condition in (FITTED, _USUAL) for trial in range(options.markers)
    ]
    found = options.each(searches_for, markers, stage="Fig. 5 from curves", part=20)
    errors = errors_by_group(search for searches in found for search in searches)
    return make_section(
        "fig5",
        comparisons=tuple(each for condition in (FITTED, _USUAL) for each in _comparisons(condition, errors)),
        tables=(errors_table("fig5", "Errors over the number of acquisitions", "source_radius_mm", errors),),
        draw=partial(_draw, errors),
        results={
            "markers": options.markers,
            "usual": _USUAL.words,
            "fitted": FITTED.words,
            "paper": str(paper_number("fig5/TS")),
            "exact": 70 * (2 / 3) ** 14 / 4,
        },
    )


def _comparisons(condition: Condition, errors: Mapping[Group, Errors]) -> Iterator[Comparison]:
    of = condition.radius_mm, condition.peak_snr_db
    # The paper prints one number for WA: the mean of its mean errors over N, and their scatter over N.
    sweeps = [errors[*of, "WA", count] for count in AVERAGE_ACQUISITIONS]
    means_deg = [sweep.error_deg.mean or 0.0 for sweep in sweeps]
    yield Comparison(
        paper=paper_number("fig5/WA"),
        ours=float(np.mean(means_deg)),
        sd=float(np.std(means_deg, ddof=1)),
        failed=float(np.mean([sweep.failed for sweep in sweeps])),
        condition=condition.words,
    )
    for name in BRACKETS:
        yield compared(f"fig5/{name}", errors[*of, name, max(BRACKET_ACQUISITIONS)], condition=condition.words)


def _draw(errors: Mapping[Group, Errors]) -> Figure:
    printed_deg: dict[tuple[PaperMethod, int], float] = {(name, 28): printed_value(f"fig5/{name}") for name in BRACKETS}
    return errors_figure(
        errors,
        [Panel(each.radius_mm, each.peak_snr_db, each.words, printed_deg) for each in (FITTED, _USUAL)],
        heading="Random markers, searched on simulated intensity curves",
        columns=2,
        panel_in=(5.2, 3.8),
        average_deg=printed_value("fig5/WA"),
    )
