"""Runs a search for `search`, `replay` and `resume`, and shows its result.

The run has a journal and a progress bar, and may end by a signal or an error; the result is a table, JSON, a picture
and an HTML page.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import msgspec
from rich.markup import escape

from markerseek.cli.notes import notes_said
from markerseek.cli.report import Output, Report, drawn, facts, file_line
from markerseek.cli.signals import StoppedBySignal, WatchOptions, end_stopped, stopped_by_signals
from markerseek.cli.terminal import print_warning, progress_bar, show_view, stderr
from markerseek.core import ConfigError, Failed, MarkerseekError, RecordError, Unsure
from markerseek.files import quoted
from markerseek.records.journal import Configuration, Journal, RunView, default_journal, make_folder
from markerseek.runs import ImageRing, Run, hand_images_on
from markerseek.show import (
    NAME_WITHOUT_CLAIM,
    WRONG_SOURCE,
    DrawnCurve,
    SearchResult,
    drawn_curve,
    flat_result,
    verdict_of,
)
from markerseek.signals import ImageReader

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from markerseek.search import Curve


_UNWATCHED = WatchOptions()
"""No program follows the run."""


def run_to_end(run: Run, *, as_json: bool, rig_file: Path | None = None, image_ring: Path | None = None) -> None:
    """Run a search to its end with a progress bar; Ctrl-C, SIGTERM and SIGHUP stop the rig and end the command.

    ``as_json``: whether to print an interruption as JSON. ``rig_file``: rig file of the search; for a rig of devices,
    the command that resumes it names this file. ``image_ring``: as of `WatchOptions`.
    """
    journal = run.journal if run.journal is not None and run.journal.kept else None
    # A journal describes a simulated rig in full: `resume` takes no rig file for it.
    rig_file = rig_file if run.configuration.facts.kind == "bench" else None
    with stopped_by_signals(), _handed_on(run, image_ring):
        try:
            _watch(run)
        except StoppedBySignal as stop:
            # Further signals are still ignored here, while the journal is written.
            try:
                run.interrupt(stop.by)
            except RecordError as problem:
                print_warning(str(problem))
            end_stopped(
                stop,
                as_json=as_json,
                kept=None if journal is None else journal.path,
                resume=None if journal is None else resume_command(journal.path, rig_file),
            )
        except MarkerseekError:
            _print_how_to_resume(journal, rig_file)
            raise


def run_anew(
    run: Run,
    *,
    as_json: bool,
    journal: Path | None = None,
    keep: bool = True,
    rig_file: Path | None = None,
    watch: WatchOptions = _UNWATCHED,
) -> Run:
    """Run a new search to its end with a new journal; returns the run with that journal.

    If a named journal cannot be written, that is an error before anything moves. If the user's data folder cannot be
    written, a search without hardware continues with a warning; one with hardware is refused, because exposure of
    tissue without a record must be asked for (--no-journal).

    ``journal``: the user's file; None for one in the data folder.
    """
    require_journal_options(journal, keep=keep, watch=watch)
    run = replace(run, journal=_new_journal(journal, run.configuration) if keep else None)
    if run.journal is not None and not as_json:
        # Before the first move: whatever happens to this process, the user knows where the record is.
        stderr.print(file_line("journal", run.journal.path))
    if watch.events is not None:
        run = replace(run, journal=Journal.create(watch.events, run.configuration, kept=False))
    with closed_at_end(run.journal):
        run_to_end(run, as_json=as_json, rig_file=rig_file, image_ring=watch.image_ring)
    return run


def require_journal_options(journal: Path | None, *, keep: bool, watch: WatchOptions = _UNWATCHED) -> None:
    """Refuse options of `run_anew` that contradict each other, before devices are opened."""
    if journal is not None and not keep:
        raise ConfigError(f"--journal names {journal} and --no-journal wants none; leave one of them out")
    if keep and watch.events is not None:
        raise ConfigError(
            f"--events {watch.events} is for a run without a journal; follow its journal, or add --no-journal"
        )


@contextmanager
def _handed_on(run: Run, image_ring: Path | None) -> Iterator[None]:
    """Hand the images of a search on in that file; the program that reads them follows the journal."""
    if image_ring is None or run.journal is None or run.rig.imaging is None:
        yield
        return
    with ImageRing.open(image_ring) as images:
        hand_images_on(images, run.journal, run.rig.imaging)
        yield


def _watch(run: Run) -> None:
    # Closed whatever happens here, so that an interrupt also stops the stage and disarms the laser.
    with closing(run.events()) as events, progress_bar(run.most_acquisitions, what="searching") as progress:
        for _ in events:
            show_view(progress, run.view)


def resume_command(journal: Path, rig_file: Path | None) -> str:
    """Return the shell command that resumes a journal; only a rig of devices needs its rig file."""
    rig = "" if rig_file is None else f" --rig {quoted(rig_file)}"
    return f"markerseek resume {quoted(journal)}{rig}"


def _print_how_to_resume(journal: Journal | None, rig_file: Path | None) -> None:
    """Print the command that resumes a run that ended with an error; none if only a new search helps."""
    if journal is None or not journal.path.exists():
        return
    line = file_line("journal", journal.path)
    command = escape(resume_command(journal.path, rig_file))
    if isinstance(journal.last, Failed):
        line += f"; once the fault is repaired: {command} --reset-fault"
    else:
        line += f"; continue with: {command}"
    stderr.print(line)


def _new_journal(named: Path | None, configuration: Configuration) -> Journal | None:
    """Return the journal of a search that is about to begin.

    None if the data folder takes none and no hardware is involved.
    """
    if named is not None:
        return Journal.create(named, configuration)
    try:
        path = default_journal(method=configuration.plan.method)
        try:
            make_folder(path.parent)
            return Journal.create(path, configuration)
        except OSError as problem:
            raise RecordError(f"{path}: {problem.strerror}") from problem
    except RecordError as problem:
        if configuration.facts.kind == "bench":
            raise RecordError(
                f"no journal can be written: {problem}; name one with --journal FILE, or search without one by "
                "--no-journal"
            ) from problem
        print_warning(f"no journal is kept: {problem}; or name a file with --journal FILE")
        return None


@contextmanager
def closed_at_end(journal: Journal | None) -> Iterator[None]:
    """Close a journal at the end; a failure to close it is a warning only, so that the answer is still shown."""
    try:
        yield
    finally:
        try:
            if journal is not None:
                journal.close()
        except RecordError as problem:
            print_warning(str(problem))


FOUND = 0
OTHER_ANSWER = 3
"""Exit codes of a search that ended well."""


def conclude(
    view: RunView,
    output: Output,
    *,
    name: str,
    imaging: ImageReader | None,
    recorded: Curve | None = None,
) -> NoReturn:
    """Show the result of a search, and end the command with its exit code.

    ``name``: name of the picture's files. ``imaging``: imaging chain of the rig's channel data; None if there are
    intensities only. ``recorded``: recording from which a method of the paper was given intensities; None for any
    other search.
    """
    result = SearchResult.of(view, notes=notes_said())
    rig = view.facts
    form = " as published" if view.plan.as_published else ""
    title = f"{result.method}{form} on a {rig.rig_name}: {rig.description}"
    if result.search is not None:
        title = f"recording: {rig.description}"
    pictures: dict[str, Callable[[Path], object]] = {}
    # Where nothing was measured there is nothing to draw.
    if output.folder is not None and view.finished is not None and view.samples:
        curve = drawn_curve(view, reveal=True)
        if recorded is not None:
            angles_deg = recorded.angle_deg.tolist()
            intensities = recorded.intensity.tolist()
            curve = msgspec.structs.replace(curve, recorded_deg=tuple(angles_deg), recorded=tuple(intensities))
        draw = _figure(view, curve, imaging)
        pictures = {f"{name}.png": drawn(draw), f"{name}.html": partial(_write_page, view, curve, title, draw)}
    report = Report(
        values=flat_result(result),
        shown=[f"[bold]{escape(title)}[/]", facts(_rows_with_cure(result))],
        pictures=pictures,
        exit_code=FOUND if result.found else OTHER_ANSWER,
    )
    output.show(report)


def _rows_with_cure(result: SearchResult) -> Iterator[tuple[str, str]]:
    """Yield the rows of a result; where another source may be the marker, the user may know that there is none."""
    estimate = result.estimate
    is_curable = isinstance(estimate, Unsure) and estimate.doubt == "source" and estimate.surveyed is not None
    for name, value in result.rows:
        yield name, f"{value}; --single states that there is none" if name == WRONG_SOURCE and is_curable else value


def _figure(view: RunView, curve: DrawnCurve, imaging: ImageReader | None) -> Callable[..., Figure]:
    """Return a function that draws a search."""
    from markerseek.show import curve_figure, pictured_sample

    pictured = pictured_sample(view)
    frame = pictured.frame
    image = None if imaging is None or frame is None else imaging.picture(frame)
    return partial(curve_figure, curve, pictured=pictured, image=image)


def _write_page(view: RunView, curve: DrawnCurve, title: str, draw: Callable[..., Figure], path: Path) -> None:
    from markerseek.show import curve_svg, png_data_uri, write_page

    result = SearchResult.of(view)
    # None for a result of hardware or of a recording.
    stand_in = curve.stand_in
    write_page(
        path,
        "search.html.jinja",
        title=title,
        note=f"{stand_in.capitalize()}: this is no measurement on hardware." if stand_in else None,
        verdict=verdict_of(view),
        curve=curve_svg(curve),
        facts=result.rows,
        picture_uri=png_data_uri(draw()),
        alt="Intensity over probe angle with the acquisitions in order, the probe's track, and the photoacoustic image",
        rows=_rows(result),
        json=msgspec.json.format(msgspec.json.encode(flat_result(result)), indent=2).decode("utf-8"),
    )


def _rows(result: SearchResult) -> list[tuple[str, ...]]:
    """Return the table rows of the page: headings, acquisitions, confirmation; positions only if any are known."""
    taken = [(str(number), each) for number, each in enumerate(result.samples, start=1)]
    if result.confirmation is not None:
        taken.append((NAME_WITHOUT_CLAIM if result.run.plan.as_published else "confirmation", result.confirmation))
    rows = [("", "angle [deg]", "intensity", "peak lateral [mm]", "peak depth [mm]")]
    rows += [
        (
            name,
            f"{each.angle_deg:.3f}",
            f"{each.reading.intensity:.4g}",
            _optional_mm(each.reading.lateral_m),
            _optional_mm(each.reading.depth_m),
        )
        for name, each in taken
    ]
    placed = any(each.reading.lateral_m is not None for _, each in taken)
    return [row if placed else row[:3] for row in rows]


def _optional_mm(value_m: float | None) -> str:
    return "–" if value_m is None else f"{1e3 * value_m:.2f}"
