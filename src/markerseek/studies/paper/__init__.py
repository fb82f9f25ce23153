"""The paper, reproduced: Fig. 5 to 9, Tables 1 and 2.

The paper's numbers are in `printed.csv`, with the reason where one cannot be reproduced; no setting was chosen to match
them except the condition `markerseek.studies.paper.fig5.FITTED`, which is marked as such.
"""

from markerseek.studies.paper.methods import RunOptions
from markerseek.studies.paper.offline import own_bank
from markerseek.studies.paper.report import (
    SECTIONS,
    cell_text,
    comparison_table,
    make_sections,
    write_report,
    write_section,
)
from markerseek.studies.paper.section import Section

__all__ = [
    "SECTIONS",
    "RunOptions",
    "Section",
    "cell_text",
    "comparison_table",
    "make_sections",
    "own_bank",
    "write_report",
    "write_section",
]
