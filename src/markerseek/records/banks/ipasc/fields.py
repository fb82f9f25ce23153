"""Names of the fields of a bank in IPASC HDF5: the standard ones, and our own under ``meta_data``."""

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

POSES = "meta_data/measurement_spatial_poses"
FACE_RADIUS, PROBE, DESCRIPTION = "meta_data/trus_face_radius_m", "meta_data/probe_preset", "meta_data/description"
PROBE_SETTINGS = "meta_data/probe_settings"
SIMULATED = "meta_data/simulated"
CONFIGURATION, SEED, MADE_WITH = "meta_data/configuration_fingerprint", "meta_data/seed", "meta_data/made_with"
FIRST_SAMPLE = "meta_data/first_sample_s"
SAMPLING, SOUND_SPEED = "meta_data/ad_sampling_rate", "meta_data/speed_of_sound"
WAVELENGTH, PULSE_ENERGY, SIZES = "meta_data/acquisition_wavelengths", "meta_data/pulse_energy", "meta_data/sizes"
DEVICE = "meta_data_device"
DETECTORS = f"{DEVICE}/detectors"
