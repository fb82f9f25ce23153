"""The report of a search: its table, JSON, picture and HTML page."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import msgspec
from rich.markup import escape

from markerseek.cli.report import Output, Report, drawn, facts
from markerseek.core import AnyPolicy, Estimate
from markerseek.records import NAME_WITHOUT_CLAIM, SearchResult
from markerseek.runs import RunView, curve_of, verdict_of
from markerseek.search import WholeRecording
from markerseek.signals import ImageReader

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from markerseek.pictures import Curve

FOUND, OTHER_ANSWER = 0, 3
"""Exit codes of a search that ended well."""


def conclude(
    view: RunView,
    output: Output,
    *,
    name: str,
    imaging: ImageReader | None,
    policy: AnyPolicy | None,
    recorded: Curve | None = None,
) -> NoReturn:
    """Show the result of a search, and end the command with its exit code.

    ``name``: name of the picture's files. ``imaging``: imaging chain of the rig's channel data; None if there are
    intensities only. ``recorded``: recorded curve of the picture, as in `markerseek.pictures.search_figure`; None if
    there is none, or the answer is from all of it.
    """
    result, rig = view.result(), view.facts
    form = " as published" if result.as_published else ""
    title = f"{result.method}{form} on a {rig.rig_name}: {rig.description}"
    if result.search is not None:
        title = f"recording: {rig.description}"
    pictures: dict[str, Callable[[Path], object]] = {}
    # Where nothing was measured there is nothing to draw.
    if output.folder is not None and view.finished is not None and view.samples:
        if result.search is not None:
            recorded = ([each.angle_deg for each in result.samples], [each.intensity for each in result.samples])
        density = _density(policy)
        curves = {"limits": rig.search, "density": density, "recorded": recorded}
        draw = _figure(view, view.finished.estimate, result, imaging, **curves)
        pictures = {f"{name}.png": drawn(draw), f"{name}.html": partial(_write_page, view, density, title, draw)}
    report = Report(
        values=result,
        shown=[f"[bold]{escape(title)}[/]", facts(result.rows)],
        pictures=pictures,
        exit_code=FOUND if result.found else OTHER_ANSWER,
    )
    output.show(report)


def _density(policy: AnyPolicy | None) -> Curve | None:
    """Density of the angle at the end of a search; None for methods without a posterior."""
    from markerseek.search.posterior import Posterior, SweepPosterior

    policy = policy.present if isinstance(policy, WholeRecording) else policy
    belief = policy.belief if isinstance(policy, Posterior | SweepPosterior) else None
    if belief is None:
        return None
    step_deg = float(belief.angles_deg[1] - belief.angles_deg[0])
    return belief.angles_deg, belief.probability / step_deg


def _figure(
    view: RunView, estimate: Estimate, result: SearchResult, imaging: ImageReader | None, **curves: Any
) -> Callable[..., Figure]:
    """A function that draws a search, with curves as of `search_figure`."""
    from markerseek.pictures import pictured_sample, search_figure

    pictured = pictured_sample(view.samples, view.confirmation)
    frame = pictured.frame
    return partial(
        search_figure,
        view.search_samples,
        estimate,
        start_deg=view.start_deg,
        truth_deg=result.truth_deg,
        reference_deg=result.reference_deg,
        stand_in=result.stand_in,
        confirmation=view.confirmation,
        pictured=pictured,
        image=None if imaging is None or frame is None else imaging.picture(frame),
        **curves,
    )


def _write_page(view: RunView, density: Curve | None, title: str, draw: Callable[..., Figure], path: Path) -> None:
    from markerseek.pictures import png_data_uri, write_page

    result, curve = view.result(), curve_of(view, reveal=True)
    if density is not None:
        curve = replace(curve, density=(list(density[0]), list(density[1])))

    write_page(
        path,
        "search.html.jinja",
        title=title,
        note=_note(result),
        verdict=verdict_of(view),
        curve=curve.svg(),
        facts=result.rows,
        picture_uri=png_data_uri(draw()),
        alt="Intensity over probe angle with the acquisitions in order, the probe's track, and the photoacoustic image",
        rows=_rows(result),
        json=msgspec.json.format(msgspec.json.encode(result), indent=2).decode("utf-8"),
    )


def _note(result: SearchResult) -> str | None:
    """Warning above a result that no hardware has given; None for one of hardware or of a recording."""
    if result.stand_in is None:
        return None
    return f"{result.stand_in.capitalize()}: this is no measurement on hardware."


def _rows(result: SearchResult) -> list[tuple[str, ...]]:
    """Table rows of the page: headings, acquisitions, confirmation; positions only if any are known."""
    taken = [(str(number), each) for number, each in enumerate(result.samples, start=1)]
    if result.confirmation is not None:
        taken.append((NAME_WITHOUT_CLAIM if result.as_published else "confirmation", result.confirmation))
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


def _optional_mm(value_m: float | None) -> str:
    return "–" if value_m is None else f"{1e3 * value_m:.2f}"
