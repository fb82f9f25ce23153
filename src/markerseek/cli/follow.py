"""``markerseek follow``: the probe follows what the surgeon looks at."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, closing
from datetime import UTC, datetime
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated

import msgspec
import typer
from rich.markup import escape

from markerseek import bridges, following
from markerseek.bridges import igtl
from markerseek.cli.follow_run import Followed, FollowPlace, FollowRun, note, run_on_rig, simulated_run
from markerseek.cli.open_rig import person
from markerseek.cli.options import AsJson, Out, with_values
from markerseek.cli.report import Output, Report, drawn, facts, with_version
from markerseek.cli.signals import StoppedBySignal, end_stopped, stopped_by_signals
from markerseek.cli.terminal import stderr
from markerseek.core import ConfigError, SceneOptions

if TYPE_CHECKING:
    from matplotlib.figure import Figure

HELD = 3
"""Exit code where a person must come: the probe stays."""


@with_values
def command(
    *,
    followed: Followed,
    place: FollowPlace,
    plan: following.FollowPlan,
    simulation: SceneOptions,
    plot: Annotated[bool, typer.Option("--plot", help="Write follow.png into --out.")] = False,
    out: Out = None,
    as_json: AsJson = False,
) -> None:
    """Turn the probe to what the surgeon looks at: a laser spot, the tip of an instrument, or a point.

    The probe turns in the dark, at most 5 degrees from rest to rest, where the target is further from the image plane
    than --within-deg. It stays, and the laser is dark, where the target is out of reach, lost, or jumps, where its link
    is silent, and where the endoscope or the tissue has moved away from the registration. Ctrl-C stops the rig. A
    registration holds once a spot has confirmed it, or with --still-valid. Exit code 3 where a person must come.

    Examples
    --------
    markerseek follow --simulate --plot
    markerseek follow --simulate --spot --seconds 20
    markerseek follow --registration SESSION --rig rig.toml --tip topic:/PSM1/measured_cp --still-valid
    markerseek follow --registration SESSION --rig rig.toml --spot --cameras stereo.toml --images 'left right'
    markerseek follow --registration SESSION --rig rig.toml --point 4 -12 105 --still-valid
    markerseek follow --simulate --pixel 700 480 --seconds 10
    """
    follow_target(followed, place, plan, simulation, Output.asked(as_json=as_json, plot=plot, out=out))


def follow_target(
    followed: Followed,
    place: FollowPlace,
    plan: following.FollowPlan,
    simulation: SceneOptions,
    output: Output,
    *,
    opens: Callable[[FollowRun], AbstractContextManager[bridges.StepListener]] | None = None,
) -> None:
    """Follow, and show what was done.

    ``opens``: opens what takes the steps of the run besides; None: nothing does.
    """
    as_json = output.as_json
    if followed == Followed():
        if not place.simulate:
            raise ConfigError("nothing to follow: name it by --spot, --tip WHERE, --point X Y Z or --pixel X Y")
        followed = Followed(tip="simulated")
    with ExitStack() as opened:
        run = opened.enter_context(
            simulated_run(followed, place, plan, simulation)
            if place.simulate
            else run_on_rig(followed, place, plan, simulation, as_json=as_json)
        )
        listeners: list[bridges.StepListener] = []
        if opens is not None:
            listeners.append(opened.enter_context(opens(run)))
        if place.igtl_port is not None:
            service = igtl.FollowService("127.0.0.1", place.igtl_port, simulated=run.simulated, on_note=note)
            listeners.append(opened.enter_context(service))
            note(f"OpenIGTLink clients connect to 127.0.0.1, port {service.port}")
        if place.record is not None:
            run.record = opened.enter_context(closing(_record(place, followed, plan, run)))
        ended = _follow(run, listeners, as_json=as_json)
        if run.record is not None:
            run.record.end(ended)
    output.show(_report(run, ended))


def _record(
    place: FollowPlace, followed: Followed, plan: following.FollowPlan, run: FollowRun
) -> following.FollowRecord:
    """Begin the record of a run."""
    assert place.record is not None  # noqa: S101  as it is called
    begun = following.FollowBegun(
        what=run.what,
        rig=run.rig,
        simulated=run.simulated,
        registration="" if place.registration is None else str(place.registration),
        plan=plan,
        lit=followed.spot,
        by=person() if place.asked_by is None else place.asked_by,
        begun=datetime.now(UTC).isoformat(timespec="seconds"),
    )
    return following.FollowRecord.create(place.record, begun)


def _follow(run: FollowRun, listeners: Sequence[bridges.StepListener], *, as_json: bool) -> str:
    """Follow until the end, a signal, or a state that only a person ends; returns why it has ended."""
    begun_s: float | None = None
    with stopped_by_signals(), closing(run.follower.steps()) as steps:
        try:
            for step in steps:
                begun_s = step.at_s if begun_s is None else begun_s
                if not as_json:
                    _say(step, run.steps[-1] if run.steps else None, run.hints, begun_s=begun_s)
                run.take(step)
                for listener in listeners:
                    listener.show(step)
                if step.word in following.BY_A_PERSON:
                    return step.said
                if run.ends_s is not None and step.at_s >= run.ends_s:
                    return ""
        except StoppedBySignal as stop:
            if run.record is not None:
                run.record.end(f"stopped by {stop.by}")
            end_stopped(stop, as_json=as_json, kept=None)
    return ""


def _say(
    step: following.FollowStep,
    before: following.FollowStep | None,
    hints: Mapping[following.Word, str],
    *,
    begun_s: float,
) -> None:
    """Print a step that says something new."""
    line = _line(step)
    if before is None or _line(before) != line:
        follows = step.word in _FOLLOWS
        colour = "green" if follows else "yellow"
        why = "" if follows else f": {escape(step.said)}"
        stderr.print(f"{step.at_s - begun_s:7.2f} s  [{colour}]{line}[/]{why}")
        if hint := hints.get(step.word):
            note(hint)
    if step.refused and (before is None or before.refused != step.refused):
        note(step.refused)


def _line(step: following.FollowStep) -> str:
    return "follows the target" if step.word in _FOLLOWS else step.word


_FOLLOWS = frozenset({"there", "turning", "resting"})
"""Words of a target that is followed."""


def _report(run: FollowRun, ended: str) -> Report:
    """Return what was done, with the error of the simulated truth where there is one."""
    steps = run.steps
    last = steps[-1] if steps else None
    # From the first time that it was there: before, the probe comes from anywhere.
    first_s = next((step.at_s for step in steps if step.word == "there"), None)
    off = [
        abs(step.probe_deg - true_deg)
        for step, true_deg in zip(steps, run.true_deg, strict=True)
        if true_deg is not None and first_s is not None and step.at_s >= first_s and step.word in _FOLLOWS
    ]
    held = last is not None and last.word in following.BY_A_PERSON
    values: dict[str, object] = {
        "ended": ended,
        "last": None if last is None else msgspec.to_builtins(last),
        "turns": sum(a.turning and not b.turning for a, b in pairwise(steps)),
        "confirmed": "" if last is None else last.confirmed,
        "states": sorted({step.word for step in steps}),
    }
    rows = [
        ("ended", ended or "at the time that was asked for"),
        ("states", ", ".join(dict.fromkeys(step.word for step in steps))),
    ]
    if last is not None and last.confirmed:
        rows.append(("probe's image", last.confirmed))
    if last is not None and last.not_counted:
        rows.append(("errors that are not counted", "; ".join(last.not_counted)))
    if off:
        mean_deg = sum(off) / len(off)
        inside = sum(each <= last.within_deg for each in off) / len(off) if last is not None else 0.0
        values["simulation"] = {"mean_off_deg": mean_deg, "inside": inside, "largest_off_deg": max(off)}
        rows.append(
            ("off the target (simulated truth)", f"{mean_deg:.2f} deg in the mean, {inside:.0%} of the time inside")
        )
    return Report(
        values=with_version(**values),
        shown=[f"[bold]{escape(run.title)}[/]", facts(rows)],
        pictures={"follow.png": drawn(_figure, run)},
        exit_code=HELD if held else 0,
    )


def _figure(run: FollowRun) -> Figure:
    from markerseek.show import FollowedMoment, follow_figure

    moments = [
        FollowedMoment(
            at_s=step.at_s - run.steps[0].at_s,
            probe_deg=step.probe_deg,
            target_deg=step.target_deg,
            within_deg=step.within_deg,
            word=step.word,
            stays=step.word in following.BY_ITSELF or step.word in following.BY_A_PERSON,
            true_deg=true_deg,
        )
        for step, true_deg in zip(run.steps, run.true_deg, strict=True)
    ]
    return follow_figure(moments, title=run.title)
