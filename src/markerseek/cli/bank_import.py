"""``markerseek bank import``: makes a bank of a recording."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from msgspec import structs
from rich.markup import escape

from markerseek import rigs, runs
from markerseek.cli.options import AsJson, ProbeName, with_values
from markerseek.cli.recordings import TypedTable, require_frames
from markerseek.cli.report import Output, Report, with_version
from markerseek.cli.terminal import announce_compilation, progress_bar, scaled, stderr
from markerseek.core import ConfigError
from markerseek.files import as_read_error
from markerseek.records.banks import TableFormat

if TYPE_CHECKING:
    from markerseek.records.banks import FrameBank, IntensityBank


@with_values
def command(
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
