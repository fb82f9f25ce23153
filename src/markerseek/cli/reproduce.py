"""``markerseek reproduce``: the paper's figures and tables, next to the numbers of the paper."""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape
from rich.table import Table as Grid

from markerseek import studies
from markerseek.cli.options import AsJson
from markerseek.cli.report import Output, Report, file_line, make_picture_folder, table
from markerseek.cli.terminal import print_warning, stages_bar, stderr
from markerseek.core import ConfigError, counted, extra_install

if TYPE_CHECKING:
    from markerseek.studies.paper import Section


def command(
    what: Annotated[str, typer.Argument(help="Figure or table, or all; an unknown name lists them all.")],
    out: Annotated[Path, typer.Option(help="Folder for tables, pictures and report.html.")] = Path("paper"),
    markers: Annotated[
        int, typer.Option(help="Markers of the Monte Carlo studies; fewer also reduce repeats and frames.")
    ] = 1000,
    workers: Annotated[int | None, typer.Option(min=1, help="Processes; by default one for each core.")] = None,
    seed: Annotated[int, typer.Option(help="Seed: the same seed gives the same numbers.")] = 1,
    bank: Annotated[
        Path | None, typer.Option(help="Your own scan for fig6 and table1: a table of angles and intensities.")
    ] = None,
    reference_deg: Annotated[
        float | None, typer.Option(help="Angle of the marker in your bank, in degrees; else the bank's maximum.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Make the paper's figures and tables again, and one report with its numbers beside ours.

    Examples
    --------
    markerseek reproduce all --out paper
    markerseek reproduce fig5 --markers 200 --out paper
    markerseek reproduce fig6 --bank examples/simulated_scan.csv --reference-deg -8.25 --out mine
    """
    from markerseek.studies import paper

    if bank is None and reference_deg is not None:
        raise ConfigError(f"--reference-deg {reference_deg:g} belongs to a bank; give --bank too")
    own = None if bank is None else paper.own_bank(bank, reference_deg=reference_deg)
    with stages_bar() as progress:
        options = paper.RunOptions(
            seed=seed,
            markers=markers,
            workers=studies.default_workers() if workers is None else workers,
            progress=progress,
        )
        # Before hours of computation, not after them.
        make_picture_folder(out)
        names = _names() if what == "all" else [what]
        waiting = paper.make_sections(names, options=options, folder=out, own=own)
        made_from = f"with {counted(markers, 'marker')}" if bank is None else f"of {escape(str(bank))}"
        stderr.print(
            f"{', '.join(names)} {made_from} in {counted(options.workers, 'process', 'processes')}, into "
            f"{escape(str(out))}; the time that is left of each part is said as soon as it is known"
        )
        sections = []
        made = []
        began_s = time.perf_counter()
        for section in waiting:
            files = [str(path) for path in paper.write_section(section, out)]
            sections.append(section)
            made.append({**_made(section), "files": files, "seconds": time.perf_counter() - began_s})
            began_s = time.perf_counter()
        page = paper.write_report(sections, out, options=options, own_bank=bank)
    report = Report(
        values={"report": str(page), "seed": seed, "markers": markers, "workers": options.workers, "sections": made},
        shown=[*(part for section in sections for part in _shown(section)), file_line("report", page)],
    )
    Output(as_json=as_json).show(report)


def _names() -> list[str]:
    """Return all sections; Fig. 9 only where OpenCV is installed, so that the others need no further package."""
    from markerseek.studies.paper import SECTIONS

    if importlib.util.find_spec("cv2") is not None:
        return list(SECTIONS)
    print_warning(f"fig9 is left out: it needs OpenCV; {extra_install('vision')}")
    return [name for name in SECTIONS if name != "fig9"]


def _made(section: Section) -> dict[str, object]:
    """Return one section, for programs."""
    from markerseek.studies.paper import comparison_table

    compared = comparison_table(section)
    return {
        "name": section.name,
        "title": section.title,
        "numbers": [
            {**dict(zip(compared.columns, row, strict=True)), "limitation": each.paper.limitation}
            for row, each in zip(compared.rows, section.comparisons, strict=True)
        ],
        "remarks": section.remarks,
    }


def _shown(section: Section) -> Iterator[str | Grid]:
    from markerseek.studies.paper import cell_text

    yield f"[bold]{escape(section.title)}[/]"
    if section.comparisons:
        # A user's own bank has no condition, and the paper no numbers of it.
        of_paper = any(each.paper.value is not None for each in section.comparisons)
        yield table(
            (
                {
                    "": each.paper.quantity,
                    **({"condition": each.condition, "paper": str(each.paper)} if of_paper else {}),
                    "ours": cell_text(each.ours) + ("" if each.half is None else f" ± {cell_text(each.half)}"),
                    **({"difference": cell_text(each.difference)} if of_paper else {}),
                }
                for each in section.comparisons
            ),
            left=("", "condition"),
        )
    yield from (f"  {escape(remark)}" for remark in section.remarks)
    yield ""
