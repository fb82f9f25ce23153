"""How the three methods look in every picture of the paper's studies."""

from __future__ import annotations

from collections.abc import Mapping

from markerseek.pictures import Line
from markerseek.studies.paper.methods import Name
from markerseek.studies.paper.section import Errors

COLOURS: dict[Name, str] = {"TS": "#c8501e", "GSS": "#1f5fa8", "WA": "#2a7f3f"}
"""Red, blue and green, as in Fig. 5 of the paper; apart for the colour-blind too."""

MARKS: dict[Name, str] = {"TS": "o", "GSS": "s", "WA": "^"}


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
        half=tuple(errors.half_deg or 0.0 for errors in cells.values()),
        colour=COLOURS[name],
        mark=MARKS[name],
    )
