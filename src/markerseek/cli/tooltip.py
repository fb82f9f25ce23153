"""``markerseek tooltip``: finds the tip of an instrument in B-mode images, and the angles in which it is seen."""

from __future__ import annotations

import logging
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import astuple, replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape
from rich.table import Table

from markerseek import vision
from markerseek.cli.in_options import in_options
from markerseek.cli.options import AsJson, Out
from markerseek.cli.recordings import AngleField
from markerseek.cli.report import Output, Report, drawn, table, with_version
from markerseek.core import ConfigError, RecordError, counted, require_range
from markerseek.files import DECIMAL_COMMA, MIB, angle_in, csv_rows, is_number, series_indices

if TYPE_CHECKING:
    import numpy as np
    from matplotlib.figure import Figure

    from markerseek.bmode import ImageSeries

_LOG = logging.getLogger(__name__)

_PIXEL_MM = 0.1
"""Size of a pixel if neither the files nor the user state it."""

_ROWS = 15
"""Most images that are printed: those with the strongest tips."""


def command(
    images: Annotated[
        Path,
        typer.Argument(
            help="A folder of B-mode images (.png, .dcm, .b8), a .dcm or .b8 of several frames, or a sequence of PLUS "
            "(.igs.mha, .nrrd) with its angles."
        ),
    ],
    angles: Annotated[
        Path | None,
        typer.Option(help="Text file with the angle of each image: a number a line, or lines of name,angle_deg."),
    ] = None,
    step_deg: Annotated[
        float | None,
        typer.Option(
            help="Angle from one image to the next, in the natural order of their names.",
            show_default="1, or the angles in the names",
        ),
    ] = None,
    first_deg: Annotated[float | None, typer.Option(help="Angle of the first image.", show_default="0")] = None,
    angle_field: AngleField = None,
    roi: Annotated[
        str | None,
        typer.Option(help="Rectangle around the tip, in pixels: row,column,rows,columns."),
    ] = None,
    pixel_mm: Annotated[
        float | None, typer.Option(help="Size of a pixel.", show_default="that of the files, else 0.1")
    ] = None,
    as_published: Annotated[
        bool, typer.Option("--as-published", help="Find the tip as in the paper: GrabCut, centroid, its grey value.")
    ] = False,
    plot: Annotated[bool, typer.Option("--plot", help="Write a picture of the series into --out.")] = False,
    out: Out = None,
    as_json: AsJson = False,
) -> None:
    """Find the tip of an instrument in B-mode images, and the range of angles in which it is seen.

    Examples
    --------
    markerseek tooltip scan --step-deg 1 --plot
    markerseek tooltip scan --angles angles.csv --roi 120,80,60,70 --json
    markerseek tooltip scan.b8 --pixel-mm 0.12
    markerseek tooltip scan.igs.mha --angle-field ProbeRotation
    """
    import numpy as np

    from markerseek.bmode import read_image_sequence, read_images
    from markerseek.records.banks import is_sequence, unwrapped

    output = Output.asked(as_json=as_json, plot=plot, out=out)
    rectangle = None if roi is None else _rectangle(roi)
    if pixel_mm is not None:
        require_range("--pixel-mm", pixel_mm, low=1e-3, high=10, unit="mm")
    if angles is not None and (step_deg, first_deg) != (None, None):
        raise ConfigError(f"--angles {angles} names each angle; leave --step-deg and --first-deg out")
    pixel_m = None if pixel_mm is None else (pixel_mm / 1e3, pixel_mm / 1e3)
    if is_sequence(images) and (angles, step_deg, first_deg) == (None, None, None):
        series = read_image_sequence(images, angle_field=angle_field, pixel_m=pixel_m)
    elif angle_field is not None:
        raise ConfigError("--angle-field is for a sequence (.mha, .nrrd) without --angles and --step-deg; leave it out")
    else:
        part = None if rectangle is None else (rectangle.row, rectangle.column, rectangle.rows, rectangle.columns)
        series = read_images(images, roi=part, pixel_m=pixel_m)
    if angles is not None:
        angles_deg = unwrapped(angles, np.array(_angles(angles, series))).tolist()
    else:
        angles_deg = list(series.angles_deg) or _named_angles(series.names, first_deg, step_deg)
    size_m, source = _pixel_size(series, pixel_mm)
    find = vision.published_sensitive_range if as_published else vision.sensitive_range
    measured = find(angles_deg, series.images, pixel_m=size_m, rectangle=rectangle)
    names = dict(zip(angles_deg, series.names, strict=True))
    # The current folder is named, not ".".
    name = images.name if images.is_file() else images.resolve().name
    pixels = dict(zip(angles_deg, series.images, strict=True))
    picture = drawn(_figure, measured, pixels, title=f"{name}: {_reason(measured)}")
    report = Report(
        values=_values(measured, names, size_m, source),
        shown=_shown(measured, names, size_m, source, name),
        pictures={f"{images.stem if images.is_file() else name}-tip.png": picture},
        exit_code=3 if measured.reference_deg is None else 0,
    )
    output.show(report)


def _rectangle(roi: str) -> vision.Rectangle:
    try:
        row, column, rows, columns = (int(part) for part in roi.split(","))
    except ValueError as problem:
        raise ConfigError(f"--roi is {roi!r}; write four whole numbers: row,column,rows,columns") from problem
    return vision.Rectangle(row=row, column=column, rows=rows, columns=columns)


_UNSURE = re.compile(r"[a-z_ ]*(?:[a-z]-|−)(?:\d+(?:\.\d+)?|\.\d+)[_ ]?(?:deg|°)?", re.ASCII | re.IGNORECASE)
"""A name in which a hyphen may separate word and number, or be a minus sign."""


def _named_angles(names: Sequence[str], first_deg: float | None, step_deg: float | None) -> list[float]:
    """Return the angles of images: from their names if these state angles, else in steps, in the order of the names."""
    stems = [Path(name).stem for name in names]
    steps = (0.0 if first_deg is None else first_deg, 1.0 if step_deg is None else step_deg)
    if len(set(stems)) < len(stems):
        # Frames of one file.
        return _steps(range(len(stems)), *steps)
    unsure = [_UNSURE.fullmatch(stem) is not None for stem in stems]
    # Names with a counter all end in a letter, a hyphen and a whole number.
    if any(unsure) and not all(re.fullmatch(r".*[a-z]-\d+", stem, re.IGNORECASE) for stem in stems):
        raise RecordError(
            f"{names[unsure.index(True)]}: its hyphen may be a minus or not; name the images as in angle_-12.5, or "
            "give the angle of each: --angles FILE"
        )
    named = [angle_in(stem) for stem in stems]
    found = [each for each in named if each is not None]
    alike = len(found) == len(names) and len({each.word for each in found}) == 1
    if not (alike and any(each.stated for each in found)):
        return _steps(_places(stems), *steps)
    angles_deg = [each.angle_deg for each in found]
    order = sorted(angles_deg)
    steps_deg = [after - before for before, after in pairwise(order)]
    if (first_deg is not None and first_deg not in (order[0], order[-1])) or (
        step_deg is not None and any(not math.isclose(each, abs(step_deg), abs_tol=1e-6) for each in steps_deg)
    ):
        raise ConfigError(
            f"the names of the images are angles, {order[0]:g} to {order[-1]:g} deg, and --first-deg or --step-deg "
            "says otherwise; leave both out, or give the angle of each: --angles FILE"
        )
    return angles_deg


def _places(stems: Sequence[str]) -> list[int]:
    """Return the place of each image in the scan; a warning names those that are missing."""
    found, missing = series_indices(stems)
    if missing:
        numbers = ", ".join(map(str, missing))
        _LOG.warning("the images numbered %s are missing; the others keep their angles (--angles)", numbers)
    return found


def _steps(places: Sequence[int], first_deg: float, step_deg: float) -> list[float]:
    if not (math.isfinite(step_deg) and step_deg != 0):
        raise ConfigError(f"--step-deg is {step_deg:g} deg, it must be finite and not 0; 1 is usual")
    require_range("--first-deg", first_deg, low=-360, high=360, unit="deg")
    # Rounded to a millionth of a degree: 0.1 added ten times is not 1.
    angles_deg = [round(first_deg + number * step_deg, 6) for number in places]
    require_range("--step-deg: the last angle", angles_deg[-1], low=-360, high=360, unit="deg")
    return angles_deg


def _angles(path: Path, series: ImageSeries) -> list[float]:
    """Return the angles from a file, by the names of the images or in their order."""
    from markerseek.records.banks import deg_per_unit_of

    cure = "write a number a line, or lines of name,angle"
    rows = csv_rows(path, most_bytes=MIB, what="a text file of angles", cure=cure)
    if rows.names and is_number(rows.names[-1]):
        # The first line holds the name of an image and its angle.
        rows = replace(rows, names=(), cells={0: [*rows.names], **rows.cells})
    # In a table with commas between the columns, a decimal comma adds a column.
    if rows.width > 2 or any(len(row) != rows.width for row in rows.cells.values()):
        raise RecordError(f"{path}: one or two columns are expected, the same in each line; {DECIMAL_COMMA}")
    scale = deg_per_unit_of(path, rows.names[-1] if rows.names else "", cure="write them in degrees, or in one of")
    texts = rows.numbers(path, [rows.width - 1], most=[360 / scale])
    numbers = [_number(path, text, scale) for (text,) in texts.values()]
    if rows.width == 1:
        if len(numbers) != len(series.images):
            raise RecordError(f"{path}: {len(numbers)} angles for {len(series.images)} images; give one for each")
        return numbers
    by_name = dict(zip((row[0].strip() for row in rows.cells.values()), numbers, strict=True))
    missing = [name for name in series.names if name not in by_name]
    if missing:
        raise RecordError(
            f"{path}: there is no angle of {missing[0]}; add a line {missing[0]},ANGLE with a decimal point"
        )
    return [by_name[name] for name in series.names]


def _number(path: Path, text: str, deg_per_unit: float) -> float:
    try:
        angle_deg = float(text) * deg_per_unit
    except ValueError:
        angle_deg = math.nan
    # Written so that NaN fails the test, too.
    if not abs(angle_deg) <= 360:
        raise RecordError(f"{path}: {text!r} is no angle in degrees; write numbers between -360 and 360")
    return angle_deg


def _pixel_size(series: ImageSeries, pixel_mm: float | None) -> tuple[tuple[float, float], str]:
    """Return the height and width of a pixel in metres, and where they come from."""
    if series.pixel_m is not None:
        return series.pixel_m, "from the files" if pixel_mm is None else "as given"
    return (_PIXEL_MM / 1e3, _PIXEL_MM / 1e3), "assumed; name it with --pixel-mm"


def _values(
    measured: vision.SensitiveRange, names: dict[float, str], size_m: tuple[float, float], source: str
) -> dict[str, object]:
    """Return the sensitive range; for an image that was not searched, the tip is null."""
    shown = ("visible", "intensity", "level", "area_px", "row", "column")
    first = next((frame.tip for frame in measured.frames if frame.angle_deg == measured.reference_deg), None)
    return with_version(
        found=measured.reference_deg is not None,
        reason=_reason(measured),
        reference_deg=measured.reference_deg,
        half_range_deg=measured.half_deg,
        full_range_deg=measured.full_deg,
        below_deg=measured.below_deg,
        above_deg=measured.above_deg,
        still_seen_at_the_last_image=measured.open_below or measured.open_above,
        pixel_mm=(1e3 * size_m[0], 1e3 * size_m[1]),
        pixel_size=source,
        rectangle=None if first is None else astuple(first.rectangle),
        images=[
            {"image": names[frame.angle_deg], "angle_deg": frame.angle_deg}
            | {name: None if frame.tip is None else getattr(frame.tip, name) for name in shown}
            for frame in measured.frames
        ],
    )


def _reason(measured: vision.SensitiveRange) -> str:
    if measured.reference_deg is None:
        return measured.remark
    least = "at least " if measured.open_below or measured.open_above else ""
    one_side = measured.below_deg is None or measured.above_deg is None
    other = ", the other side taken to be the same" if one_side else ""
    text = (
        f"brightest at {measured.reference_deg:g}°, half range {least}{measured.half_deg:.1f}°, "
        f"whole range {least}{measured.full_deg:.1f}°{other}"
    )
    return text + (f"; {measured.remark}" if measured.remark else "")


def _shown(
    measured: vision.SensitiveRange, names: dict[float, str], size_m: tuple[float, float], source: str, name: str
) -> Iterator[str | Table]:
    answer = "[bold yellow]no tip[/]" if measured.reference_deg is None else "[bold green]tip found[/]"
    yield f"{answer} in {escape(name)}: {escape(in_options(_reason(measured)))}"
    height_mm, width_mm = (1e3 * size for size in size_m)
    yield f"[dim]pixel {height_mm:g} × {width_mm:g} mm, {source}[/]"
    shown = measured.frames
    if len(shown) > _ROWS:
        seen = [(frame.tip.intensity, number) for number, frame in enumerate(shown) if frame.tip is not None]
        shown = tuple(shown[number] for number in sorted(number for _, number in sorted(seen)[-_ROWS:]))
    rows = (
        {
            "angle [deg]": f"{frame.angle_deg:g}",
            "image": names[frame.angle_deg],
            "tip": "not looked for" if tip is None else "seen" if tip.visible else "–",
            "grey value": "–" if tip is None else f"{tip.intensity:g}",
            "must exceed": "–" if tip is None else f"{tip.level:.0f}",
            "pixels": "–" if tip is None else str(tip.area_px),
        }
        for frame, tip in ((frame, frame.tip) for frame in shown)
    )
    if shown:
        yield table(rows, left=("image", "tip"))
    if len(shown) < len(measured.frames):
        those = f"{len(shown)} of {len(measured.frames)} images, those with the strongest tips"
        yield f"[dim]{those if shown else counted(len(measured.frames), 'image')}; --json has all[/]"
    if measured.reference_deg is not None and any(frame.tip is None for frame in measured.frames):
        yield "[dim]not looked for: beyond the angle at which the tip had disappeared[/]"


def _figure(measured: vision.SensitiveRange, pixels: dict[float, np.ndarray], *, title: str) -> Figure:
    from markerseek.show import tip_figure

    frames = measured.frames
    seen = [frame.angle_deg for frame in frames if frame.tip is not None and frame.tip.visible]
    low_deg, high_deg = (min(seen), max(seen)) if seen else (None, None)
    images = [pixels[frame.angle_deg] for frame in frames]
    return tip_figure(frames, images, title=title, low_deg=low_deg, high_deg=high_deg)
