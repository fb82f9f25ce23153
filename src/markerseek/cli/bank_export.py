"""``markerseek bank export``: writes a bank for other programs."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar

import typer
from msgspec import structs
from rich.markup import escape

from markerseek import rigs, runs
from markerseek.cli.options import AsJson, ProbeName, with_values
from markerseek.cli.recordings import TypedTable, require_frames
from markerseek.cli.report import Output, Report, with_version
from markerseek.cli.terminal import announce_compilation, progress_bar, stderr
from markerseek.core import ConfigError
from markerseek.records.banks import TableFormat

if TYPE_CHECKING:
    from markerseek.records.banks import FrameBank


_SUFFIXES = (".igs.mha", ".zea.hdf5", ".csv")

Item = TypeVar("Item")


@with_values
def command(
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
