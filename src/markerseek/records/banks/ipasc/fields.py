"""Names and values of the fields of a bank in IPASC HDF5: the standard ones, and our own under ``meta_data``."""

from __future__ import annotations

import math
import uuid
from dataclasses import dataclass

import numpy as np

from markerseek._version import __version__
from markerseek.core import LinearArray
from markerseek.records.banks.bank import BankFacts

BANK_VERSION = 1
"""Version of our own fields; a reader refuses a newer one."""

FRAMES, DARK_FRAMES = "binary_time_series_data", "meta_data/dark_time_series_data"
"""Channel data of (elements, samples, wavelengths, measurements); without laser of (elements, samples, frames).

When it reads, pacfish drops axes of length 1 of every dataset but the first.
"""

VERSION = "meta_data/markerseek_bank_version"
ANGLES, INTENSITIES, REFERENCE = "meta_data/trus_angle_deg", "meta_data/intensity", "meta_data/reference_angle_deg"
PULSES = "meta_data/pulses"
ENERGY = "meta_data/energy_over_usual"
"""Energy of the pulses of each measurement as in `FrameHeader`, by which its intensity has been divided; NaN where it
was not measured. `PULSE_ENERGY` has it in joules too, where that of a usual pulse is known."""
TIMES, RIG_CLOCK, CLOCK_ZERO = (
    "meta_data/measurement_timestamps",
    "meta_data/rig_clock_s",
    "meta_data/clock_zero_unix_s",
)
"""When a measurement began: since 1970, and on the rig's clock; and when that read 0, since 1970. All in seconds."""

ROW_SUMS, FRAME_SUMS, DARK_SUMS = "meta_data/row_crc32", "meta_data/frame_crc32", "meta_data/dark_frame_crc32"
POSES = "meta_data/measurement_spatial_poses"
DARK_TAKEN = "meta_data/dark_frames_taken"
FACE_RADIUS, PROBE, DESCRIPTION = "meta_data/trus_face_radius_m", "meta_data/probe_preset", "meta_data/description"
PROBE_SETTINGS = "meta_data/probe_settings"
SIMULATED = "meta_data/simulated"
CONFIGURATION, SEED, MADE_WITH = "meta_data/configuration_fingerprint", "meta_data/seed", "meta_data/made_with"
SAMPLING, SOUND_SPEED = "meta_data/ad_sampling_rate", "meta_data/speed_of_sound"
WAVELENGTH, PULSE_ENERGY, SIZES = "meta_data/acquisition_wavelengths", "meta_data/pulse_energy", "meta_data/sizes"
DEVICE = "meta_data_device"
DETECTORS = f"{DEVICE}/detectors"

BY_MEASUREMENT = (ANGLES, INTENSITIES, PULSES, ENERGY, TIMES, RIG_CLOCK, PULSE_ENERGY, POSES, ROW_SUMS, FRAME_SUMS)
"""Fields with one row for each measurement, besides the frames."""

DEVICE_IDENTIFIERS = {
    "BPL9-5/55": "a4e26483-0a87-4ae7-8bb2-7ab133bcac32",
    "L3-8": "4462eea9-bcfa-49b0-bfaf-263f86caa10c",
}
"""IPASC wants a random UUID for each device; these were drawn once for each preset, and must not change."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Layout:
    """Size of a bank's file."""

    angles: int
    dark_frames: int
    """``angles`` and ``dark_frames``: measurements with the laser and without."""
    shape: tuple[int, int]
    """Channels and samples of a frame; zeros where there are intensities only."""
    sampling_hz: float | None
    """Sampling frequency of the frames; None where it is not known."""

    @property
    def frame_bytes(self) -> int:
        """Bytes of all frames."""
        return 2 * self.shape[0] * self.shape[1] * (self.angles + self.dark_frames)


def device_identifier(probe: str | None) -> str:
    """UUID of a probe: that of its preset, or a new one."""
    return DEVICE_IDENTIFIERS.get(probe or "") or str(uuid.uuid4())


def acquisition_fields(facts: BankFacts, layout: Layout, *, device: str) -> dict[str, object]:
    """Fields of IPASC and ours by name; what is not known is left out, and what is not measured is NaN."""
    count, has_frames = layout.angles, all(layout.shape)
    unmeasured = np.full(count, np.nan)
    known: dict[str, object | None] = {
        "meta_data/uuid": str(uuid.uuid4()),
        "meta_data/encoding": "UTF-8",
        "meta_data/compression": "raw",
        "meta_data/data_type": "short",
        "meta_data/dimensionality": "time and space",
        "meta_data/photoacoustic_imaging_device_reference": device,
        SIZES: np.array([*layout.shape, 1, count]),
        SAMPLING: layout.sampling_hz,
        SOUND_SPEED: facts.sound_speed_m_s,
        # PATATO does not open a file without this field: NaN where it is not known.
        WAVELENGTH: np.array([math.nan if facts.wavelength_m is None else facts.wavelength_m]),
        PULSE_ENERGY: None if facts.pulse_energy_j is None else np.full(count, facts.pulse_energy_j),
        TIMES: unmeasured,
        POSES: None if facts.face_radius_m is None else np.full((count, 6), np.nan),
        "meta_data/measurements_per_image": 1,
        "meta_data/scanning_method": "full_scan",
        "meta_data/scanning_motion": "rotation of the probe about its long axis",
        VERSION: BANK_VERSION,
        ANGLES: unmeasured,
        INTENSITIES: unmeasured,
        RIG_CLOCK: unmeasured,
        CLOCK_ZERO: math.nan if facts.clock_zero_unix_s is None else facts.clock_zero_unix_s,
        PULSES: np.zeros(count, np.int64),
        ENERGY: unmeasured,
        ROW_SUMS: np.zeros(count, np.uint32),
        FRAME_SUMS: np.zeros(count, np.uint32) if has_frames else None,
        DARK_SUMS: np.zeros(layout.dark_frames, np.uint32) if has_frames else None,
        DARK_TAKEN: np.zeros((), np.int64),
        REFERENCE: facts.reference_angle_deg,
        FACE_RADIUS: facts.face_radius_m,
        PROBE: facts.probe,
        PROBE_SETTINGS: facts.probe_settings,
        DESCRIPTION: facts.description or None,
        SIMULATED: None if facts.simulated is None else int(facts.simulated),
        CONFIGURATION: facts.configuration,
        # As text: a seed may be larger than any number of HDF5.
        SEED: None if facts.seed is None else str(facts.seed),
        MADE_WITH: facts.made_with or f"markerseek {__version__}",
    }
    return {name: value for name, value in known.items() if value is not None}


def device_fields(facts: BankFacts, layout: Layout, *, device: str) -> dict[str, object]:
    """Fields of the probe: x1 along the array from its centre, x3 into the tissue; element sizes are not known."""
    elements, samples = layout.shape
    laterals_m: list[float] = []
    if facts.pitch_m is not None and elements >= 2:
        laterals_m = LinearArray(elements=elements, pitch_m=facts.pitch_m).lateral_m.tolist()
    half_m = 0.0 if facts.pitch_m is None else facts.pitch_m * max(elements - 1, 0) / 2
    depth_m = 0.0
    if facts.sound_speed_m_s is not None and layout.sampling_hz is not None:
        depth_m = samples / layout.sampling_hz * facts.sound_speed_m_s
    known: dict[str, object] = {
        f"{DEVICE}/general/unique_identifier": device,
        f"{DEVICE}/general/field_of_view": np.array([-half_m, half_m, 0.0, 0.0, 0.0, depth_m]),
        f"{DEVICE}/general/num_detectors": len(laterals_m),
        f"{DEVICE}/general/num_illuminators": 0,
    }
    for number, lateral_m in enumerate(laterals_m):
        known[f"{DETECTORS}/{number:010d}/detector_position"] = np.array([lateral_m, 0.0, 0.0])
        known[f"{DETECTORS}/{number:010d}/detector_orientation"] = np.array([0.0, 0.0, 1.0])
    return known
