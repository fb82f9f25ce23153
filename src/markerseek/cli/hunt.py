"""Runs a policy on a rig for `search`, `replay` and `resume`, and shows the result as a table, a picture and a page."""

from __future__ import annotations

from collections.abc import Generator, Iterable
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import NoReturn

import msgspec
import typer
from rich.markup import escape

from markerseek.cli.keeping import tell_where
from markerseek.cli.result_table import facts, method_in_words, print_result
from markerseek.cli.stopping import StoppedBySignal, end_stopped, stopped_by_signals
from markerseek.cli.terminal import aside, people, print_json, print_warning, progress_bar, quoted
from markerseek.core import Event, Failed, MarkerseekError, Measured, PaImage, RecordError, Refused, Sample
from markerseek.records.journal import Checked, Configuration, Journal
from markerseek.records.result import Recorder, SearchResult
from markerseek.signals import ImageReader

FOUND, OTHER_ANSWER = 0, 3
"""Exit codes of a search that ended well."""


def hunt(
    events: Generator[Event, None, None],
    begun_with: Configuration,
    *,
    most: int,
    journal: Journal | None,
    as_json: bool,
    rig_file: Path | None = None,
) -> tuple[Recorder, SearchResult]:
    """Live through a search with a progress bar; Ctrl-C, SIGTERM and SIGHUP stop the rig and end it.

    Parameters
    ----------
    events
        The search.
    begun_with
        What it is begun with.
    most
        Most acquisitions, for the bar.
    journal
        Where the events are kept, which also hears of an interruption; None without one.
    as_json
        Whether a program is to hear of an interruption.
    rig_file
        Rig file of the search; of a rig of devices, the command that resumes it names this file.
    """
    rig_file = rig_file if begun_with.rig == "bench" else None
    recorder = Recorder()
    with stopped_by_signals():
        try:
            # Closed whatever happens here, so that an interrupt also stops the stage and disarms the laser.
            with closing(events):
                _watch(events, recorder, most)
        except StoppedBySignal as stop:
            _note_interruption(stop, journal, rig_file)
            end_stopped(stop, as_json=as_json, kept=None if journal is None else journal.path)
        except MarkerseekError:
            if journal is not None:
                _tell_how_to_go_on(journal, rig_file)
            raise
    return recorder, recorder.result(begun_with)


def _watch(events: Iterable[Event], recorder: Recorder, most: int) -> None:
    with progress_bar(most, what="searching") as progress:
        task = progress.task_ids[0]
        for event in events:
            recorder.hear(event)
            if isinstance(event, Measured) and event.role == "search":
                sample = event.sample
                said = f"{sample.angle_deg:+7.2f}°  intensity {sample.reading.intensity:.4g}"
                progress.update(task, completed=event.index, description=said)
            elif isinstance(event, Refused):
                progress.console.print(f"[yellow]refused:[/] {escape(event.reason)}")


def resume_command(journal: Path, rig_file: Path | None) -> str:
    """The command that resumes a journal, as a shell takes it.

    Parameters
    ----------
    journal
        The journal.
    rig_file
        Rig file of a rig of devices; None for any other rig.
    """
    rig = "" if rig_file is None else f" --rig {quoted(rig_file)}"
    return f"markerseek resume {quoted(journal)}{rig}"


def _tell_how_to_go_on(journal: Journal, rig_file: Path | None) -> None:
    """Say by which command a run that ended with an error goes on; nothing where only a new search helps."""
    if not journal.path.exists():
        return
    said = f"[dim]journal:[/] {escape(str(journal.path))}"
    command = escape(resume_command(journal.path, rig_file))
    if isinstance(journal.last, Failed):
        said += f"; once the rig is well: {command} --reset-fault"
    elif not isinstance(journal.last, Checked):
        said += f"; go on with: {command}"
    aside.print(said)


def _note_interruption(stop: StoppedBySignal, journal: Journal | None, rig_file: Path | None) -> None:
    """Say in the journal what stopped the run, once the rig has been stopped."""
    if journal is None:
        return
    try:
        journal.interrupt(stop.name)
    except RecordError as problem:
        print_warning(str(problem))
    print_warning(f"go on with: {resume_command(journal.path, rig_file)}")


def conclude(
    recorder: Recorder,
    result: SearchResult,
    *,
    description: str,
    imaging: ImageReader | None,
    journal: Journal | None,
    as_json: bool,
    plot: bool,
    out: Path,
    name: str,
) -> NoReturn:
    """Print the result, draw it, say where pictures and journal lie, and end the command with the result's exit code.

    Parameters
    ----------
    recorder, result
        What `hunt` gave.
    description
        The rig in words.
    imaging
        Imaging chain of its channel data; None where there are intensities only.
    journal
        The journal that people are told of; None where there is none, or they named it.
    as_json
        One object for programs instead of a table for people.
    plot
        Whether to write a picture and a page.
    out, name
        Folder and stem of their files.
    """
    # The answer first: a picture that cannot be drawn must not take it away.
    if as_json:
        print_json(result)
    else:
        print_result(result, description)
    if plot:
        for path in _draw(recorder, result, description, imaging, out / f"{name}.png", out / f"{name}.html"):
            (aside if as_json else people).print(f"[dim]picture:[/] {escape(str(path))}")
    if not as_json:
        tell_where(journal)
    raise typer.Exit(FOUND if result.found else OTHER_ANSWER)


def _draw(
    recorder: Recorder, result: SearchResult, description: str, imaging: ImageReader | None, png: Path, page: Path
) -> tuple[Path, ...]:
    from markerseek.pictures import png_data_uri, save_png, search_figure, write_page

    finished = recorder.finished
    if finished is None or not recorder.samples:
        return ()
    title = f"{method_in_words(result)} on a {result.rig} rig: {description}"
    draw = partial(
        search_figure,
        recorder.samples,
        finished.estimate,
        start_deg=recorder.start_deg,
        truth_deg=result.truth_deg,
        reference_deg=result.reference_deg,
        confirmation=recorder.confirmation,
        image=_image(imaging, recorder.confirmation or recorder.samples[-1]),
    )
    save_png(draw(title=title), png)
    write_page(
        page,
        title=title,
        note="Simulated rig: no hardware was involved." if result.rig == "simulated" else None,
        facts=facts(result),
        picture_uri=png_data_uri(draw(title=None)),
        alt="Intensity over probe angle with the acquisitions in order, the probe's track, and the photoacoustic image",
        rows=_rows(result),
        json=msgspec.json.format(msgspec.json.encode(result), indent=2).decode("utf-8"),
    )
    return png, page


def _rows(result: SearchResult) -> list[tuple[str, ...]]:
    """Headings, the acquisitions in order, and the confirmation; where the source was only if any of them say so."""
    taken = [(str(number), each) for number, each in enumerate(result.samples, start=1)]
    if result.confirmation is not None:
        taken.append(("confirmation", result.confirmation))
    rows = [("", "angle [deg]", "intensity", "peak lateral [mm]", "peak depth [mm]")]
    rows += [
        (
            name,
            f"{each.angle_deg:.3f}",
            f"{each.intensity:.4g}",
            _optional_mm(each.lateral_m),
            _optional_mm(each.depth_m),
        )
        for name, each in taken
    ]
    placed = any(each.lateral_m is not None for _, each in taken)
    return [row if placed else row[:3] for row in rows]


def _image(imaging: ImageReader | None, sample: Sample) -> PaImage | None:
    """Image of the frame of a sample, where there is one."""
    if imaging is None or sample.frame is None:
        return None
    return imaging.picture(sample.frame)


def _optional_mm(value_m: float | None) -> str:
    return "–" if value_m is None else f"{1e3 * value_m:.2f}"
