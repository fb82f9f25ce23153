"""``markerseek bank export``: a bank for 3D Slicer and PLUS, for ROS 2, or as a table."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Annotated, TypeVar

import msgspec
import typer
from rich.markup import escape

from markerseek import __version__
from markerseek.cli.terminal import announce_compilation, aside, people, print_json, progress_bar
from markerseek.core import ConfigError

NAME = "export"
EXAMPLES = (
    "Examples:\n\n"
    "  markerseek bank export scan.hdf5 scan.igs.mha\n\n"
    "  markerseek bank export scan.hdf5 scan.mcap\n\n"
    "  markerseek bank export scan.hdf5 scan.csv"
)
SUFFIXES = (".igs.mha", ".mcap", ".csv")

Item = TypeVar("Item")


class ExportReport(msgspec.Struct, frozen=True, kw_only=True):
    """What an export wrote."""

    path: str
    angles: int
    images: bool
    version: str = __version__


def command(
    source: Annotated[Path, typer.Argument(help="Bank: IPASC HDF5, folder of frames, or CSV.", metavar="FROM")],
    to: Annotated[
        Path, typer.Argument(help="File to be written: .igs.mha, .mcap or .csv; it must not exist.", metavar="TO")
    ],
    probe: Annotated[
        str | None, typer.Option(help="Preset of the imaging chain.", show_default="that of the bank, else BPL9-5/55")
    ] = None,
    face_radius_mm: Annotated[
        float | None,
        typer.Option(help="Distance of the array's face from the axis of rotation, where the bank does not hold it."),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object for programs.")] = False,
) -> None:
    """Write a bank's photoacoustic images (envelope) with the probe's angles for other programs."""
    from markerseek.records.banks import FrameBank, read_bank
    from markerseek.records.exports import write_intensities, write_mcap, write_sequence
    from markerseek.rigs.bank_images import bank_curve, bank_images

    if not to.name.lower().endswith(SUFFIXES):
        raise ConfigError(f"{to}: the name must end in one of: {', '.join(SUFFIXES)}")
    if face_radius_mm is not None and not 0 <= face_radius_mm < 1000:
        raise ConfigError(f"--face-radius-mm is {face_radius_mm:g}, it must lie between 0 and 1000 mm")
    if face_radius_mm is not None and to.suffix.lower() != ".mha":
        raise ConfigError(f"--face-radius-mm is for .igs.mha, and {to} has no place for it; leave it out")
    bank = read_bank(source)
    frames = isinstance(bank, FrameBank)
    if probe is not None and not frames:
        raise ConfigError(f"--probe is {probe}, and {source} holds intensities, not channel data; leave it out")
    announce_compilation()
    count = len(bank.angles_deg)
    if to.suffix.lower() == ".csv":
        write_intensities(to, angles_deg=bank.angles_deg, intensities=bank_curve(bank, probe=probe).intensity.tolist())
    elif not isinstance(bank, FrameBank) and to.suffix.lower() == ".mha":
        raise ConfigError(f"{source}: it holds intensities and no frames to make images of; export it as .mcap or .csv")
    else:
        images = _shown(bank_images(bank, probe=probe), count) if isinstance(bank, FrameBank) else None
        if to.suffix.lower() == ".mcap" or images is None:
            write_mcap(to, images, angles_deg=bank.angles_deg, intensities=bank.intensities)
        else:
            radius_m = bank.facts.face_radius_m if face_radius_mm is None else face_radius_mm / 1e3
            if radius_m is None:
                aside.print(
                    "[yellow]ImageToProbe is left out: the bank does not say how far the array's face is from the axis "
                    "of rotation; give --face-radius-mm[/]"
                )
            write_sequence(to, images, angles_deg=bank.angles_deg, face_radius_m=radius_m)
    if as_json:
        print_json(ExportReport(path=str(to), angles=count, images=frames and to.suffix.lower() != ".csv"))
    else:
        people.print(f"{count} angles in {escape(str(to))}")


def _shown(items: Iterable[Item], count: int) -> Iterator[Item]:
    """The same items, with a bar."""
    with progress_bar(count, what="exporting") as progress:
        for item in items:
            yield item
            progress.advance(progress.task_ids[0])
