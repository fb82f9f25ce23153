"""The report of a search: its table, JSON, picture and HTML page."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import msgspec
from rich.markup import escape

from markerseek.cli.report import Output, Report, drawn, facts
from markerseek.core import AnyPolicy, ChannelFrame, Estimate, Floor, OtherSource, RFFrame, counted
from markerseek.records import Recorder, SearchResult
from markerseek.records.journal import Configuration
from markerseek.search import FALSE_FOUND, WholeRecording
from markerseek.signals import AnyImageReader

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from markerseek.pictures import Curve

FOUND, OTHER_ANSWER = 0, 3
"""Exit codes of a search that ended well."""


def facts_of(result: SearchResult) -> list[tuple[str, str]]:
    """Names and formatted values of a result, for the table and the page."""
    rows = _answer(result) + _others(result)
    if result.marker_trus_m is not None:
        rows.append(("in the TRUS frame", "x {:.2f}, y {:.2f}, z {:.2f} mm".format(*_mm(result.marker_trus_m))))
    if result.marker_sigma_m is not None:
        sigmas = "± {:.2f} mm in angle, ± {:.2f} mm along the axis, ± {:.2f} mm in depth"
        rows.append(("its standard deviations", sigmas.format(*_mm(result.marker_sigma_m))))
    rows += _effort(result)
    if result.confirmation is not None:
        there = f"intensity {result.confirmation.intensity:.4g} at {result.confirmation.angle_deg:.3f}°"
        if result.as_published:
            rows.append((NAME_WITHOUT_CLAIM, there))
        else:
            rows.append(("confirmation", f"{there}, {'confirmed' if result.confirmed else 'NOT confirmed'}"))
    if result.floor is not None:
        rows.append(("noise floor", _floor(result.floor, acquisitions=result.acquisitions)))
    if result.truth_deg is not None and result.error_deg is not None:
        rows.append(("truth (simulated)", f"{result.truth_deg:.3f}°, error {result.error_deg:.3f}°"))
    elif result.reference_deg is not None and result.error_deg is not None:
        rows.append(("reference", f"{result.reference_deg:.3f}°, difference {result.error_deg:.3f}°"))
    if result.comparison is not None:
        rows.append(("a search would have said", result.comparison))
    return rows


def _effort(result: SearchResult) -> list[tuple[str, str]]:
    """What the answer took; of a recording, what it is from."""
    if result.search is not None:
        return [("answered from", f"all {counted(result.acquisitions, 'angle')} of the recording")]
    rows = [("acquisitions", str(result.acquisitions) + (f", {result.refused} refused" if result.refused else ""))]
    if result.travel_deg is not None:
        rows.append(("rotation", f"{result.travel_deg:.1f}°"))
    if result.elapsed_s is not None:
        clock = ", on the simulated clock" if result.rig == "simulated" else ""
        rows.append(("time", f"{result.elapsed_s:.0f} s{clock}"))
    return rows


def _others(result: SearchResult) -> list[tuple[str, str]]:
    """What else there is, or may be."""
    rows = [("other source", _other(other)) for other in result.others]
    if result.surveyed is not None:
        rows.append(("range checked", f"{100 * result.surveyed:.1f} %, for a second source as strong"))
    # 0 is what the user stated.
    if result.other_probability:
        stated = "; --single states that there is none" if result.doubt == "source" else ""
        rows.append(
            ("another source", f"is the marker with a probability of {_percent(result.other_probability)}{stated}")
        )
    return rows


def _percent(share: float) -> str:
    return "< 0.1 %" if share < 1e-3 else f"{100 * share:.2g} %"


def _other(source: OtherSource) -> str:
    """Another source in words."""
    place = ""
    if source.lateral_m is not None and source.depth_m is not None:
        place = f", lateral {1e3 * source.lateral_m:.1f} mm, depth {1e3 * source.depth_m:.1f} mm"
    # Adding zero makes 0 of a rounded -0.
    return f"{round(source.relative_db, 1) + 0.0:+.1f} dB at {source.angle_deg:.2f}° ± {source.sigma_deg:.2f}°{place}"


def _answer(result: SearchResult) -> list[tuple[str, str]]:
    """The answer and its angle, in words that claim no more than the method does."""
    if result.as_published:
        return [
            ("angle", f"{result.angle_deg:.3f}°"),
            ("claim", "none: the paper's form of a method always answers, also where there is no marker"),
        ]
    rows = [("answer", result.answer if result.reason is None else f"{result.answer}: {result.reason}")]
    if result.answer == "not found":
        # Where nothing was detected, the angle of a method is that of the noise, and is for programs only.
        return rows
    sigma = "" if result.sigma_deg is None else f" ± {result.sigma_deg:.3f}°"
    name, unclaimed = ("marker angle", "") if result.found else ("best guess", ", not claimed")
    rows.append((name, f"{result.angle_deg:.3f}°{sigma}{unclaimed}"))
    if result.interval95_deg is not None:
        low, high = result.interval95_deg
        name, kind = _KINDS[result.interval_kind or "propagated"]
        # Not with "±", which is a standard deviation on every line.
        at_marker = "" if result.half_width_m is None else f", within {1e3 * result.half_width_m:.2g} mm at the marker"
        rows.append((name, f"[{low:.3f}°, {high:.3f}°]{at_marker}, {kind}"))
    return rows


def _floor(floor: Floor, *, acquisitions: int) -> str:
    """The noise floor, and why another method has another."""
    if floor.level is None:
        return "unknown"
    return (
        f"{floor.level:.4g} from {floor.source}; noise alone exceeds it in at most one of {1 / FALSE_FOUND:g} searches "
        f"of {acquisitions} acquisitions"
    )


NAME_WITHOUT_CLAIM = "acquisition at that angle"
"""Name of the acquisition at the answer of a method that claims nothing; of others it is the confirmation."""

_KINDS = {
    "posterior": ("95 % interval", "a posterior probability"),
    "bracket": ("last bracket", "where the method stopped, not a probability"),
    "propagated": ("95 % interval", "noise propagated through the average, not a posterior"),
}


def _mm(point_m: tuple[float, float, float]) -> list[float]:
    return [1e3 * value for value in point_m]


def conclude(
    recorder: Recorder,
    configuration: Configuration,
    output: Output,
    *,
    name: str,
    imaging: AnyImageReader | None,
    policy: AnyPolicy | None,
    recorded: Curve | None = None,
) -> NoReturn:
    """Show the result of a search, and end the command with its exit code.

    ``configuration``: plan and rig of the search. ``name``: name of the picture's files. ``imaging``: imaging chain of
    the rig's channel data; None where there are intensities only. ``recorded``: recorded curve of the picture, as in
    `markerseek.pictures.search_figure`; None where there is none, or the answer is from all of it.
    """
    result, rig = recorder.result(configuration.plan, configuration.facts), configuration.facts
    form = " as published" if result.as_published else ""
    title = f"{result.method}{form} on a {rig.rig_name}: {rig.description}"
    if result.search is not None:
        title = f"recording: {rig.description}"
    pictures: dict[str, Callable[[Path], object]] = {}
    # Where nothing was measured there is nothing to draw.
    if output.folder is not None and recorder.finished is not None and recorder.samples:
        if result.search is not None:
            recorded = ([each.angle_deg for each in result.samples], [each.intensity for each in result.samples])
        curves = {"limits": rig.search, "density": _density(policy), "recorded": recorded}
        draw = _figure(recorder, recorder.finished.estimate, result, imaging, **curves)
        pictures = {f"{name}.png": drawn(draw), f"{name}.html": partial(_write_page, result, title, draw)}
    report = Report(
        values=result,
        shown=[f"[bold]{escape(title)}[/]", facts(facts_of(result))],
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
    recorder: Recorder, estimate: Estimate, result: SearchResult, imaging: AnyImageReader | None, **curves: Any
) -> Callable[..., Figure]:
    """A function that draws a search, with curves as of `search_figure`."""
    from markerseek.pictures import pictured_sample, search_figure

    pictured = pictured_sample(recorder.samples, recorder.confirmation)
    frame = pictured.frame
    return partial(
        search_figure,
        recorder.search_samples,
        estimate,
        start_deg=recorder.start_deg,
        truth_deg=result.truth_deg,
        reference_deg=result.reference_deg,
        stand_in=result.stand_in,
        confirmation=recorder.confirmation,
        pictured=pictured,
        image=None if imaging is None or frame is None else imaging.picture(frame),
        b_mode=frame.b_mode if isinstance(frame, ChannelFrame | RFFrame) else None,
        **curves,
    )


def _write_page(result: SearchResult, title: str, draw: Callable[..., Figure], path: Path) -> None:
    from markerseek.pictures import png_data_uri, write_page

    write_page(
        path,
        "search.html.jinja",
        title=title,
        note=_note(result),
        facts=facts_of(result),
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
