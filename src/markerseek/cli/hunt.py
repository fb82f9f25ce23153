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
from rich.table import Table

from markerseek.cli.keeping import tell_where
from markerseek.cli.stopping import StoppedBySignal, end_stopped, stopped_by_signals
from markerseek.cli.terminal import aside, people, print_json, print_warning, progress_bar, quoted
from markerseek.core import Event, Failed, MarkerseekError, Measured, PaImage, RecordError, Refused, Sample
from markerseek.records.journal import Checked, Configuration, Journal, result_with
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
    """
    recorder = Recorder()
    with stopped_by_signals():
        try:
            # Closed whatever happens here, so that an interrupt also stops the stage and disarms the laser.
            with closing(events):
                _watch(events, recorder, most)
        except StoppedBySignal as stop:
            _note_interruption(stop, journal)
            end_stopped(stop, as_json=as_json, kept=None if journal is None else journal.path)
        except MarkerseekError:
            if journal is not None:
                _tell_how_to_go_on(journal)
            raise
    return recorder, result_with(recorder, begun_with)


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


def _tell_how_to_go_on(journal: Journal) -> None:
    """Say by which command a run that ended with an error goes on; nothing where only a new search helps."""
    said = f"[dim]journal:[/] {escape(str(journal.path))}"
    command = escape(f"markerseek resume {quoted(journal.path)}")
    if isinstance(journal.last, Failed):
        said += f"; once the rig is well: {command} --reset-fault"
    elif not isinstance(journal.last, Checked):
        said += f"; go on with: {command}"
    aside.print(said)


def _note_interruption(stop: StoppedBySignal, journal: Journal | None) -> None:
    """Say in the journal what stopped the run, once the rig has been stopped."""
    if journal is None:
        return
    try:
        journal.interrupt(stop.name)
    except RecordError as problem:
        print_warning(str(problem))
    print_warning(f"go on with: markerseek resume {quoted(journal.path)}")


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
        _print_table(result, description)
    if plot:
        for path in _draw(recorder, result, description, imaging, out / f"{name}.png", out / f"{name}.html"):
            (aside if as_json else people).print(f"[dim]picture:[/] {escape(str(path))}")
    if not as_json:
        tell_where(journal)
    raise typer.Exit(FOUND if result.found else OTHER_ANSWER)


def facts(result: SearchResult) -> list[tuple[str, str]]:
    """Names and values of a result, as people read them."""
    rows = [("answer", result.answer if result.reason is None else f"{result.answer}: {result.reason}")]
    if result.found and result.sigma_deg is not None and result.interval95_deg is not None:
        low, high = result.interval95_deg
        rows.append(("marker angle", f"{result.angle_deg:.3f}° ± {result.sigma_deg:.3f}°"))
        rows.append(("95 % interval", f"[{low:.3f}°, {high:.3f}°], {_KINDS[result.interval_kind or 'propagated']}"))
    else:
        rows.append(("the rule points at", f"{result.angle_deg:.3f}°, which is not claimed"))
    if result.marker_trus_m is not None:
        rows.append(("marker in the TRUS frame", "x {:.1f}, y {:.1f}, z {:.1f} mm".format(*_mm(result.marker_trus_m))))
    rows.append(("acquisitions", str(result.acquisitions) + (f", {result.refused} refused" if result.refused else "")))
    rows.append(("rotation", f"{result.travel_deg:.1f}°"))
    if result.elapsed_s is not None:
        rows.append(("time", f"{result.elapsed_s:.0f} s" + (" (virtual)" if result.rig == "simulated" else "")))
    if result.confirmation is not None:
        confirmation = result.confirmation
        verdict = "confirmed" if result.confirmed else "NOT confirmed: weaker than it should be"
        rows.append(
            ("confirmation", f"intensity {confirmation.intensity:.4g} at {confirmation.angle_deg:.3f}°, {verdict}")
        )
    if result.floor is not None:
        level = "unknown" if result.floor.level is None else f"{result.floor.level:.4g} from {result.floor.source}"
        rows.append(("noise floor", level))
    if result.truth_deg is not None and result.error_deg is not None:
        rows.append(("truth (simulated)", f"{result.truth_deg:.3f}°, error {result.error_deg:.3f}°"))
    elif result.reference_deg is not None and result.error_deg is not None:
        rows.append(("reference", f"{result.reference_deg:.3f}°, difference {result.error_deg:.3f}°"))
    return rows


_KINDS = {
    "posterior": "a posterior probability",
    "bracket": "the bracket's width, not a probability",
    "propagated": "noise propagated through the average, not a posterior",
}


def _method(result: SearchResult) -> str:
    return result.method + (" as published" if result.as_published else "")


def _mm(point_m: tuple[float, float, float]) -> list[float]:
    return [1e3 * value for value in point_m]


def _print_table(result: SearchResult, description: str) -> None:
    people.print(f"[bold]{_method(result)}[/] on a {result.rig} rig: {escape(description)}")
    table = Table(show_header=False, box=None, padding=(0, 2, 0, 0))
    for name, value in facts(result):
        table.add_row(f"[dim]{name}[/]", escape(value))
    people.print(table)


def _draw(
    recorder: Recorder, result: SearchResult, description: str, imaging: ImageReader | None, png: Path, page: Path
) -> tuple[Path, ...]:
    from markerseek.pictures import png_data_uri, save_png, search_figure, write_page

    finished = recorder.finished
    if finished is None or not recorder.samples:
        return ()
    title = f"{_method(result)} on a {result.rig} rig: {description}"
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
