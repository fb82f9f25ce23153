"""``markerseek emulate``: emulates the devices of a rig byte by byte, to test drivers without hardware."""

from __future__ import annotations

import json
import os
import select
import shlex
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from markerseek import drivers, emulators, rigs
from markerseek.cli.report import matrix_lines
from markerseek.cli.signals import noted_signals
from markerseek.cli.terminal import stderr, stdout
from markerseek.core import ConfigError, counted, require_range
from markerseek.files import quoted, replace_file

if TYPE_CHECKING:
    from markerseek.sim import SimulatedSettings


def command(
    _device: Annotated[
        Literal["bench"],
        typer.Argument(metavar="bench", help="Stage, laser box and receiver, each for any program."),
    ],
    folder: Annotated[Path, typer.Option("--dir", help="Folder for ports, channel files and rig.toml.")],
    seed: Annotated[
        int, typer.Option(min=0, max=2**63 - 1, help="Seed of the simulated world behind the devices.")
    ] = 1,
    rig: Annotated[
        Path | None, typer.Option(help="Rig file (TOML, kind simulated) of that world; without one, its defaults.")
    ] = None,
    pace: Annotated[
        float,
        typer.Option(help="Factor on the readout time of the settings, 0.01 to 1."),
    ] = 1.0,
    mirrored: Annotated[
        bool, typer.Option("--mirrored", help="Mount the probe the other way round on the stage.")
    ] = False,
    receiver: Annotated[
        str,
        typer.Option(
            help="Driver whose receiver is emulated: sonixdaq writes a folder, plus and vantage send frames on this "
            "computer; an unknown name lists them."
        ),
    ] = "sonixdaq",
    endoscope: Annotated[
        bool,
        typer.Option("--endoscope", help="Write images of a stereo endoscope too; typing moves the spot."),
    ] = False,
) -> None:
    """Emulate a rig's devices on pseudo-terminals and in a folder, until Ctrl-C; then print the true state.

    Examples
    --------
    markerseek emulate bench --dir /tmp/bench
    markerseek emulate bench --dir /tmp/bench --seed 3 --pace 0.1
    markerseek emulate bench --dir /tmp/bench --receiver plus
    markerseek emulate bench --dir /tmp/bench --receiver vantage
    markerseek emulate bench --dir /tmp/bench --endoscope
    """
    import numpy as np

    require_range("--pace", pace, low=0.01, high=1)
    settings = rigs.read_simulated(rig, cure="the world behind emulated devices is of kind simulated")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        raise ConfigError(
            f"the folder {folder} cannot be created ({problem.strerror}); name another --dir"
        ) from problem
    emulated = emulators.EmulatedBench(
        settings=settings,
        rng=np.random.default_rng(seed),  # noqa: TID251  here the user's seed becomes the world
        folder=folder / "daq",
        stage=emulators.EmulatedKdc101(play_deg=settings.stage.backlash_deg, mirrored=mirrored),
        receiver=receiver,
    )
    images = None
    if endoscope:
        images = emulators.EmulatedEndoscope(
            world=emulated.world,
            settings=settings,
            folder=folder,
            clock=drivers.SystemClock(),
            rng=np.random.default_rng([seed, 1]),  # noqa: TID251  as above
            displacement_m=emulated.displacement_m if settings.motion.moves else None,
        )
    with noted_signals() as stop:
        _serve(emulated, folder, settings, pace=pace, stop=stop, images=images)
    for line in _truth(emulated, images):
        stderr.print(line)


def _serve(
    emulated: emulators.EmulatedBench,
    folder: Path,
    settings: SimulatedSettings,
    *,
    pace: float,
    stop: list[int],
    images: emulators.EmulatedEndoscope | None,
) -> None:
    """Open the ports, print how to use them, and serve until stopped."""
    real = drivers.SystemClock()
    emulated.daq.warm_up()  # what it loads and computes once would hold up the lines for half a second
    with ExitStack() as opened:
        lines = []
        for name in ("stage", "laser"):
            lines.append(opened.enter_context(emulated.line(name, clock=real, link=_free(folder / name))))
            stdout.print(f"{name}: {lines[-1].path}")
        opened.callback(emulated.daq.close)
        stdout.print(emulated.daq.said)
        rig_file = folder / "rig.toml"
        write_text_file(rig_file, _rig_toml(folder, settings, pace=pace, emulated=emulated))
        stdout.print(f"try: markerseek search --rig {quoted(rig_file)} --arm")
        if images is not None:
            stereo = folder / "stereo.toml"
            write_text_file(stereo, _stereo_toml(images))
            left, right = images.folders
            stdout.print(
                f"try: markerseek register --rig {quoted(rig_file)} --cameras {quoted(stereo)} "
                f"--images {shlex.quote(f'{left} {right}')} --endoscope-held --arm"
            )
            stdout.print(images.said)
        stdout.print("Ctrl-C ends it")
        sys.stdout.flush()

        typed = _TypedLines()

        def until() -> bool:
            if images is not None and (line := typed.next()):
                stdout.print(images.type(line))
            return bool(stop)

        emulators.serve_bench(lines=lines, clock=real, pace=pace, daq=emulated.daq, until=until, images=images)


_READOUT_SPARE_S = 0.5
"""Margin on the time to write the channel files on a busy computer, in seconds."""


def _free(link: Path) -> Path:
    """Return the path of a link; removes a dangling link that a killed emulator left."""
    if link.is_symlink() and not link.exists():
        link.unlink()
    return link


class _TypedLines:
    """The lines that a person, or another program, writes to this one."""

    def __init__(self) -> None:
        self._came = b""

    def next(self) -> str:
        """Return the next line; empty if there is none yet."""
        # Not by `readline`: it keeps what came after the line, of which `select` then knows nothing.
        if sys.stdin is not None and select.select([sys.stdin], [], [], 0)[0]:
            self._came += os.read(sys.stdin.fileno(), _MOST_TYPED)
        line, end, rest = self._came.partition(b"\n")
        if not end:
            return ""
        self._came = rest
        return line.decode(errors="replace")


_MOST_TYPED = 4096
"""Most bytes that are read at once of what a person writes."""


def _rig_toml(folder: Path, settings: SimulatedSettings, *, pace: float, emulated: emulators.EmulatedBench) -> str:
    """Return the text of the rig file for the emulated devices."""
    # 10 % more than the emulator needs, or the driver would report a timeout on a loaded computer.
    readout_s = round(_READOUT_SPARE_S + 1.1 * pace * settings.receiver.readout_s, 3)
    place = folder.resolve()
    receiver = emulated.daq.keys
    if isinstance(emulated.daq, emulators.EmulatedSonixDaq):
        receiver += f"readout_s = {readout_s}\nsweep_period_s = {settings.receiver.frame_period_s}\n"
    # A laser that is measured is that of a box with a light meter.
    meter = settings.laser.energy_meter_noise is not None
    energy = f'energy_from = "photodiode"\nusual_energy = {emulators.LIGHT_COUNTS}\n' if meter else ""
    return f"""# Emulated devices: no light, nothing turns. Every key is explained in examples/rigs/bench.toml.
# begin_s, age_s, answer_s and lease_s are longer than for hardware, because the emulator shares this computer with the
# search: on a busy one, waits of 20 ms end more than 0.1 s late. Do not copy them to the rig file of real devices.
kind = "bench"

[stage]
port = {json.dumps(str(place / "stage"))}
zero_deg = 0.0
speed_deg_s = {settings.stage.speed_deg_s}
acceleration_deg_s2 = {settings.stage.acceleration_deg_s2}
approach_deg = {settings.stage.approach_deg}
play_deg = {settings.stage.backlash_deg}
begin_s = 5.0
age_s = 1.0

[laser]
port = {json.dumps(str(place / "laser"))}
pulses = {settings.laser.pulses}
rate_hz = {settings.laser.rate_hz}
answer_s = 5.0
{energy}
[receiver]
{receiver}sampling_hz = {settings.receiver.sampling_hz}

[supervisor]
lease_s = 1.0

{world_text(settings)}"""


def _stereo_toml(images: emulators.EmulatedEndoscope) -> str:
    """Return the text of the calibration of the emulated endoscope."""
    camera = images.cameras.left
    lens = f"""size_px = {[*camera.size_px]}
focal_px = {[*camera.focal_px]}
centre_px = {[*camera.centre_px]}
distortion = {[*camera.distortion]}
"""
    return f"""# Calibration of the emulated endoscope; every key is explained in examples/stereo.toml.
rotation_vector = [0.0, 0.0, 0.0]
translation_m = {images.cameras.left_to_right.translation_m.tolist()}
calibration_sigma_px = {images.calibration_sigma_px}

[left]
{lens}
[right]
{lens}"""


def world_text(settings: SimulatedSettings) -> str:
    """Return the probe and limits of a simulated world as the end of a rig file (TOML)."""
    limits = settings.limits
    return f"""[probe]
trigger_offset_s = {settings.receiver.trigger_offset_s}
face_radius_m = {settings.probe.face_radius_m}

[limits.search]
low_deg = {limits.search.low_deg}
high_deg = {limits.search.high_deg}

[limits.travel]
low_deg = {limits.travel.low_deg}
high_deg = {limits.travel.high_deg}
"""


def write_text_file(path: Path, text: str) -> None:
    """Write a file whole, or not at all."""
    try:
        with replace_file(path) as part:
            part.write_text(text, encoding="utf-8")
    except OSError as problem:
        raise ConfigError(f"{path}: it cannot be written: {problem.strerror}; name another folder or file") from problem


def true_marker(truth_deg: float | None) -> str:
    """Return the true angle of a simulated marker as a line to print; None: there is no marker."""
    return "truth: there is no marker" if truth_deg is None else f"truth: the marker is at {truth_deg:.3f} deg"


def _truth(emulated: emulators.EmulatedBench, images: emulators.EmulatedEndoscope | None) -> list[str]:
    """Return the true state of the emulated world, which no driver can read."""
    low_deg, high_deg = emulated.stage.truth_range_deg
    fired = counted(len(emulated.laser_box.pulses), "pulse of light was", "pulses of light were")
    truth = [f"truth: the probe was between {low_deg:.3f} and {high_deg:.3f} deg", f"truth: {fired} fired"]
    if images is None:
        return [*truth, true_marker(emulated.truth_deg)]
    # A spot that is moved has no one angle.
    return [*truth, "truth: davinci_to_trus is", *matrix_lines(images.true.matrix.tolist())]
