"""Simulated B-mode images of the tip of an instrument, and the DICOM files that hold them."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pydicom
from pydicom.dataset import Dataset, FileDataset, FileMetaDataset
from pydicom.uid import ExplicitVRLittleEndian, UltrasoundMultiFrameImageStorage, generate_uid

from markerseek.acoustics import Probe
from markerseek.sim import BModeSettings, BModeWorld


def tip_world(*, present: bool = True, seed: int = 1, **settings: Any) -> BModeWorld:
    """A tip at 0 degrees; ``settings``: those of `BModeSettings`."""
    return BModeWorld(
        settings=BModeSettings(**settings),
        probe=Probe(),
        tip_deg=0.0,
        tip_radius_m=60e-3,
        tip_lateral_m=2e-3,
        present=present,
        start_deg=0.0,
        rng=np.random.default_rng(seed),
    )


def scanned(world: BModeWorld, angles_deg: Iterable[float]) -> list[npt.NDArray[np.uint8]]:
    """Grey images at these angles in degrees."""
    images = []
    for angle_deg in angles_deg:
        world.angle_deg = float(angle_deg)
        images.append(world.pixels())
    return images


def images_of_a_tip(angles_deg: Iterable[float]) -> npt.NDArray[np.uint8]:
    """Grey images (angles, rows, columns) at these angles in degrees; the tip is at 0."""
    return np.stack(scanned(tip_world(), angles_deg))


def dicom(path: Path, pixels: npt.NDArray[Any], **tags: object) -> Path:
    """An ultrasound multi-frame image, (frames, rows, columns)."""
    meta = FileMetaDataset()
    meta.MediaStorageSOPClassUID = UltrasoundMultiFrameImageStorage
    meta.MediaStorageSOPInstanceUID = generate_uid()
    meta.TransferSyntaxUID = ExplicitVRLittleEndian
    file = FileDataset(str(path), {}, file_meta=meta, preamble=bytes(128))
    file.SOPClassUID = meta.MediaStorageSOPClassUID
    file.SOPInstanceUID = meta.MediaStorageSOPInstanceUID
    file.Modality = "US"
    file.SamplesPerPixel = 1
    file.PhotometricInterpretation = "MONOCHROME2"
    file.NumberOfFrames, file.Rows, file.Columns = pixels.shape[:3]
    bits = 8 * pixels.itemsize
    file.BitsAllocated = bits
    file.BitsStored = bits
    file.HighBit = bits - 1
    file.PixelRepresentation = 0
    for name, value in tags.items():
        setattr(file, name, value)
    file.PixelData = pixels.tobytes()
    pydicom.dcmwrite(path, file, enforce_file_format=True)
    return path


@cache
def eleven_tip_images() -> npt.NDArray[np.uint8]:
    """Eleven images, a degree apart, away from a tip in the first."""
    return images_of_a_tip(range(11))


def region(
    first: tuple[int, int], last: tuple[int, int], pixel_mm: float, *, units: int = 3, spatial_format: int = 1
) -> Dataset:
    """A region between two pixels (row, column)."""
    item = Dataset()
    item.RegionSpatialFormat = spatial_format
    item.RegionDataType = 1
    item.RegionFlags = 0
    item.RegionLocationMinY0, item.RegionLocationMinX0 = first
    item.RegionLocationMaxY1, item.RegionLocationMaxX1 = last
    item.PhysicalUnitsXDirection = units
    item.PhysicalUnitsYDirection = 3
    item.PhysicalDeltaX = pixel_mm / 10
    item.PhysicalDeltaY = item.PhysicalDeltaX
    return item
