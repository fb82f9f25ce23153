"""The B-mode image over which ``markerseek frame --over`` draws, and where its pixels are."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from markerseek.core import BModeImage, ConfigError, RecordError, ScanGeometry, require_range

if TYPE_CHECKING:
    from markerseek.signals import ProbePreset


def b_mode_under(path: Path, *, number: int, preset: ProbePreset, samples: int, pixel_mm: float | None) -> BModeImage:
    """B-mode image of the same angle.

    An Ultrasonix ``.b8`` names the corners of its region of interest, which is as wide as the probe, and as deep as the
    machine's record of the same frame is long. Any other image is taken to be centred on the array and to begin at its
    face.

    Parameters
    ----------
    path
        The image.
    number
        Number of the frame, counted from 1.
    preset
        The probe, or the lines over it.
    samples
        Samples of a line in the ``.rf`` of the same frame, or of a channel.
    pixel_mm
        Size of a pixel in millimetres; None where the file says.

    Raises
    ------
    RecordError
        If there is no such image, or its corners make no rectangle.
    ConfigError
        If the size of its pixels is not known.
    """
    from markerseek.records import read_images
    from markerseek.records.banks import open_ultrasonix

    if pixel_mm is not None:
        require_range("--over-pixel-mm", pixel_mm, low=1e-3, high=10, unit="mm")
    if path.suffix.lower() == ".b8" and pixel_mm is None:
        file = open_ultrasonix(path)
        (left, top), (right, upper), (_, bottom), _ = file.header.corners_px
        if not (0 <= left < right <= file.header.width and 0 <= top == upper < bottom <= file.header.height):
            raise RecordError(
                f"{path}: the corners of its region of interest, {file.header.corners_px}, make no rectangle in it; "
                "name the size of a pixel with --over-pixel-mm"
            )
        width_m = preset.array.elements * preset.array.pitch_m
        # The machine's depth is half the way of sound in the record.
        depth_m = samples / preset.sampling_hz * preset.sound_speed_m_s / 2
        lateral_step_m, depth_step_m = width_m / (right - left), depth_m / (bottom - top)
        geometry = ScanGeometry(
            # The region begins at the left edge of its first pixel, the position of which is its middle.
            first_lateral_m=-width_m / 2 - (left - 0.5) * lateral_step_m,
            lateral_step_m=lateral_step_m,
            first_depth_m=-(top - 0.5) * depth_step_m,
            depth_step_m=depth_step_m,
        )
        return BModeImage(pixels=file.b_mode(number - 1), geometry=geometry)
    series = read_images(path)
    if not 1 <= number <= len(series.images):
        raise RecordError(f"{path}: there is no image {number}, it holds {len(series.images)}; count from 1")
    pixels = series.images[number - 1]
    size_m = series.pixel_m if pixel_mm is None else (pixel_mm / 1e3, pixel_mm / 1e3)
    if size_m is None:
        raise ConfigError(f"{path} does not say how large its pixels are; name it with --over-pixel-mm")
    height_m, width_m = size_m
    geometry = ScanGeometry(
        first_lateral_m=-(pixels.shape[1] - 1) / 2 * width_m,
        lateral_step_m=width_m,
        first_depth_m=height_m / 2,
        depth_step_m=height_m,
    )
    return BModeImage(pixels=pixels, geometry=geometry)
