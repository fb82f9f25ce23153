"""Reads series of B-mode images: a folder of PNG, DICOM or Ultrasonix ``.b8``, a file with several, or a sequence."""

from __future__ import annotations

import importlib.util
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from markerseek.core import MissingExtraError, RecordError, UInt8
from markerseek.files import MIB, as_read_error, endings, in_natural_order, require_input
from markerseek.records.banks import open_ultrasonix
from markerseek.records.banks.bank import warn
from markerseek.records.banks.sequence import SEQUENCE_SUFFIXES, angles_of, is_sequence, open_sequence
from markerseek.records.hdf5 import as_record_error

IMAGE_SUFFIXES = (".png", ".dcm", ".b8")
"""Suffixes of files with B-mode images; DICOM files without a suffix need one."""

MAX_IMAGES = 2000
"""Most images of a series."""

MAX_PIXELS, _LARGEST = 1 << 30, 1 << 28
"""Most pixels of a series, and of one image."""

_MAX_BYTES = 512 * MIB

_CENTIMETRE_UNITS = 3
"""Physical units of an ultrasound region that mean centimetres (DICOM PS3.3, C.8.5.5.1.1)."""

_IMAGE_FORMAT = 1
"""Spatial format of an ultrasound region that is an image, no M-mode, spectrum or graphic."""


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
    """Images of a folder, or of one file; more than 8 bits are scaled to 8 with one factor for all.

    ``roi``: row, column, rows and columns of a rectangle in the region whose scale is asked for. ``pixel_m``: height
    and width of a pixel, where a person states them; None: as the files say.
    """
    if is_sequence(path):
        return read_image_sequence(path, angles=False, pixel_m=pixel_m)
    files = _files(path)
    names: list[str] = []
    found: list[np.ndarray] = []
    sizes: dict[tuple[float, float] | None, Path] = {}
    pixels = 0
    for file in files:
        frames, size_m = _frames(file, roi, pixel_m)
        sizes.setdefault(size_m, file)
        names += [file.name if len(frames) == 1 else f"{file.name}, frame {n + 1}" for n in range(len(frames))]
        found += list(frames)
        pixels += frames.size
        if len(found) > MAX_IMAGES or pixels > MAX_PIXELS:
            raise RecordError(
                f"{path}: more than {MAX_IMAGES} images or {MAX_PIXELS} pixels; give the images of one scan"
            )
    if len(sizes) > 1:
        (first, one), (second, other), *_ = sizes.items()
        raise RecordError(
            f"{path}: a pixel of {one.name} is {_size(first)}, of {other.name} {_size(second)}; keep to one scan"
        )
    return ImageSeries(names=tuple(names), images=_as_8_bits(path, found), pixel_m=next(iter(sizes)))


def read_image_sequence(
    path: Path, *, angles: bool = True, angle_field: str | None = None, pixel_m: tuple[float, float] | None = None
) -> ImageSeries:
    """B-mode images of a sequence, the first at each angle; a warning names those that are left out.

    ``angles``: whether an angle is needed; otherwise all valid images. ``angle_field``: as of
    `markerseek.records.banks.sequence.angles_of`. ``pixel_m``: as of `read_images`.
    """
    sequence = open_sequence(path)
    count, (rows, columns, _) = len(sequence.frame_fields), sequence.shape
    if sequence.kind != "BRIGHTNESS":
        raise RecordError(f"{path}: it holds {sequence.kind} and no B-mode images; see 'markerseek bank info'")
    if count > MAX_IMAGES or count * rows * columns > MAX_PIXELS:
        raise RecordError(
            f"{path}: {count} images of {columns} × {rows}, at most {MAX_IMAGES} images or {MAX_PIXELS} pixels are "
            "read; give the images of one scan"
        )
    placed = angles_of(sequence, angle_field=angle_field) if angles else {}
    firsts = {angle_deg: number for number, angle_deg in reversed(placed.items())}
    if len(firsts) < len(placed):
        warn(path, f"{len(placed) - len(firsts)} images repeat an angle; the first at each angle is taken")
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


def _frames(
    path: Path, roi: tuple[int, int, int, int] | None, pixel_m: tuple[float, float] | None
) -> tuple[np.ndarray, tuple[float, float] | None]:
    """Frames of one file, shape (frames, rows, columns), and the size of a pixel in metres."""
    suffix = path.suffix.lower()
    if suffix == ".b8":
        file = open_ultrasonix(path)
        return np.stack([file.b_mode(n) for n in range(min(file.header.frames, MAX_IMAGES + 1))]), pixel_m
    if suffix not in IMAGE_SUFFIXES:
        read = ", ".join((*IMAGE_SUFFIXES, *SEQUENCE_SUFFIXES))
        raise RecordError(f"{path}: {read} are read; export the images as one of these")
    module, package = ("cv2", "opencv-python-headless") if suffix == ".png" else ("pydicom", "pydicom")
    if importlib.util.find_spec(module) is None:
        raise MissingExtraError(package=package, extra="vision", purpose=f"{path}: it")
    with as_read_error(path):
        # Only regular files, and none that is too large.
        require_input(path, most_bytes=_MAX_BYTES)
    regions, spacing_m = np.empty((0, 6)), None
    if suffix == ".png":
        frames = _read_png(path)[np.newaxis]
    else:
        frames, regions, spacing_m = _read_dicom(path)
    if frames.ndim != 3 or frames.dtype.kind not in "ui":
        raise RecordError(
            f"{path}: {frames.dtype} of shape {frames.shape}, which is no grey image; export it as B-mode"
        )
    if pixel_m is not None:
        return frames, pixel_m
    size_m = _region_size_m(path, regions, roi) or spacing_m
    if size_m is not None and not all(0 < size < 0.01 for size in size_m):
        raise RecordError(f"{path}: a pixel of {list(size_m)} m, 0 to 10 mm are possible; name --pixel-mm instead")
    return frames, size_m


def _region_size_m(
    path: Path, regions: np.ndarray, roi: tuple[int, int, int, int] | None
) -> tuple[float, float] | None:
    """Height and width of a pixel in the image regions that hold the rectangle, or in all; None if there are none."""
    if roi is not None:
        row, column, rows, columns = roi
        first, last = np.array([row, column]), np.array([row + rows - 1, column + columns - 1])
        within = ((regions[:, :2] <= first) & (last <= regions[:, 2:4])).all(axis=1)
        regions = regions[within] if within.any() else regions
    sizes = [(height_m, width_m) for *_, height_m, width_m in regions.tolist()]
    if sizes and not np.allclose(sizes, sizes[0], rtol=1e-3, atol=0):
        raise RecordError(
            f"{path}: it has image regions of several scales, {' and '.join(map(_size, sizes))}; name a rectangle that "
            "lies in one of them (--roi), or the size of a pixel"
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
    """Pixels of one image, shape (rows, columns), of 8 or 16 bits; colours become grey."""
    data = np.fromfile(path, np.uint8)
    # Width and height stand first in every PNG; memory is taken for what they say.
    width, height = (int.from_bytes(data[start : start + 4].tobytes(), "big") for start in (16, 20))
    with warnings.catch_warnings(action="ignore"), as_record_error(path, **_DAMAGED):
        import cv2

        if data[12:16].tobytes() == b"IHDR" and width * height > _LARGEST:
            raise ValueError(f"{width} × {height} pixels, far more than its file can hold")
        image = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH) if data.size else None
        if image is None:
            raise ValueError("empty" if data.size == 0 else "no PNG")
        return np.asarray(image)


_DAMAGED = {"what": "image", "cure": "it is damaged: export it again"}
"""Error of a file that a library cannot decode as an image."""


def _read_dicom(path: Path) -> tuple[np.ndarray, np.ndarray, tuple[float, float] | None]:
    """Grey values of all frames, (frames, rows, columns); its image regions; and the size of a pixel by its spacing.

    Regions: first row and column, last row and column, and height and width of a pixel in metres, of each.
    """
    with warnings.catch_warnings(action="ignore"), as_record_error(path, **_DAMAGED):
        import pydicom

        file = pydicom.dcmread(path)
        colour = str(file.get("PhotometricInterpretation", ""))
        try:
            pixels = np.asarray(file.pixel_array)
            if colour == "PALETTE COLOR":
                # Without the fourth colour of a palette, transparency.
                pixels = np.asarray(pydicom.pixels.processing.apply_color_lut(pixels, file))[..., :3]
        except (AttributeError, RuntimeError, NotImplementedError, ValueError) as problem:
            reason = " ".join(str(problem).split())
            raise RecordError(f"{path}: its images cannot be unpacked: {reason}; export it uncompressed") from problem
        if colour == "PALETTE COLOR" or (pixels.shape[-1] == 3 and int(file.get("SamplesPerPixel", 1)) == 3):
            # Grey is the same in all three colours of a B-mode image; pydicom has made RGB of YBR.
            pixels = pixels.max(axis=-1)
        if pixels.ndim == 2:
            pixels = pixels[np.newaxis]
        if colour == "MONOCHROME1":
            # About the middle of what the bits can hold, so that the images of a scan can be compared.
            signed = int(file.get("PixelRepresentation", 0))
            pixels = (-1 if signed else 2 ** int(file.BitsStored) - 1) - pixels.astype(np.int64)
        spacing_m = [1e-3 * float(each) for each in (file.get("PixelSpacing") or ())[:2]]
        return pixels, np.array(_regions(file)).reshape(-1, 6), (spacing_m[0], spacing_m[1]) if spacing_m else None


def _regions(file: Any) -> list[tuple[float, ...]]:
    """Rows as in `_read_dicom` of the ultrasound regions that are images."""
    found = []
    for region in file.get("SequenceOfUltrasoundRegions") or ():
        units = {int(region.get(f"PhysicalUnits{axis}Direction", 0)) for axis in "XY"}
        if units != {_CENTIMETRE_UNITS} or int(region.get("RegionSpatialFormat", _IMAGE_FORMAT)) != _IMAGE_FORMAT:
            continue
        places = ("MinY0", "MinX0", "MaxY1", "MaxX1")
        edges = [float(region.get(f"RegionLocation{place}", -1)) for place in places]
        if min(edges) < 0:
            edges = [0, 0, float(file.Rows) - 1, float(file.Columns) - 1]
        found.append((*edges, *(1e-2 * abs(float(region.get(f"PhysicalDelta{axis}", 0))) for axis in "YX")))
    return found
