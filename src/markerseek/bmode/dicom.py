"""Reads ultrasound images of DICOM: grey values, their order, and the size of a pixel, also of functional groups.

What would change grey values, order or size and is not read is refused by its name.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from markerseek.core import RecordError
from markerseek.records import as_record_error

_CENTIMETRE_UNITS = 3
"""Physical units of an ultrasound region that mean centimetres (DICOM PS3.3, C.8.5.5.1.1)."""

_IMAGE_FORMAT = 1
"""Spatial format of an ultrasound region that is an image, no M-mode, spectrum or graphic."""

DAMAGED = {"what": "image", "cure": "it is damaged: export it again"}
"""Error of a file that a library cannot decode as an image."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DicomImages:
    """The images of one file."""

    frames: np.ndarray
    """Grey values, (frames, rows, columns), in the order of their stack."""
    regions: np.ndarray
    """First row and column, last row and column, and height and width of a pixel in metres, of each image region."""
    spacing_m: tuple[float, float] | None
    """Height and width of a pixel by its spacing; None if the file does not state it."""
    instance: int | None
    """Number of the file in its series; None if it is not stated."""


def read_dicom(path: Path) -> DicomImages:
    """Return the images of a file; `RecordError` where they cannot be read, or would mean something else."""
    with warnings.catch_warnings(action="ignore"), as_record_error(path, **DAMAGED):
        import pydicom

        file = pydicom.dcmread(path)
        pixels = _grey(path, file)
        groups = _Groups(path=path, file=file, frames=len(pixels))
        pixels = _rescaled(path, pixels, groups)[groups.order()]
        number = file.get("InstanceNumber")
        return DicomImages(
            frames=pixels,
            regions=np.array(_regions(file)).reshape(-1, 6),
            spacing_m=groups.spacing_m(),
            instance=None if number in (None, "") else int(number),
        )


def _grey(path: Path, file: Any) -> np.ndarray:
    """Return the grey values of all frames, (frames, rows, columns), as they are stored."""
    import pydicom

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
    return pixels


@dataclass(frozen=True, slots=True, kw_only=True)
class _Groups:
    """What a file states of its frames: of all in itself or in the shared functional groups, or of each."""

    path: Path
    file: Any
    frames: int

    def stated(self, sequence: str, name: str) -> list[Any]:
        """Return the values of an attribute: none, one of all frames, or one of each frame.

        ``sequence``: of the functional groups, in which it is; the file itself may have it too.
        """
        shared = [*_within(self.file.get("SharedFunctionalGroupsSequence"), sequence), self.file]
        of_all = [each.get(name) for each in shared if each.get(name) not in (None, "")]
        per_frame = self.file.get("PerFrameFunctionalGroupsSequence") or ()
        of_each = [next((each.get(name) for each in _within([group], sequence)), None) for group in per_frame]
        if any(each is not None for each in of_each):
            if None in of_each or len(of_each) != self.frames:
                raise RecordError(f"{self.path}: {name} is stated for some of its frames only; export it again")
            return of_each
        return of_all[:1]

    def order(self) -> np.ndarray:
        """Return the index of each frame in the order of the stack."""
        numbers = [int(each) for each in self.stated("FrameContentSequence", "InStackPositionNumber")]
        if len(numbers) < 2:
            return np.arange(self.frames)
        if len(set(numbers)) < len(numbers):
            repeated = next(each for each in numbers if numbers.count(each) > 1)
            raise RecordError(
                f"{self.path}: InStackPositionNumber is {repeated} of several frames: it holds several stacks, or "
                "times; export one series of images"
            )
        return np.argsort(numbers)

    def spacing_m(self) -> tuple[float, float] | None:
        """Return the height and width of a pixel by PixelSpacing; None if it is not stated."""
        sizes = {tuple(float(each) for each in value) for value in self.stated("PixelMeasuresSequence", "PixelSpacing")}
        if len(sizes) > 1:
            raise RecordError(f"{self.path}: PixelSpacing differs from frame to frame; export frames of one scale")
        if not sizes:
            return None
        height_mm, width_mm = sizes.pop()
        return 1e-3 * height_mm, 1e-3 * width_mm


def _within(groups: Iterable[Any] | None, sequence: str) -> Iterator[Any]:
    """Return the items of a sequence in functional groups."""
    return chain.from_iterable(group.get(sequence) or () for group in groups or ())


def _rescaled(path: Path, pixels: np.ndarray, groups: _Groups) -> np.ndarray:
    """Return the grey values as RescaleSlope and RescaleIntercept say, rounded."""
    if groups.file.get("ModalityLUTSequence"):
        raise RecordError(f"{path}: it has a ModalityLUTSequence, which is not read; export plain B-mode images")
    slopes, intercepts = (
        np.array([float(each) for each in groups.stated("PixelValueTransformationSequence", name)] or [usual])
        for name, usual in (("RescaleSlope", 1.0), ("RescaleIntercept", 0.0))
    )
    if (slopes == 1).all() and (intercepts == 0).all():
        return pixels
    if not (np.isfinite(slopes).all() and (slopes > 0).all() and np.isfinite(intercepts).all()):
        raise RecordError(f"{path}: RescaleSlope is {slopes[:3].tolist()}, it must be positive; export it again")
    return np.asarray(np.rint(pixels * slopes[:, None, None] + intercepts[:, None, None]), dtype=np.int64)


def _regions(file: Any) -> Sequence[tuple[float, ...]]:
    """Return the rows as in `DicomImages` of the ultrasound regions that are images."""
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
