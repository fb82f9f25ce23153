"""Figures of results and banks, returned and not written: for notebooks and papers."""

from __future__ import annotations

from typing import TYPE_CHECKING

from markerseek import runs
from markerseek.records.banks import FrameBank, IntensityBank
from markerseek.search import Curve, Peak, peak_of
from markerseek.show import SearchResult, curve_figure, drawn_curve, peak_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def search_figure(result: SearchResult) -> Figure:
    """Return the figure of a search: its intensities over the angle with the answer, and the way of the probe.

    Of a recording: the recorded curve with the answer from all angles, and what a search would have taken.

    Parameters
    ----------
    result
        What a search has found, as `find_marker` returns it.

    Raises
    ------
    MissingExtraError
        If Matplotlib is not installed.
    """
    return curve_figure(drawn_curve(result.run, reveal=True))


def bank_figure(
    bank: IntensityBank | FrameBank,
    *,
    title: str = "",
    probe: str | None = None,
    curve: Curve | None = None,
    peak: Peak | None = None,
) -> Figure:
    """Return the figure of a bank: intensity over angle with the statistics of its peak, and the image at the maximum.

    Parameters
    ----------
    bank
        A bank, as `markerseek.records.banks.read_bank` returns it.
    title
        Heading of the figure.
    probe
        Preset of the imaging chain of frames, or the name of a TOML file that describes a probe; None: the one that the
        bank names, else the first of all.
    curve
        Its intensities, where they have been computed already.
    peak
        Statistics of its peak, where they are those above a background; None: of all that the curve holds.

    Raises
    ------
    MissingExtraError
        If Matplotlib is not installed.
    RecordError
        If a frame cannot be read or imaged.
    """
    curve = runs.bank_curve(bank, probe=probe) if curve is None else curve
    peak = peak_of(curve) if peak is None else peak
    return peak_figure(
        bank.angles_deg,
        curve.intensity.tolist(),
        title=title,
        max_deg=peak.max_deg,
        com_deg=peak.com_deg,
        cen_deg=peak.cen_deg,
        fwhm_deg=peak.fwhm_deg,
        reference_deg=bank.facts.reference_angle_deg,
        dark_level=runs.dark_intensity(bank, probe=probe),
        image=runs.bank_image(bank, curve.strongest, probe=probe) if isinstance(bank, FrameBank) else None,
    )
