"""The paper, reproduced: Fig. 5 to 9, Tables 1 and 2, and the rotation travel.

The paper's numbers are in `printed.csv`, with the reason where one cannot be reproduced; no setting was chosen to match
them except the condition `markerseek.studies.paper.fig5.FITTED`, which is marked as such.
"""

from markerseek.studies.paper.banks import OfflineBank
from markerseek.studies.paper.options import PAPER_MARKERS, RunOptions
from markerseek.studies.paper.printed import PAPER_NUMBERS, PaperNumber, paper_number
from markerseek.studies.paper.report import (
    OFFLINE,
    REPORT,
    Reproduction,
    comparison_table,
    shown,
    write_report,
    write_section,
)
from markerseek.studies.paper.section import Cell, Comparison, Errors, Section, Table

__all__ = [
    "OFFLINE",
    "PAPER_MARKERS",
    "PAPER_NUMBERS",
    "REPORT",
    "Cell",
    "Comparison",
    "Errors",
    "OfflineBank",
    "PaperNumber",
    "Reproduction",
    "RunOptions",
    "Section",
    "Table",
    "comparison_table",
    "paper_number",
    "shown",
    "write_report",
    "write_section",
]
