"""``markerseek track``: finds a marker on the simulated rig, lets it move, and follows it from frame to frame."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.markup import escape
from rich.text import Text

from markerseek import rigs, runs
from markerseek.cli.options import AsJson, Out
from markerseek.cli.report import Output, Report, drawn, facts, with_version
from markerseek.cli.terminal import announce_compilation
from markerseek.core import (
    ConfigError,
    Found,
    Refused,
    SearchError,
    SearchPlan,
    SimulationOptions,
    counted,
    require_range,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from markerseek.sim import OscillatingMotion, SimulatedSettings

EXAMPLES = """
    markerseek track --rig examples/rigs/direct-drive.toml --speed-deg-per-s 5 --plot
    markerseek track --sweep --rig examples/rigs/prm1z8-limits.toml --speed-deg-per-s 5 --plot
    markerseek track --speed-deg-per-s 0.5 --json
"""

_READOUT_S = 0.05
"""Readout of the rig without a rig file: that of a receiver that streams its frames."""


def command(
    speed_deg_per_s: Annotated[
        float, typer.Option(help="Speed of the marker, which goes to and fro over 20 degrees, at most 20.")
    ] = 1.0,
    duration_s: Annotated[float, typer.Option(help="How long it is followed, on the simulated clock.")] = 20.0,
    rig: Annotated[
        Path | None, typer.Option(help="Rig file (TOML) of a simulated rig; its stage and receiver set the frame rate.")
    ] = None,
    marker_deg: Annotated[
        float | None, typer.Option(help="Angle of the marker at rest.", show_default="the rig's, else 0")
    ] = None,
    snr_db: Annotated[
        float | None, typer.Option(help="Peak SNR of the image with the probe on the marker.", show_default="40")
    ] = None,
    readout_s: Annotated[
        float | None, typer.Option(help="Seconds to read one acquisition.", show_default="the rig's, else 0.05")
    ] = None,
    sweep: Annotated[
        bool,
        typer.Option(
            "--sweep", help="Follow while the probe turns: a frame for each laser pulse; for receivers in real time."
        ),
    ] = False,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the simulation.")] = 1,
    plot: Annotated[bool, typer.Option("--plot", help="Write track.png into --out.")] = False,
    out: Out = None,
    as_json: AsJson = False,
) -> None:
    """Find a marker on the simulated rig, let it move, and follow it at the rate of the rig's frames.

    Without --sweep the probe comes to rest for each frame. With it the probe turns to and fro about the marker, and a
    marker that is lost is searched for; exit code 3 if it is lost at the end.
    """
    from markerseek.sim import OscillatingMotion

    output = Output.asked(as_json=as_json, plot=plot, out=out)
    require_range("--duration-s", duration_s, low=1, high=600, unit="s")
    swing = OscillatingMotion(speed_deg_s=speed_deg_per_s)
    settings = _settings(rig, swing, marker_deg=marker_deg, snr_db=snr_db, readout_s=readout_s)
    if sweep:
        settings = _for_sweeps(settings)
    announce_compilation()
    assembled = rigs.simulated(seed=seed, settings=settings, swing=swing)
    if sweep:
        runs.require_streaming(assembled)
    session = runs.new_session(
        assembled,
        runs.plan_on(assembled, SearchPlan(method="posterior", start_deg=settings.start_deg, others=0.0)),
    )
    for _ in session.events():
        pass
    policy, refused = _follow(assembled, session, settings, swing, duration_s=duration_s, sweep=sweep)
    values = _values(assembled, policy, swing, settings) | {
        "found_deg": session.result().angle_deg,
        "refused": refused,
        "swept": sweep,
    }
    shown = Report(
        values=with_version(**values),
        shown=[f"[bold]{escape(values['rig'])}[/]", facts(_rows(values))],
        pictures={"track.png": drawn(_figure, values)} if values["track"] else {},
        exit_code=3 if policy.lost else 0,
    )
    output.show(shown)


def _settings(
    path: Path | None,
    swing: OscillatingMotion,
    *,
    marker_deg: float | None,
    snr_db: float | None,
    readout_s: float | None,
) -> SimulatedSettings:
    """Settings of the rig, with a marker that stays inside of the search range."""
    from markerseek.sim import with_options

    settings = rigs.read_simulated(path, cure="only a simulated marker can be made to move")
    if path is None and readout_s is None:
        readout_s = _READOUT_S
    settings = with_options(settings, SimulationOptions(snr_db=snr_db, readout_s=readout_s))
    angle_deg = next(each for each in (marker_deg, settings.marker.angle_deg, 0.0) if each is not None)
    for end_deg in (angle_deg - swing.reach_deg, angle_deg + swing.reach_deg):
        if end_deg not in settings.limits.search:
            raise ConfigError(
                f"--marker-deg is {angle_deg:g}: it moves by {swing.reach_deg:g} deg to either side, out of the search "
                f"range {settings.limits.search}; name an angle nearer to the middle"
            )
    return replace(settings, marker=replace(settings.marker, angle_deg=angle_deg))


def _for_sweeps(settings: SimulatedSettings) -> SimulatedSettings:
    """The rig with a gain that leaves room for the noise of single pulses."""
    if settings.laser.sweep_mode != "free-running":
        raise ConfigError(
            f'laser: sweep_mode is "{settings.laser.sweep_mode}", and a marker is followed with a laser that runs '
            'free: set sweep_mode = "free-running"'
        )
    return replace(settings, receiver=replace(settings.receiver, single_pulses=True))


def _follow(
    rig: rigs.Rig,
    session: runs.Session,
    settings: SimulatedSettings,
    swing: OscillatingMotion,
    *,
    duration_s: float,
    sweep: bool,
) -> tuple[runs.AnyTrackingPolicy, int]:
    """The policy after the run, and the number of frames that were refused."""
    finished, confirmation = session.recorder.finished, session.recorder.confirmation
    if finished is None or not isinstance(finished.estimate, Found):
        raise SearchError(f"the marker was not found at rest ({session.result().answer}): there is nothing to follow")
    found = finished.estimate
    if confirmation is None or found.curve is None:
        raise SearchError("the search confirmed no angle, or states no curve: the marker cannot be followed")
    policy: runs.AnyTrackingPolicy
    if sweep:
        policy = runs.swept_tracking_policy(
            rig, found, confirmation, speed_deg_s=swing.speed_deg_s, duration_s=duration_s
        )
    else:
        frame_s = settings.laser.pulses / settings.laser.rate_hz + settings.receiver.readout_s
        period_s = runs.stage_period_s(settings.stage, fwhm_deg=found.curve.fwhm_deg, speed_deg_s=0.0, frame_s=frame_s)
        policy = runs.tracking_policy(
            rig, found, confirmation, speed_deg_s=swing.speed_deg_s, duration_s=duration_s, period_s=period_s
        )
    return policy, sum(isinstance(event, Refused) for event in runs.track_run(rig, policy, swing))


def _values(
    rig: rigs.Rig, policy: runs.AnyTrackingPolicy, swing: OscillatingMotion, settings: SimulatedSettings
) -> dict[str, Any]:
    """How well a marker was followed; of one that was lost, until then. Times count from when it began to move."""
    rest_deg = settings.marker.angle_deg or 0.0
    quality = runs.quality_of(policy, swing, rest_deg=rest_deg)
    times_s = [each.time_s for each in policy.track]
    return {
        "rig": f"{rig.facts.rig_name}: {rig.facts.description}",
        "speed_deg_s": swing.speed_deg_s,
        "frames": len(times_s),
        "frames_per_s": (len(times_s) - 1) / (times_s[-1] - times_s[0]) if len(times_s) > 1 else None,
        "rms_error_deg": None if quality is None else quality.rms_deg,
        "within_1_deg": None if quality is None else quality.within_1_deg,
        "lag_s": None if quality is None else quality.lag_s,
        "covered": None if quality is None else quality.covered,
        # Only a track by sweeps searches again for a marker that was lost.
        "searched_again": getattr(policy, "searched_again", 0),
        "lost": policy.lost,
        "track": [
            asdict(each)
            | {"time_s": each.time_s - policy.began_s, "truth_deg": rest_deg + swing.moved_deg(each.time_s)}
            for each in policy.track
        ],
    }


def _rows(values: dict[str, Any]) -> list[tuple[str, str | Text]]:
    end = Text("lost", style="bold yellow") if values["lost"] else Text("followed to the end", style="bold green")
    rows: list[tuple[str, str | Text]] = [("marker", end), ("found at rest", f"{values['found_deg']:.2f}°")]
    rate = "" if values["frames_per_s"] is None else f", {values['frames_per_s']:.2f} a second"
    rows.append(("frames", f"{values['frames']}{rate}, {values['refused']} refused"))
    if values["rms_error_deg"] is not None:
        within = f"within 1° in {values['within_1_deg']:.0%} of frames"
        rows += [
            ("error", f"{values['rms_error_deg']:.2f}° (RMS), {within}"),
            ("lag", f"{values['lag_s']:.2f} s"),
            ("95 % band", f"holds the truth in {values['covered']:.0%} of frames"),
        ]
    if values["searched_again"]:
        times = counted(values["searched_again"], "time")
        rows.append(("lost on the way", f"{times}, and searched for while the probe turned"))
    if values["lost"]:
        sweeps = "" if values["swept"] else "sweeps (--sweep), "
        rows.append(("next", f"{sweeps}a faster rig (examples/rigs/direct-drive.toml), fewer pulses, or a lower speed"))
    return rows


def _figure(values: dict[str, Any]) -> Figure:
    from markerseek.pictures import track_figure

    error = "" if values["rms_error_deg"] is None else f", error {values['rms_error_deg']:.2f}° RMS"
    drawn = ("probe_deg", "angle_deg", "sigma_deg", "truth_deg")
    return track_figure(
        [each["time_s"] for each in values["track"]],
        **{name: [each[name] for each in values["track"]] for name in drawn},
        title=f"{values['rig']}: {'lost' if values['lost'] else 'followed'}{error}",
    )
