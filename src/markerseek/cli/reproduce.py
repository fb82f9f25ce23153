"""``markerseek reproduce``: the paper's figures and tables, next to the numbers of the paper."""

from __future__ import annotations

import importlib
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape
from rich.table import Table as Grid

from markerseek import signals, studies
from markerseek.cli.options import AsJson, require_frames
from markerseek.cli.report import Output, Report, file_line, require_room, table
from markerseek.cli.terminal import print_warning, stages_bar, stderr
from markerseek.core import ConfigError, counted, needs_package

if TYPE_CHECKING:
    from markerseek.studies.paper import Reproduction, Section

EXAMPLES = (
    "Examples:\n\n"
    "  markerseek reproduce all --out paper\n\n"
    "  markerseek reproduce fig5 --markers 200 --out paper\n\n"
    "  markerseek reproduce fig6 --bank examples/simulated_scan.csv --reference-deg -8.25 --out mine\n\n"
    "  markerseek reproduce table1 --bank /data/scan-2024-05-03 --probe BPL9-5/55 --out mine"
)


def command(
    what: Annotated[str, typer.Argument(help="Figure or table, or all; an unknown name lists them all.")],
    out: Annotated[Path, typer.Option(help="Folder for tables, pictures and report.html.")] = Path("paper"),
    markers: Annotated[
        int, typer.Option(help="Markers of the Monte Carlo studies; fewer also reduce repeats and frames.")
    ] = 1000,
    workers: Annotated[int | None, typer.Option(help="Processes; by default one for each core.")] = None,
    seed: Annotated[int, typer.Option(help="Seed: the same seed gives the same numbers.")] = 1,
    bank: Annotated[
        Path | None, typer.Option(help="Your own bank for fig6 and table1: HDF5, a folder of frames, or a CSV.")
    ] = None,
    probe: Annotated[str | None, typer.Option(help="Preset of the imaging chain, for a bank of channel data.")] = None,
    reference_deg: Annotated[
        float | None, typer.Option(help="Angle of the marker in your bank, in degrees; else the bank's maximum.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Make the paper's figures and tables again, and one report with its numbers beside ours."""
    from markerseek.records.banks import read_bank
    from markerseek.studies.paper import OfflineBank, Reproduction, RunOptions, write_report, write_section

    own = None
    if bank is not None:
        if probe is not None:
            signals.probe_preset(probe)
            require_frames(read_bank(bank), bank, probe=probe)
        own = OfflineBank(path=bank, material=bank.stem, reference_deg=reference_deg, probe=probe)
    elif reference_deg is not None:
        raise ConfigError(f"--reference-deg {reference_deg:g} belongs to a bank; give --bank too")
    elif probe is not None:
        raise ConfigError(f"--probe {probe} belongs to a bank of channel data; give --bank too")
    with stages_bar() as progress:
        options = RunOptions(
            seed=seed,
            markers=markers,
            workers=studies.default_workers() if workers is None else workers,
            progress=progress,
        )
        # Before hours of computation, not after them.
        require_room(out)
        reproduction = Reproduction(options=options, folder=out, own_bank=own)
        names = _names(reproduction) if what == "all" else [what]
        waiting = reproduction.sections(names)
        processes = counted(options.workers, "process", "processes")
        made_from = f"with {counted(markers, 'marker')}" if bank is None else f"of {escape(str(bank))}"
        stderr.print(
            f"{', '.join(names)} {made_from} in {processes}, into {escape(str(out))}; the time that "
            "is left of each part is said as soon as it is known"
        )
        sections, files = [], []
        durations_s: list[float] = []
        began_s = time.perf_counter()
        for section in waiting:
            sections.append(section)
            files.append(write_section(section, out))
            durations_s.append(time.perf_counter() - began_s - sum(durations_s))
        page = write_report(sections, out, options=options, durations_s=durations_s, own_bank=bank)
    made = [_made(*each) for each in zip(sections, files, durations_s, strict=True)]
    shown = [part for each in zip(sections, durations_s, strict=True) for part in _shown(*each)]
    report = Report(
        values={"report": str(page), "seed": seed, "markers": markers, "workers": options.workers, "sections": made},
        shown=[*shown, file_line("report", page)],
    )
    Output(as_json=as_json).show(report)


def _names(reproduction: Reproduction) -> list[str]:
    """All sections; Fig. 9 only where OpenCV is installed, so that the others need no further package."""
    names = list(reproduction.makers)
    try:
        with needs_package("opencv-python-headless", extra="vision", purpose="it", module="cv2"):
            importlib.import_module("cv2")
    except ConfigError as problem:
        print_warning(f"fig9 is left out: {problem}")
        names.remove("fig9")
    return names


def _made(section: Section, files: list[Path], duration_s: float) -> dict[str, object]:
    """One section, for programs."""
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
        "files": [str(path) for path in files],
        "seconds": duration_s,
    }


def _shown(section: Section, duration_s: float) -> Iterator[str | Grid]:
    from markerseek.studies.paper import shown

    yield f"[bold]{escape(section.title)}[/]"
    if section.comparisons:
        # A user's own bank has no condition, and the paper no numbers of it.
        of_paper = any(each.paper.value is not None for each in section.comparisons)
        yield table(
            (
                {
                    "": each.paper.quantity,
                    **({"condition": each.condition, "paper": str(each.paper)} if of_paper else {}),
                    "ours": shown(each.ours) + ("" if each.half is None else f" ± {shown(each.half)}"),
                    **({"difference": shown(each.difference)} if of_paper else {}),
                    "no claim": "" if each.unclaimed is None else f"{each.unclaimed:.0%}",
                }
                for each in section.comparisons
            ),
            left=("", "condition"),
        )
    for remark in section.remarks:
        yield f"  {escape(remark)}"
    yield f"[dim]took {duration_s:.1f} s[/]\n"
