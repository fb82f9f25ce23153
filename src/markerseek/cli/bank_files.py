"""``markerseek bank import`` and ``bank export``: other recordings as banks, and banks for other programs."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer
from rich.markup import escape

from markerseek import rigs, runs
from markerseek.cli.options import (
    AsJson,
    ProbeName,
    TableOptions,
    require_frames,
    with_values,
)
from markerseek.cli.report import Output, Report, with_version
from markerseek.cli.terminal import announce_compilation, progress_bar, scaled, stderr
from markerseek.core import ConfigError
from markerseek.files import as_read_error

if TYPE_CHECKING:
    from markerseek.records.banks import FrameBank, IntensityBank, TableFormat

IMPORT_EXAMPLES = """
    markerseek bank import /data/scan-2024-05-03 scan.hdf5 --reference-deg -12.5
    markerseek bank import frames.npy scan.hdf5 --first-deg -35 --step-deg 0.5 --sampling-mhz 40
    markerseek bank import examples/simulated_scan.csv scan.hdf5
    markerseek bank import run.journal frames.hdf5
"""


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
    table: TableOptions,
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
    """Convert a recording into a bank, with the intensity of each frame."""
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
    bank = _read(source, table.format(), blanked=rigs.blanked_samples(probe))
    require_frames(bank, source, probe=probe)
    held_hz = bank.facts.sampling_hz
    # A contradiction is an error, because a wrong rate scales every depth.
    if sampling_mhz is not None and held_hz is not None and not math.isclose(given["sampling_hz"], held_hz):
        raise ConfigError(
            f"--sampling-mhz is {sampling_mhz:g}, and {source} says {held_hz / 1e6:g} MHz; leave the option out"
        )
    bank = replace(bank, facts=replace(bank.facts, **{name: each for name, each in given.items() if each is not None}))
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


EXPORT_EXAMPLES = """
    markerseek bank export scan.hdf5 scan.igs.mha
    markerseek bank export scan.hdf5 scan.zea.hdf5
    markerseek bank export scan.hdf5 scan.csv
"""
SUFFIXES = (".igs.mha", ".zea.hdf5", ".csv")

Item = TypeVar("Item")


@with_values
def export_bank(
    source: Annotated[Path, typer.Argument(help="Bank: IPASC HDF5, folder of frames, or CSV.", metavar="FROM")],
    to: Annotated[Path, typer.Argument(help="New file: .igs.mha, .zea.hdf5 or .csv.", metavar="TO")],
    table: TableOptions,
    probe: ProbeName = None,
    face_radius_mm: Annotated[
        float | None,
        typer.Option(help="Distance of the array's face from the axis of rotation, if the bank does not state it."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Write a bank with the probe's angles for other programs: images (envelope), channel data (zea), intensities."""
    from markerseek.files import require_new
    from markerseek.records.banks import FrameBank, IntensityBank, require_whole, write_bank

    kind = next((suffix for suffix in SUFFIXES if to.name.lower().endswith(suffix)), None)
    if kind is None or to.name.lower() == kind:
        raise ConfigError(f"{to}: the name must end in one of: {', '.join(SUFFIXES)}")
    if face_radius_mm is not None and not 0 <= face_radius_mm < 1000:
        raise ConfigError(f"--face-radius-mm is {face_radius_mm:g}, it must lie between 0 and 1000 mm")
    if face_radius_mm is not None and kind == ".csv":
        raise ConfigError(f"--face-radius-mm is for .igs.mha and .zea.hdf5, and {to} has no place for it; leave it out")
    bank = rigs.read_recording(source, table.format(), probe=probe)
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
        facts = replace(facts, face_radius_m=face_radius_mm / 1e3)
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
    frames = (replace(each, samples=each.samples[:, filled:]) for each in read)
    write_zea(
        to,
        _with_progress(frames, count),
        series=series,
        array=preset.array,
        band_hz=(preset.low_hz, preset.high_hz),
        first_sample_s=first_s - preset.trigger_offset_s,
    )


def _with_progress(items: Iterable[Item], count: int) -> Iterator[Item]:
    """The items, with a progress bar."""
    with progress_bar(count, what="exporting") as progress:
        for item in items:
            yield item
            progress.advance(progress.task_ids[0])
