"""``markerseek bank``: scans a rig into a bank, describes banks, and converts them from and to other formats."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from contextlib import closing
from dataclasses import asdict, replace
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer
from msgspec import structs
from rich.markup import escape

from markerseek import rigs, runs
from markerseek.cli.open_rig import arm_rig, open_rig, person
from markerseek.cli.options import (
    Arm,
    AsJson,
    Out,
    ProbeName,
    RigFile,
    Trace,
    with_values,
)
from markerseek.cli.recordings import TypedTable, require_frames
from markerseek.cli.report import Output, Report, drawn, facts, with_version
from markerseek.cli.signals import StoppedBySignal, end_stopped, stopped_by_signals
from markerseek.cli.terminal import announce_compilation, progress_bar, scaled, show_view, stderr
from markerseek.core import ConfigError, Estimate, MarkerseekError, Measured, SearchPlan, SimulationOptions
from markerseek.files import as_read_error
from markerseek.records.banks import TableFormat

if TYPE_CHECKING:
    from markerseek.records.banks import FrameBank, IntensityBank
    from markerseek.search import Curve, Peak


def scan(
    out: Annotated[Path, typer.Argument(help="New file, .hdf5.")],
    rig: RigFile = None,
    step_deg: Annotated[float, typer.Option(help="Largest step in degrees.")] = 0.5,
    seed: Annotated[
        int | None,
        typer.Option(min=0, help="Seed of the simulation: the same seed gives the same scan.", show_default="1"),
    ] = None,
    goes_on: Annotated[
        bool,
        typer.Option("--continue", help="Go on with a scan that was killed: only the missing angles are measured."),
    ] = False,
    arm: Arm = False,
    trace: Trace = None,
    wavelength_nm: Annotated[float | None, typer.Option(help="Wavelength of the laser, stored in the bank.")] = None,
    pulse_energy_mj: Annotated[
        float | None, typer.Option(help="Energy of one laser pulse, stored in the bank.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Scan the whole search range of a rig, with dark frames first, and write each acquisition before the next.

    If stopped early, the file has all acquisitions so far. A scan that was killed goes on with --continue.

    Examples
    --------
    markerseek bank scan scan.hdf5 --seed 1
    markerseek bank scan scan.hdf5 --rig examples/rigs/simulated.toml --step-deg 0.25
    markerseek bank scan --continue scan.hdf5 --seed 1
    """
    from markerseek.records.banks import read_bank, record_of
    from markerseek.records.journal import RunView

    runs.require_new_scan(out, goes_on=goes_on)
    wavelength_m = scaled("--wavelength-nm", wavelength_nm, 1e-9, most=20_000)
    pulse_energy_j = scaled("--pulse-energy-mj", pulse_energy_mj, 1e-3, most=10_000)
    announce_compilation()
    taken = 0
    stopped: StoppedBySignal | None = None
    with open_rig(rig, SimulationOptions(seed=seed), trace=trace) as (assembled, _start_deg):
        angles = runs.scan_angles(assembled, step_deg=step_deg)
        view = RunView(plan=SearchPlan(method="exhaustive"), facts=assembled.facts)
        arm_rig(assembled, file=rig, arm=arm, what="scan", as_json=as_json)
        events = runs.scan_bank(
            assembled,
            out,
            step_deg=step_deg,
            wavelength_m=wavelength_m,
            pulse_energy_j=pulse_energy_j,
            goes_on=goes_on,
            by=person(),
        )
        try:
            with (
                stopped_by_signals(),
                progress_bar(angles, what="scanning") as progress,
                closing(events),
            ):
                for event in events:
                    seen = event
                    if isinstance(event, Measured):
                        # The counts of a frame have half a megabyte.
                        seen = structs.replace(event, sample=structs.replace(event.sample, frame=None))
                        taken = event.index if event.role == "search" else taken
                    view = view.add(seen, clock_s=assembled.scanner.clock.now_s())
                    show_view(progress, view, done=taken)
        except StoppedBySignal as stop:
            stopped = stop
        finally:
            # Also after an error: the user must know what the file contains.
            if 0 < taken < angles:
                _print_what_is_left(out, planned=angles)
        if stopped is not None:
            # One or two angles make no bank, and a second stop may end its making: then their record is kept.
            kept = next((path for path in (out, record_of(out)) if path.exists()), None)
            end_stopped(stopped, as_json=as_json, kept=kept)
    facts = assembled.facts
    # Of a scan that went on, with the acquisitions of before.
    held = read_bank(out)
    taken = len(held.angles_deg)
    dark = held.dark_frames
    values = with_version(
        path=str(out),
        rig=facts.description,
        angles=taken,
        dark_frames=dark,
        refused=view.refused,
        simulated=assembled.simulated,
        emulated=facts.emulated,
        seed=facts.seed,
        configuration=facts.fingerprint,
    )
    shown = [f"{taken} angles and {dark} dark frames of a {facts.rig_name} in {escape(str(out))}"]
    Output(as_json=as_json).show(Report(values=values, shown=shown))


def _print_what_is_left(path: Path, *, planned: int) -> None:
    """Print how many angles the file of an interrupted scan has, by reading it."""
    from markerseek.records.banks import read_bank

    try:
        held = len(read_bank(path).angles_deg)
    except MarkerseekError as problem:
        stderr.print(f"[yellow]{escape(str(problem))}[/]")
    else:
        stderr.print(f"[yellow]{escape(str(path))} holds {held} of {planned} angles; they can be read[/]")


@with_values
def info(
    bank: Annotated[
        Path,
        typer.Argument(
            help="HDF5, NumPy or MATLAB arrays, CSV of angle_deg,intensity, or folder with one frame per angle."
        ),
    ],
    table: TableFormat,
    typed: TypedTable,
    probe: Annotated[
        str | None,
        typer.Option(help="Compute the intensities again with this preset, or with your own probe in FILE.toml."),
    ] = None,
    plot: Annotated[bool, typer.Option("--plot", help="Write a picture of the curve into --out.")] = False,
    out: Out = None,
    as_json: AsJson = False,
) -> None:
    """Describe a bank: angles, what is known of probe and laser, the peak of its curve, and the answer of `replay`.

    Examples
    --------
    markerseek bank info scan.hdf5 --plot
    markerseek bank info examples/simulated_scan.csv --json
    """
    from markerseek.figures import bank_figure
    from markerseek.records.banks import require_whole
    from markerseek.show import flat_answer

    output = Output.asked(as_json=as_json, plot=plot, out=out)
    table = typed.added_to(table)
    held = rigs.read_recording(bank, table, probe=probe)
    require_frames(held, bank, probe=probe)
    # The stored intensities need no frame, and a damaged one must not pass for that reason.
    require_whole(held)
    announce_compilation()
    curve = runs.bank_curve(held, probe=probe)
    estimate = runs.answer_from_all(rigs.replayed(bank, probe=probe, table=table), SearchPlan(method="posterior"))
    peak = _peak(curve, estimate)
    judged_by = {
        "background": None if estimate.floor is None else estimate.floor.background,
        "outliers_deg": estimate.outliers_deg,
    }
    values = _values(held, probe) | asdict(peak) | judged_by | flat_answer(estimate)
    name = f"{bank.stem if bank.is_file() else bank.name}.png"
    title = ": ".join(filter(None, (bank.name, held.facts.description)))
    report = Report(
        values=with_version(path=str(bank), **values),
        shown=(f"[bold]{escape(str(bank))}[/]: {values['content']}", facts(_rows(values, estimate))),
        pictures={name: drawn(bank_figure, held, title=title, probe=probe, curve=curve, peak=peak)},
    )
    output.show(report)


def _values(bank: IntensityBank | FrameBank, probe: str | None) -> dict[str, Any]:
    """Return what is in a bank.

    Beside them stand the statistics of its peak with the names of bluesky: com, cen, fwhm, max.

    ``probe``: that with which the intensities are computed again; None takes the bank's.
    """
    from markerseek.records.banks import FrameBank

    known = bank.facts
    angles = bank.angles_deg
    begun = [each for each in bank.started_s if math.isfinite(each)]
    zero_s = known.clock_zero_unix_s
    return {
        "content": "frames of channel data" if isinstance(bank, FrameBank) else "intensities",
        "description": known.description,
        "angles": len(angles),
        "first_deg": angles[0],
        "last_deg": angles[-1],
        "largest_step_deg": max(high - low for low, high in pairwise(angles)),
        "dark_frames": bank.dark_frames,
        "dark_intensity": runs.dark_intensity(bank, probe=probe),
        "intensities_stored": runs.intensities_stored(bank, probe=probe),
        "imaged_by": _imaged_by(bank, probe),
        "reference_deg": known.reference_angle_deg,
        "began_unix_s": zero_s + min(begun) if begun and zero_s is not None else None,
    } | {name: getattr(known, name) for name in (*_SCALED, "probe", "made_with", "configuration", "seed")}


def _peak(curve: Curve, estimate: Estimate) -> Peak:
    """Return the statistics of the highest peak, of the samples and above the background by which the answer judges."""
    import numpy as np

    from markerseek.search import Curve, peak_of

    background = None if estimate.floor is None else estimate.floor.background
    kept = ~np.isin(curve.angle_deg, estimate.outliers_deg)
    judged = Curve(angle_deg=curve.angle_deg[kept], intensity=curve.intensity[kept])
    return peak_of(judged, background=background or 0.0)


_SCALED = {
    "sampling_hz": "sampling {:g} MHz",
    "sound_speed_m_s": "speed of sound {:g} m/s",
    "pitch_m": "pitch {:.4g} mm",
    "face_radius_m": "face radius {:.4g} mm",
    "wavelength_m": "wavelength {:.4g} nm",
    "pulse_energy_j": "pulse energy {:.4g} mJ",
}
_UNITS = {"MHz": 1e-6, "m/s": 1.0, "mm": 1e3, "nm": 1e9, "mJ": 1e3, "°": 1.0}


def _rows(values: dict[str, Any], estimate: Estimate) -> Iterator[tuple[str, str | None]]:
    """Yield the names and values for people."""
    from markerseek.show import estimate_line, outliers_rows

    yield "scanned", values["description"] or None
    yield "began", None if values["began_unix_s"] is None else _date(values["began_unix_s"])
    yield "angles", str(values["angles"])
    steps = f"steps of at most {values['largest_step_deg']:.3g}°"
    yield "range", f"{values['first_deg']:g}° to {values['last_deg']:g}°, {steps}"
    if values["dark_intensity"] is not None:
        largest = f"the largest intensity is {values['dark_intensity']:.4g}"
        yield "dark frames", f"{values['dark_frames']}, {largest}"
    yield "intensities", "as the file has them" if values["intensities_stored"] else "computed from the frames"
    yield "imaged by", values["imaged_by"]
    yield "max", f"{values['max_intensity']:.4g} at {values['max_deg']:.3f}°"
    above = ""
    if values["background"] is not None:
        above = " above the background"
        yield "background", f"{values['background']:.4g}, seen at all angles"
    yield from outliers_rows(values["outliers_deg"])
    for name, title in (
        ("com_deg", "com, centre of mass above half height"),
        ("cen_deg", "cen, middle at half height"),
        ("fwhm_deg", "fwhm, width at half height"),
    ):
        yield title + above, None if values[name] is None else f"{values[name]:.3f}°"
    yield "answer from all angles", estimate_line(estimate)
    yield "reference", None if values["reference_deg"] is None else f"{values['reference_deg']:.3f}°"
    for name, text in _SCALED.items():
        title, form, unit = text.rsplit(" ", 2)
        yield title, None if values[name] is None else f"{form.format(values[name] * _UNITS[unit])} {unit}"
    for name in ("probe", "made_with", "configuration", "seed"):
        yield name.replace("_", " "), None if values[name] is None else str(values[name])


def _imaged_by(bank: IntensityBank | FrameBank, probe: str | None) -> str | None:
    """Return the imaging chain of the frames: its preset, who named it, and its parameters.

    None if there are no frames.
    """
    from markerseek.records.banks import FrameBank

    if not isinstance(bank, FrameBank):
        return None
    preset = rigs.preset_of(bank, probe)
    if probe is not None:
        named = "--probe"
    else:
        named = "assumed, as the file names no probe: --probe" if bank.facts.probe is None else "as the file has it"
    return (
        f"the chain of {preset.name} ({named}): {preset.array.elements} elements of "
        f"{1e3 * preset.array.pitch_m:.4g} mm, {1e-6 * preset.sampling_hz:g} MHz, {preset.sound_speed_m_s:g} m/s, "
        f"band {1e-6 * preset.low_hz:g} to {1e-6 * preset.high_hz:g} MHz"
    )


def _date(unix_s: float) -> str:
    try:
        return f"{datetime.fromtimestamp(unix_s, UTC):%Y-%m-%d %H:%M:%S} UTC"
    # A foreign file can contain any number, and datetime ends with the year 9999.
    except (OverflowError, ValueError, OSError):
        return f"{unix_s:g} s after 1970"


@with_values
def import_bank(
    source: Annotated[
        Path,
        typer.Argument(
            help="Folder with a SonixDAQ folder (or .npy, .mat) per angle; CSV; .npy, .npz or .mat, also a Verasonics "
            "workspace; HDF5 of IPASC or zea; sequence of PLUS (.igs.mha, .nrrd); journal of a search.",
            metavar="FROM",
        ),
    ],
    to: Annotated[Path, typer.Argument(help="New file, .hdf5.", metavar="TO")],
    table: TableFormat,
    typed: TypedTable,
    probe: ProbeName = None,
    sampling_mhz: Annotated[
        float | None, typer.Option(help="Sampling frequency, if the recording does not state it; usually 40.")
    ] = None,
    reference_deg: Annotated[float | None, typer.Option(help="Known angle of the marker, in degrees.")] = None,
    face_radius_mm: Annotated[
        float | None, typer.Option(help="Distance of the array's face from the axis of rotation.")
    ] = None,
    wavelength_nm: Annotated[float | None, typer.Option(help="Wavelength of the laser.")] = None,
    pulse_energy_mj: Annotated[float | None, typer.Option(help="Energy of one laser pulse.")] = None,
    as_json: AsJson = False,
) -> None:
    """Convert a recording into a bank, with the intensity of each frame.

    Examples
    --------
    markerseek bank import /data/scan-2024-05-03 scan.hdf5 --reference-deg -12.5
    markerseek bank import frames.npy scan.hdf5 --first-deg -35 --step-deg 0.5 --sampling-mhz 40
    markerseek bank import examples/simulated_scan.csv scan.hdf5
    markerseek bank import run.journal frames.hdf5
    """
    from markerseek.records.banks import FrameBank, require_new_bank, whole_bank

    given: dict[str, Any] = {
        "sampling_hz": scaled("--sampling-mhz", sampling_mhz, 1e6, most=1000),
        "face_radius_m": scaled("--face-radius-mm", face_radius_mm, 1e-3, most=1000),
        "wavelength_m": scaled("--wavelength-nm", wavelength_nm, 1e-9, most=20_000),
        "pulse_energy_j": scaled("--pulse-energy-mj", pulse_energy_mj, 1e-3, most=10_000),
        "reference_angle_deg": reference_deg,
    }
    if reference_deg is not None and not -360 <= reference_deg <= 360:
        raise ConfigError(f"--reference-deg is {reference_deg:g} deg, it must lie within one turn")
    require_new_bank(to)
    bank = _read(source, typed.added_to(table), blanked=rigs.blanked_samples(probe))
    require_frames(bank, source, probe=probe)
    held_hz = bank.facts.sampling_hz
    # A contradiction is an error, because a wrong rate scales every depth.
    if sampling_mhz is not None and held_hz is not None and not math.isclose(given["sampling_hz"], held_hz):
        raise ConfigError(
            f"--sampling-mhz is {sampling_mhz:g}, and {source} says {held_hz / 1e6:g} MHz; leave the option out"
        )
    bank = replace(
        bank, facts=structs.replace(bank.facts, **{name: each for name, each in given.items() if each is not None})
    )
    bank = rigs.with_probe_facts(bank, probe)
    announce_compilation()
    frames = isinstance(bank, FrameBank)
    count = len(bank.angles_deg)
    if frames and bank.facts.sampling_hz is None:
        stderr.print("[yellow]the recording has no sampling frequency; 40 MHz is assumed (--sampling-mhz)[/]")
    facts = runs.bank_facts(bank, probe=probe)
    if frames and probe is None and bank.facts.probe is None:
        stderr.print(f"[yellow]the recording does not name its probe; {facts.probe} is assumed (--probe)[/]")
    with (
        whole_bank(to, facts=facts) as writer,
        progress_bar(count, what="importing") as progress,
    ):
        for sample in runs.bank_samples(bank, probe=probe):
            writer.add(sample)
            # Angles are counted, not samples, because some samples are dark frames.
            progress.update(progress.task_ids[0], completed=writer.taken)
    content = "frames of channel data" if frames else "intensities"
    shown = [f"{count} angles of {content} in {escape(str(to))}"]
    if not frames:
        shown.append("it holds intensities only, no channel data; markerseek and pacfish read it")
    report = Report(values=with_version(path=str(to), content=content, angles=count), shown=shown)
    Output(as_json=as_json).show(report)


def _read(source: Path, table: TableFormat, *, blanked: int) -> IntensityBank | FrameBank:
    from markerseek.records.banks import DEFAULT_FORMAT, read_bank
    from markerseek.records.journal import is_journal

    if source.is_file() and table == DEFAULT_FORMAT:
        with as_read_error(source):
            journal = is_journal(source)
        if journal:
            return runs.journal_bank(source)
    return read_bank(source, table, blanked=blanked)


_SUFFIXES = (".igs.mha", ".zea.hdf5", ".csv")

Item = TypeVar("Item")


@with_values
def export_bank(
    source: Annotated[Path, typer.Argument(help="Bank: IPASC HDF5, folder of frames, or CSV.", metavar="FROM")],
    to: Annotated[Path, typer.Argument(help="New file: .igs.mha, .zea.hdf5 or .csv.", metavar="TO")],
    table: TableFormat,
    typed: TypedTable,
    probe: ProbeName = None,
    face_radius_mm: Annotated[
        float | None,
        typer.Option(help="Distance of the array's face from the axis of rotation, if the bank does not state it."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Write a bank with the probe's angles for other programs: images (envelope), channel data (zea), intensities.

    Examples
    --------
    markerseek bank export scan.hdf5 scan.igs.mha
    markerseek bank export scan.hdf5 scan.zea.hdf5
    markerseek bank export scan.hdf5 scan.csv
    """
    from markerseek.files import require_new
    from markerseek.records.banks import FrameBank, IntensityBank, require_whole, write_bank

    kind = next((suffix for suffix in _SUFFIXES if to.name.lower().endswith(suffix)), None)
    if kind is None or to.name.lower() == kind:
        raise ConfigError(f"{to}: the name must end in one of: {', '.join(_SUFFIXES)}")
    if face_radius_mm is not None and not 0 <= face_radius_mm < 1000:
        raise ConfigError(f"--face-radius-mm is {face_radius_mm:g}, it must lie between 0 and 1000 mm")
    if face_radius_mm is not None and kind == ".csv":
        raise ConfigError(f"--face-radius-mm is for .igs.mha and .zea.hdf5, and {to} has no place for it; leave it out")
    bank = rigs.read_recording(source, typed.added_to(table), probe=probe)
    require_new(to)
    require_frames(bank, source, probe=probe, face_radius_mm=face_radius_mm)
    # A CSV needs no frames, but a bank with a damaged frame must be refused all the same.
    require_whole(bank)
    announce_compilation()
    if kind == ".csv":
        intensities = tuple(runs.bank_curve(bank, probe=probe).intensity.tolist())
        write_bank(IntensityBank(angles_deg=bank.angles_deg, intensities=intensities), to)
    elif not isinstance(bank, FrameBank):
        raise ConfigError(f"{source}: it holds intensities and no frames; export it as .csv")
    else:
        _write_frames(to, bank, probe=probe, face_radius_mm=face_radius_mm, as_images=kind == ".igs.mha")
    count = len(bank.angles_deg)
    report = Report(
        values=with_version(path=str(to), angles=count, images=kind == ".igs.mha"),
        shown=[f"{count} angles in {escape(str(to))}"],
    )
    Output(as_json=as_json).show(report)


def _write_frames(
    to: Path, bank: FrameBank, *, probe: str | None, face_radius_mm: float | None, as_images: bool
) -> None:
    """Write a bank of frames as a sequence of images, or as channel data of zea."""
    from markerseek.records.banks import series_of, write_sequence, write_zea

    facts = runs.bank_facts(bank, probe=probe)
    if face_radius_mm is not None:
        facts = structs.replace(facts, face_radius_m=face_radius_mm / 1e3)
    elif facts.face_radius_m is None:
        stderr.print(
            "[yellow]the export has no positions of the images: the bank does not state the distance of the array's "
            "face from the axis of rotation; give --face-radius-mm[/]"
        )
    series = series_of(bank, facts=facts)
    count = len(series.order)
    if as_images:
        images = runs.bank_images(bank, probe=probe, order=series.order)
        write_sequence(to, _with_progress(images, count), series=series)
        return
    preset = rigs.preset_of(bank, probe)
    first_s = bank.facts.first_sample_s or 0.0
    filled = round(first_s * preset.sampling_hz)
    read = (bank.frame(index) for index in series.order)
    # Without the samples that were filled in before the first recorded one.
    frames = (structs.replace(each, samples=each.samples[:, filled:]) for each in read)
    write_zea(
        to,
        _with_progress(frames, count),
        series=series,
        array=preset.array,
        band_hz=(preset.low_hz, preset.high_hz),
        first_sample_s=first_s - preset.trigger_offset_s,
    )


def _with_progress(items: Iterable[Item], count: int) -> Iterator[Item]:
    """Yield the items, with a progress bar."""
    with progress_bar(count, what="exporting") as progress:
        for item in items:
            yield item
            progress.advance(progress.task_ids[0])
