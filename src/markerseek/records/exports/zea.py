"""Writes channel data of a bank as a zea HDF5 file (OpenH-RF), by h5py alone; `markerseek.records.banks.zea` reads it.

One track: ``raw_data`` (frames, 1, samples, elements, 1), its one receive without a transmit (apodization 0), and the
pose of the array for each frame. x is along the array, y elevation, z depth, and the world is the array at 0 degrees.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from markerseek._version import __version__
from markerseek.core import ChannelFrame, LinearArray, RecordError
from markerseek.files import new_file
from markerseek.records.banks.ipasc.writer import probe_poses
from markerseek.records.banks.zea import POSE, RAW, TRACK
from markerseek.records.exports.series import Series
from markerseek.records.hdf5 import require_h5py

if TYPE_CHECKING:
    import h5py

FORMAT = "0.1.8"
"""Version of zea whose layout is written."""


def write_zea(
    path: Path,
    frames: Iterator[ChannelFrame],
    *,
    series: Series,
    array: LinearArray,
    band_hz: tuple[float, float],
    first_sample_s: float,
) -> None:
    """Write frames as a file of zea.

    ``path``: file to be written; it must not exist. ``frames``: channel data of each acquisition, in the order of the
    series, taken one at a time. ``band_hz``: edges of the probe's band. ``first_sample_s``: when the first sample was
    taken, from the middle of the laser's pulse.
    """
    require_h5py(purpose="an export to zea")
    import h5py

    with new_file(path) as part, h5py.File(part, "x") as file:
        _write_frames(path, file, frames, series, array)
        scan = file.create_group(f"{TRACK}/scan")
        centre_hz = sum(band_hz) / 2
        for name, value in (
            ("sampling_frequency", series.facts.sampling_hz),
            ("center_frequency", centre_hz),
            ("demodulation_frequency", centre_hz),
            ("sound_speed", series.facts.sound_speed_m_s),
            ("initial_times", [first_sample_s]),
            ("t0_delays", np.zeros((1, array.elements))),
            # No element transmits: the sound is the laser's.
            ("tx_apodizations", np.zeros((1, array.elements))),
            ("focus_distances", [math.inf]),
            ("transmit_origins", np.zeros((1, 3))),
            ("polar_angles", [0.0]),
            ("azimuth_angles", [0.0]),
        ):
            if value is not None:
                scan[name] = np.asarray(value, np.float32)
        probe = file.create_group("probe")
        probe["name"], probe["type"] = series.facts.probe or "generic", "linear"
        probe["probe_geometry"] = np.column_stack([array.lateral_m, np.zeros((array.elements, 2))]).astype(np.float32)
        probe["probe_center_frequency"] = np.float32(centre_hz)
        _write_poses(file, series)
        file.create_group("metrics")
        file.attrs["zea_version"] = FORMAT
        file.attrs["description"] = f"{series.facts.description or 'photoacoustic scan'} (markerseek {__version__})"
        if series.clock == "unix":
            file.attrs["acquisition_time"] = datetime.fromtimestamp(series.times_s[0], UTC).isoformat()


def _write_frames(
    path: Path, file: h5py.File, frames: Iterator[ChannelFrame], series: Series, array: LinearArray
) -> None:
    data = None
    for count, frame in enumerate(frames):
        if data is None:
            shape = (len(series.angles_deg), 1, *frame.samples.T.shape, 1)
            # One chunk a frame: zea reads others slowly.
            data = file.create_dataset(f"{TRACK}/{RAW}", shape, np.int16, chunks=(1, *shape[1:]))
        if frame.samples.T.shape != data.shape[2:4] or frame.samples.shape[0] != array.elements:
            raise RecordError(
                f"{path}: a frame of {frame.samples.shape} (channels, samples) follows one of {data.shape[3:1:-1]}; "
                f"keep one probe, of {array.elements} elements here"
            )
        data[count, 0, :, :, 0] = frame.samples.T


def _write_poses(file: h5py.File, series: Series) -> None:
    radius_m = series.facts.face_radius_m
    # Coordinates of IPASC, whose poses count from the first: here that is the array at 0 degrees.
    poses = probe_poses([0.0, *series.angles_deg], radius_m or 0.0)[1:].astype(np.float32)
    place = file.create_group(POSE)
    place["rotation"] = poses[:, 3:]
    place["rotation_representation"] = "euler_xyz"
    # The place of the array is not known without its distance from the axis.
    place["translation"] = np.full_like(poses[:, :3], np.nan) if radius_m is None else poses[:, :3]
    place["start_time_offset"] = np.float32(0.0)
    place["timestamps"] = (np.array(series.times_s) - series.times_s[0]).astype(np.float32)
