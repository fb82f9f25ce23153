"""The paper, reproduced: each figure and table is one function in a file of its own.

The paper's numbers are data in `printed`; what cannot be had is said there, and never tuned into place.
"""

from markerseek.studies.paper.effort import PAPER_MARKERS, Effort
from markerseek.studies.paper.recordings import Recording
from markerseek.studies.paper.report import REPORT, write_report, write_section
from markerseek.studies.paper.reported import REPORTED, Reported, reported
from markerseek.studies.paper.reproduce import OFFLINE, Reproduction
from markerseek.studies.paper.section import Beside, Errors, Section, Table
from markerseek.studies.paper.stopwatch import Stopwatch, Took

__all__ = [
    "OFFLINE",
    "PAPER_MARKERS",
    "REPORT",
    "REPORTED",
    "Beside",
    "Effort",
    "Errors",
    "Recording",
    "Reported",
    "Reproduction",
    "Section",
    "Stopwatch",
    "Table",
    "Took",
    "reported",
    "write_report",
    "write_section",
]
