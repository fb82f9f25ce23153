"""``markerseek calibrate``: geometry, timing, sound speed and noise of a rig, from one scan of a point source.

With ``--delay``: delay of the laser's stamps and backlash of the stage, from sweeps over a marker.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer
from msgspec import structs
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from markerseek import rigs, runs, signals
from markerseek.cli.doctor import steadiness
from markerseek.cli.open_rig import arm_rig, open_rig
from markerseek.cli.options import Arm, AsJson, ProbeName, RigFile, Trace
from markerseek.cli.report import Output, Report, table, with_version
from markerseek.cli.terminal import announce_compilation, progress_bar
from markerseek.core import Asked, ChannelFrame, ConfigError, RecordError, Sample, SearchError, require_range

if TYPE_CHECKING:
    from markerseek.calibration import Fitted
    from markerseek.records.banks import FrameBank


_NUMBERS = {
    "zero_deg": ("angle zero (stage reading)", 1.0, "°"),
    "source_deg": ("source in the image plane at", 1.0, "°"),
    "source_radius_m": ("source from the axis", 1e3, "mm"),
    "face_radius_m": ("face radius", 1e3, "mm"),
    "trigger_offset_s": ("trigger offset", 1e6, "µs"),
    "sound_speed_m_s": ("sound speed", 1.0, "m/s"),
    "element_height_m": ("element height (effective)", 1e3, "mm"),
    "noise_sigma": ("noise, beamformed", 1.0, "counts"),
}
"""Numbers of a calibration as in `Calibration` and `Geometry`, with their name, factor and unit in the table."""


def command(
    bank: Annotated[
        Path | None, typer.Argument(help="Scan of one point source with its frames: IPASC HDF5 or a folder.")
    ] = None,
    probe: ProbeName = None,
    source_deg: Annotated[float, typer.Option(help="True angle of the point source, in degrees.")] = 0.0,
    zero_deg: Annotated[float, typer.Option(help="The zero_deg of rig.toml with which the scan was taken.")] = 0.0,
    direction: Annotated[
        Literal["forward", "reverse"],
        typer.Option(help="The direction of rig.toml with which the scan was taken; one scan cannot prove it."),
    ] = "forward",
    pickup_us: Annotated[
        tuple[float, float] | None,
        typer.Option(help="Where the laser's pick-up is in the channels: first and last µs after the trigger, '0 1'."),
    ] = None,
    delay: Annotated[
        bool,
        typer.Option(
            "--delay",
            help="Sweep a rig over one marker instead: delay of the laser's stamps, backlash of the stage.",
        ),
    ] = False,
    rig: RigFile = None,
    arm: Arm = False,
    trace: Trace = None,
    as_json: AsJson = False,
) -> None:
    """Find angle zero, face radius, trigger offset, sound speed and noise, and print the lines for rig.toml.

    Scan a small absorber (a black thread across the plane, a pencil lead) in water or gel, at angles well beyond both
    sides of the strongest. Then prove the sense of rotation with a second source: markerseek doctor --rig RIG.toml
    --source-deg ANGLE. The element height is fitted as well, because without it off-plane sound seems to arrive late.

    Examples
    --------
    markerseek bank scan point.hdf5 --rig examples/rigs/simulated.toml --step-deg 0.5
    markerseek calibrate point.hdf5 --source-deg 12.5
    markerseek calibrate --delay --rig examples/rigs/prm1z8-limits.toml
    """
    from markerseek.records.banks import FrameBank

    if delay == (bank is not None):
        raise ConfigError("name a scan of a point source, or --delay with a rig, and not both")
    if bank is None:
        if (probe, source_deg, zero_deg, direction, pickup_us) != (None, 0.0, 0.0, "forward", None):
            raise ConfigError("--delay takes --rig, --arm, --trace and --json; leave the options of a scan out")

        _measure_delay(rig, arm=arm, trace=trace, as_json=as_json)
        return
    if rig is not None or arm or trace is not None:
        raise ConfigError("--rig, --arm and --trace belong to --delay; a scan names no rig")
    for name, angle_deg in (("--source-deg", source_deg), ("--zero-deg", zero_deg)):
        require_range(name, angle_deg, low=-360, high=360, unit="deg")
    if pickup_us is not None and not 0 <= pickup_us[0] < pickup_us[1] <= 1000:
        raise ConfigError(
            f"--pickup-us is {pickup_us[0]:g} {pickup_us[1]:g}, it must be a first and a later moment of 0 to 1000 us"
        )
    scan = rigs.read_recording(bank, probe=probe)
    if not isinstance(scan, FrameBank):
        raise ConfigError(
            f"{bank}: it holds intensities only, and calibration needs the channel data of each angle; name a folder "
            "of frames, or a bank that 'markerseek bank scan' wrote"
        )
    announce_compilation()
    preset = rigs.preset_of(scan, probe)
    samples = _samples(bank, scan, preset)
    usual_energy = None
    if pickup_us is not None:
        samples, usual_energy = _with_energies(samples, pickup_us, preset)
    try:
        found = runs.calibrate(samples, preset)
    except SearchError as problem:
        raise RecordError(f"{bank}: {problem}") from problem
    geometry = found.geometry
    # The probe's angle is sense * (reading - zero), and must be source_deg where the source was found.
    sense = 1 if direction == "forward" else -1
    reading_deg = sense * geometry.source_deg.value + (zero_deg - sense * source_deg)
    zero = structs.replace(geometry.source_deg, value=reading_deg)
    known = {"zero_deg": zero, "noise_sigma": found.noise_sigma}
    numbers: dict[str, Fitted] = {name: known.get(name) or getattr(geometry, name) for name in _NUMBERS}
    rig_toml = _rig_toml(numbers, direction) + _laser_toml(pickup_us, usual_energy)
    values = with_version(
        # The interval of a `Fitted` is computed.
        **{name: structs.asdict(value) | {"interval95": value.interval95} for name, value in numbers.items()},
        misfit=geometry.misfit,
        energy_spread=found.energy_spread,
        frames=found.frames,
        waves=found.waves,
        rig_toml=rig_toml,
    )
    Output(as_json=as_json).show(Report(values=values, shown=_shown(found, numbers, rig_toml)))


def _samples(bank: Path, scan: FrameBank, preset: signals.ProbePreset) -> list[Sample]:
    """Return the frames of a scan with light, and their readings."""
    samples = []
    with progress_bar(len(scan.angles_deg), what="imaging") as progress:
        try:
            for sample in runs.bank_samples(scan, probe=preset):
                if not sample.dark:
                    samples.append(sample)
                    progress.advance(progress.task_ids[0])
        except RecordError as problem:
            raise RecordError(f"{bank}: {problem}") from problem
    return samples


def _with_energies(
    samples: Sequence[Sample], pickup_us: tuple[float, float], preset: signals.ProbePreset
) -> tuple[list[Sample], float]:
    """Return the samples with their energies by the pick-up in the headers, and the mean pick-up."""
    frames = [sample.frame for sample in samples if isinstance(sample.frame, ChannelFrame)]
    pickups = [
        signals.pickup_amplitude(frame, window_us=pickup_us, full_scale=preset.full_scale, recorded=preset.recorded)
        for frame in frames
    ]
    usual = statistics.fmean(pickups)
    if not min(pickups) > 0:
        raise ConfigError(
            f"--pickup-us is {pickup_us[0]:g} {pickup_us[1]:g}, and at some angles there is no pick-up; look for it at "
            "the beginning of a frame"
        )
    headers = [structs.replace(frame.header, energy=each / usual) for frame, each in zip(frames, pickups, strict=True)]
    measured = [structs.replace(frame, header=header) for frame, header in zip(frames, headers, strict=True)]
    return [structs.replace(sample, frame=frame) for sample, frame in zip(samples, measured, strict=True)], usual


def _laser_toml(pickup_us: tuple[float, float] | None, usual_energy: float | None) -> str:
    """Return the lines for a rig file that let it measure the energy by the pick-up; none without."""
    if pickup_us is None:
        return ""
    return f'\n[laser]\nenergy_from = "pickup"\npickup_us = {list(pickup_us)}\nusual_energy = {usual_energy:.1f}\n'


def _rig_toml(numbers: dict[str, Fitted], direction: str) -> str:
    """Return the lines for a rig file, with as many digits as the intervals make worth writing."""
    return f"""[stage]
zero_deg = {numbers["zero_deg"].value:.3f}
direction = "{direction}"

[probe]
sound_speed_m_s = {numbers["sound_speed_m_s"].value:.1f}
trigger_offset_s = {numbers["trigger_offset_s"].value:.2e}
face_radius_m = {numbers["face_radius_m"].value:.5f}
"""


def _shown(found: runs.Calibration, numbers: dict[str, Fitted], rig_toml: str) -> Iterator[str | Table]:
    yield table((_row(*_NUMBERS[name], number) for name, number in numbers.items()), left=("", " "))
    yield (
        f"[dim]{found.waves} of {found.frames} angles had a wave clear enough to be used; the residual of the fit is "
        f"{found.geometry.misfit:.1%} of their height; {steadiness(found.energy_spread)}[/]\n\nFor rig.toml:\n"
    )
    yield escape(rig_toml)


def _row(title: str, scale: float, unit: str, number: Fitted) -> dict[str, str | Text]:
    low, high = (scale * end for end in number.interval95)
    # Two significant digits of the standard deviation.
    digits = max(0, min(4, 1 - math.floor(math.log10(max(scale * number.sigma, 1e-9)))))
    return {
        "": Text(title, style="dim"),
        "value": f"{scale * number.value:.{digits}f}",
        "95 % interval": f"{low:.{digits}f} to {high:.{digits}f}",
        " ": unit,
    }


def _measure_delay(rig: Path | None, *, arm: bool, trace: Path | None, as_json: bool) -> None:
    """Sweep a rig there and back over one marker, and print the lines for its rig file."""
    output = Output(as_json=as_json)
    with open_rig(rig, sweeps=True, trace=trace) as (assembled, _):
        run = runs.DelayRun(assembled)
        announce_compilation()
        arm_rig(assembled, file=rig, arm=arm, what="sweep", as_json=as_json)
        with progress_bar(run.sweeps, what="sweeping there and back") as progress, closing(run.events()) as events:
            for event in events:
                if isinstance(event, Asked):
                    progress.advance(progress.task_ids[0])
    found = run.result()
    rig_toml = _delay_toml(found)
    output.show(
        Report(
            values=with_version(**asdict(found), rig_toml=rig_toml),
            shown=[
                table(_delay_rows(found), left=("", " ")),
                f"[dim]from {found.ways} ways over the marker; ± is one standard deviation[/]\n",
                "For the rig file of devices:\n",
                escape(rig_toml),
            ],
        )
    )


def _delay_rows(found: runs.MeasuredDelay) -> list[dict[str, str]]:
    names = (
        ("delay from stamp to light", found.stamp_delay_s, found.stamp_delay_sigma_s, 1e3, "ms"),
        ("backlash", found.backlash_deg, found.backlash_sigma_deg, 1.0, "°"),
    )
    return [
        {"": name, "value": f"{scale * value:.3g}", "±": f"{scale * sigma:.2g}", " ": unit}
        for name, value, sigma, scale, unit in names
    ]


def _delay_toml(found: runs.MeasuredDelay) -> str:
    """Return the lines for the rig file of devices."""
    return (
        f"[laser]\nstamp_delay_s = {found.stamp_delay_s:.5f}\nstamp_delay_sigma_s = {found.stamp_delay_sigma_s:.5f}\n\n"
        f"[stage]\nplay_deg = {found.backlash_deg:.3f}\n"
    )
