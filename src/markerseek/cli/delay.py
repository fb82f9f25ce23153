"""``markerseek calibrate --delay``: delay of the laser's stamps, and backlash of the stage, from sweeps on a rig."""

from __future__ import annotations

from contextlib import closing
from dataclasses import asdict
from pathlib import Path

from rich.markup import escape

from markerseek.cli.open_rig import arm_rig, open_rig
from markerseek.cli.report import Output, Report, table, with_version
from markerseek.cli.terminal import announce_compilation, progress_bar
from markerseek.core import Asked
from markerseek.runs import DelayRun, MeasuredDelay


def measure_delay(rig: Path | None, *, arm: bool, as_json: bool) -> None:
    """Sweep a rig there and back over one marker, and print the lines for its rig file."""
    output = Output(as_json=as_json)
    with open_rig(rig, sweeps=True) as (assembled, _):
        run = DelayRun(assembled)
        announce_compilation()
        arm_rig(assembled, file=rig, arm=arm, what="sweep", as_json=as_json)
        with progress_bar(run.sweeps, what="sweeping there and back") as progress, closing(run.events()) as events:
            for event in events:
                if isinstance(event, Asked):
                    progress.advance(progress.task_ids[0])
    found = run.result()
    rig_toml = _rig_toml(found)
    output.show(
        Report(
            values=with_version(**asdict(found), rig_toml=rig_toml),
            shown=[
                table(_rows(found), left=("", " ")),
                f"[dim]from {found.ways} ways over the marker; ± is one standard deviation[/]\n",
                "For the rig file of devices:\n",
                escape(rig_toml),
            ],
        )
    )


def _rows(found: MeasuredDelay) -> list[dict[str, str]]:
    names = (
        ("delay from stamp to light", found.stamp_delay_s, found.stamp_delay_sigma_s, 1e3, "ms"),
        ("backlash", found.backlash_deg, found.backlash_sigma_deg, 1.0, "°"),
    )
    return [
        {"": name, "value": f"{scale * value:.3g}", "±": f"{scale * sigma:.2g}", " ": unit}
        for name, value, sigma, scale, unit in names
    ]


def _rig_toml(found: MeasuredDelay) -> str:
    """Lines for the rig file of devices."""
    return (
        f"[laser]\nstamp_delay_s = {found.stamp_delay_s:.5f}\nstamp_delay_sigma_s = {found.stamp_delay_sigma_s:.5f}\n\n"
        f"[stage]\nplay_deg = {found.backlash_deg:.3f}\n"
    )
