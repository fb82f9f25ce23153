"""How the three methods look in every picture of the paper's studies."""

from __future__ import annotations

from collections.abc import Mapping

from markerseek.pictures import Line
from markerseek.studies.paper.methods import Name
from markerseek.studies.paper.section import Errors

COLOURS: dict[Name, str] = {"TS": "#c8501e", "GSS": "#1f5fa8", "WA": "#2a7f3f"}
"""Red, blue and green, as in Fig. 5 of the paper; apart for the colour-blind too."""

MARKS: dict[Name, str] = {"TS": "o", "GSS": "s", "WA": "^"}


def _drawn_half(errors: Errors) -> float:
    """Half the interval, on a logarithmic scale not down to 0; of fewer than five searches it says nothing."""
    if errors.half_deg is None or errors.count < 5:
        return 0.0
    return min(errors.half_deg, 0.95 * errors.mean_deg)


def error_line(name: Name, cells: Mapping[int, Errors]) -> Line:
    """Mean error of a method over the number of acquisitions, with the 95 % interval of the mean.

    Parameters
    ----------
    name
        The method.
    cells
        Errors by number of acquisitions.
    """
    return Line(
        label=f"{name}, ours",
        x=tuple(float(count) for count in cells),
        y=tuple(errors.mean_deg for errors in cells.values()),
        half=tuple(_drawn_half(errors) for errors in cells.values()),
        colour=COLOURS[name],
        mark=MARKS[name],
    )
