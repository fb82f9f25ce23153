"""Reads series of B-mode images: a folder of PNG, DICOM or Ultrasonix ``.b8``, a file with several, or a sequence."""

from __future__ import annotations

import importlib.util
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from markerseek.bmode.dicom import DAMAGED, read_dicom
from markerseek.core import MissingExtraError, RecordError, UInt8
from markerseek.files import MIB, angle_in, as_read_error, endings, in_natural_order, require_input
from markerseek.records import as_record_error, note
from markerseek.records.banks import (
    SEQUENCE_SUFFIXES,
    angles_of,
    first_of,
    is_sequence,
    open_sequence,
    open_ultrasonix,
)

IMAGE_SUFFIXES = (".png", ".dcm", ".b8")
"""Suffixes of files with B-mode images; DICOM files without a suffix need one."""

_MAX_IMAGES = 2000
"""Most images of a series."""

MAX_PIXELS = 1 << 30
_LARGEST = 1 << 28
"""Most pixels of a series, and of one image."""

_MAX_BYTES = 512 * MIB


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ImageSeries:
    """B-mode images in the natural order of their names."""

    names: tuple[str, ...]
    """Name of each: its file, with the number of the frame where a file has several."""
    images: tuple[UInt8[np.ndarray, "rows columns"], ...]
    """Grey values of 8 bits, each."""
    pixel_m: tuple[float, float] | None
    """Height and width of a pixel; None if the files do not say."""
    angles_deg: tuple[float, ...] = ()
    """Angle of each, of a sequence; empty if they are not asked for, or the files do not say."""


def read_images(
    path: Path, *, roi: tuple[int, int, int, int] | None = None, pixel_m: tuple[float, float] | None = None
) -> ImageSeries:
    """Return the images of a folder, or of one file; more than 8 bits are scaled to 8 with one factor for all.

    ``roi``: row, column, rows and columns of a rectangle in the region whose scale is asked for. ``pixel_m``: height
    and width of a pixel, where a person states them; None: as the files say.
    """
    if is_sequence(path):
        return read_image_sequence(path, angles=False, pixel_m=pixel_m)
    read: list[_File] = []
    sizes: dict[tuple[float, float] | None, Path] = {}
    for file in _files(path):
        read.append(_file(file, roi, pixel_m))
        sizes.setdefault(read[-1].size_m, file)
        images = sum(len(each.frames) for each in read)
        pixels = sum(each.frames.size for each in read)
        if images > _MAX_IMAGES or pixels > MAX_PIXELS:
            raise RecordError(
                f"{path}: more than {_MAX_IMAGES} images or {MAX_PIXELS} pixels; give the images of one scan"
            )
    if len(sizes) > 1:
        (first, one), (second, other), *_ = sizes.items()
        raise RecordError(
            f"{path}: a pixel of {one.name} is {_size(first)}, of {other.name} {_size(second)}; keep to one scan"
        )
    read = _in_order(path, read)
    return ImageSeries(
        names=tuple(name for each in read for name in each.names),
        images=_as_8_bits(path, [image for each in read for image in each.frames]),
        pixel_m=next(iter(sizes)),
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _File:
    """The images of one file."""

    path: Path
    frames: np.ndarray
    """Grey values, (frames, rows, columns)."""
    size_m: tuple[float, float] | None
    """Height and width of a pixel."""
    instance: int | None = None
    """Number of the file in a series of DICOM."""

    @property
    def names(self) -> list[str]:
        """Name of each image."""
        name = self.path.name
        count = len(self.frames)
        return [name] if count == 1 else [f"{name}, frame {number + 1}" for number in range(count)]


def _in_order(path: Path, read: list[_File]) -> list[_File]:
    """Return the files in the order of their InstanceNumber, unless their names are angles, or state the same order."""
    numbers = [each.instance for each in read if each.instance is not None]
    if len(set(numbers)) < len(read) or numbers == sorted(numbers):
        return read
    named = [angle_in(each.path.stem) for each in read]
    if all(named) and any(each.stated for each in named if each is not None):
        return read
    missing = sorted({*range(min(numbers), max(numbers))} - {*numbers}) if np.ptp(numbers) < 2 * len(numbers) else []
    gaps = f"; {first_of([str(each) for each in missing])} are missing" if missing else ""
    note(
        path,
        f"its images are taken in the order of their InstanceNumber, which is not that of their names{gaps}; the angle "
        "of each can be stated by its name",
    )
    return sorted(read, key=lambda each: each.instance or 0)


def read_image_sequence(
    path: Path, *, angles: bool = True, angle_field: str | None = None, pixel_m: tuple[float, float] | None = None
) -> ImageSeries:
    """Return the B-mode images of a sequence, the first at each angle; a warning names those that are left out.

    ``angles``: whether an angle is needed; otherwise all valid images. ``angle_field``: as of
    `markerseek.records.banks.angles_of`. ``pixel_m``: as of `read_images`.
    """
    sequence = open_sequence(path)
    count = len(sequence.frame_fields)
    (rows, columns, _) = sequence.shape
    if sequence.kind != "BRIGHTNESS":
        raise RecordError(f"{path}: it holds {sequence.kind} and no B-mode images; read it as a bank")
    if count > _MAX_IMAGES or count * rows * columns > MAX_PIXELS:
        raise RecordError(
            f"{path}: {count} images of {columns} × {rows}, at most {_MAX_IMAGES} images or {MAX_PIXELS} pixels are "
            "read; give the images of one scan"
        )
    placed = angles_of(sequence, angle_field=angle_field) if angles else {}
    firsts = {angle_deg: number for number, angle_deg in reversed(placed.items())}
    if len(firsts) < len(placed):
        note(path, f"{len(placed) - len(firsts)} images repeat an angle; the first at each angle is taken")
    numbers = set(firsts.values()) if angles else set(filter(sequence.valid_image, range(count)))
    found = {number: image for number, image in enumerate(sequence.frames()) if number in numbers}
    if not found:
        raise RecordError(f"{path}: none of its {count} frames has a valid image; record it again")
    return ImageSeries(
        names=tuple(f"{path.name}, Seq_Frame{number:04d}" for number in found),
        images=_as_8_bits(path, list(found.values())),
        pixel_m=sequence.pixel_m if pixel_m is None else pixel_m,
        angles_deg=tuple(placed[number] for number in found) if angles else (),
    )


def _files(path: Path) -> list[Path]:
    if not path.is_dir():
        return [path]
    # macOS puts a file ._NAME beside each that it copies to a disk of another system.
    held = [each for each in in_natural_order(path.iterdir()) if not each.name.startswith(".")]
    files = [each for each in held if each.suffix.lower() in IMAGE_SUFFIXES]
    if not files:
        raise RecordError(
            f"{path}: there is no image in this folder; {', '.join(IMAGE_SUFFIXES)} are read, and it holds "
            f"{endings(held)}; export the images as one of these"
        )
    return files


def _file(path: Path, roi: tuple[int, int, int, int] | None, pixel_m: tuple[float, float] | None) -> _File:
    """Return the images of one file."""
    suffix = path.suffix.lower()
    if suffix == ".b8":
        file = open_ultrasonix(path)
        frames = np.stack([file.b_mode(n) for n in range(min(file.header.frames, _MAX_IMAGES + 1))])
        return _File(path=path, frames=frames, size_m=pixel_m)
    if suffix not in IMAGE_SUFFIXES:
        read = ", ".join((*IMAGE_SUFFIXES, *SEQUENCE_SUFFIXES))
        raise RecordError(f"{path}: {read} are read; export the images as one of these")
    module, package = ("cv2", "opencv-python-headless") if suffix == ".png" else ("pydicom", "pydicom")
    if importlib.util.find_spec(module) is None:
        raise MissingExtraError(package=package, extra="vision", purpose=f"{path}: it")
    with as_read_error(path):
        # Only regular files, and none that is too large.
        require_input(path, most_bytes=_MAX_BYTES)
    held = None if suffix == ".png" else read_dicom(path)
    frames = _read_png(path)[np.newaxis] if held is None else held.frames
    if frames.ndim != 3 or frames.dtype.kind not in "ui":
        raise RecordError(
            f"{path}: {frames.dtype} of shape {frames.shape}, which is no grey image; export it as B-mode"
        )
    if held is None or pixel_m is not None:
        return _File(path=path, frames=frames, size_m=pixel_m, instance=None if held is None else held.instance)
    size_m = _region_size_m(path, held.regions, roi) or held.spacing_m
    if size_m is not None and not all(0 < size < 0.01 for size in size_m):
        raise RecordError(f"{path}: a pixel of {list(size_m)} m, 0 to 10 mm are possible; state its size")
    return _File(path=path, frames=frames, size_m=size_m, instance=held.instance)


def _region_size_m(
    path: Path, regions: np.ndarray, roi: tuple[int, int, int, int] | None
) -> tuple[float, float] | None:
    """Return the height and width of a pixel in the image regions that hold the rectangle, or in all.

    None if there are none.
    """
    if roi is not None:
        row, column, rows, columns = roi
        first = np.array([row, column])
        last = np.array([row + rows - 1, column + columns - 1])
        within = ((regions[:, :2] <= first) & (last <= regions[:, 2:4])).all(axis=1)
        regions = regions[within] if within.any() else regions
    sizes = [(height_m, width_m) for *_, height_m, width_m in regions.tolist()]
    if sizes and not np.allclose(sizes, sizes[0], rtol=1e-3, atol=0):
        raise RecordError(
            f"{path}: it has image regions of several scales, {' and '.join(map(_size, sizes))}; name a rectangle that "
            "lies in one of them, or the size of a pixel"
        )
    return sizes[0] if sizes else None


def _as_8_bits(path: Path, images: list[np.ndarray]) -> tuple[UInt8[np.ndarray, "rows columns"], ...]:
    most = max(int(image.max(initial=0)) for image in images)
    if min(int(image.min(initial=0)) for image in images) < 0:
        raise RecordError(f"{path}: a grey value is below 0; export the images as B-mode")
    if most <= 255:
        return tuple(image.astype(np.uint8) for image in images)
    # One factor for all, because grey values are compared from image to image.
    return tuple(np.rint(image * (255 / most)).astype(np.uint8) for image in images)


def _size(pixel_m: tuple[float, float] | None) -> str:
    return "of unknown size" if pixel_m is None else f"{1e3 * pixel_m[0]:g} × {1e3 * pixel_m[1]:g} mm"


def _read_png(path: Path) -> np.ndarray:
    """Return the pixels of one image, shape (rows, columns), of 8 or 16 bits; colours become grey."""
    data = np.fromfile(path, np.uint8)
    # Width and height stand first in every PNG; memory is taken for what they say.
    width, height = (int.from_bytes(data[start : start + 4].tobytes(), "big") for start in (16, 20))
    with warnings.catch_warnings(action="ignore"), as_record_error(path, **DAMAGED):
        import cv2

        if data[12:16].tobytes() == b"IHDR" and width * height > _LARGEST:
            raise ValueError(f"{width} × {height} pixels, far more than its file can hold")
        image = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH) if data.size else None
        if image is None:
            raise ValueError("empty" if data.size == 0 else "no PNG")
        return np.asarray(image)
