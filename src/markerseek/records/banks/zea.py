"""Reads and writes photoacoustic frames as a zea HDF5 file (OpenH-RF): raw channel data, and the pose of each frame.

In a pose x is along the array, y elevation and z depth; the probe turns about x, so the angle of a frame is its
rotation about x. Numbers of a zea file are float32: angles are rounded to 1e-5°.

What is written has one track: ``raw_data`` (frames, 1, samples, elements, 1), its one receive without a transmit
(apodization 0), and the poses; the world is the array at 0 degrees.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from markerseek._version import __version__
from markerseek.core import ChannelFrame, Float64, LinearArray, RecordError
from markerseek.files import new_file
from markerseek.records.banks.bank import Series
from markerseek.records.banks.ipasc import row_of
from markerseek.records.banks.ipasc_writer import probe_poses
from markerseek.records.hdf5 import CheckedHdf5, require_h5py

if TYPE_CHECKING:
    import h5py

FORMAT = "0.1.8"
"""Version of zea whose layout is written."""

RAW = "data/raw_data"
POSE = "metadata/probe_pose"
"""Channel data within a track, and the poses of the probe."""

TRACK = "tracks/track_0"
"""The only track; files from before zea 0.0.12 have none."""

_DIGITS = 5
_OFF_AXIS_RAD = 1e-3
"""Largest rotation about another axis than the array's, in radians."""

_MAX_FRAMES = 100_000


def zea_arrays(path: Path, file: CheckedHdf5) -> dict[str, np.ndarray]:
    """Return the frames of a file of zea, named as `markerseek.records.banks.arrays` reads them.

    Empty for any other HDF5 file.
    """
    track = next((place for place in (f"{TRACK}/", "") if file.has(f"{place}{RAW}")), None)
    if track is None:
        return {}
    tracks = len(file.names("tracks"))
    if tracks > 1:
        raise RecordError(f"{path}: it holds {tracks} tracks, one is expected; save the photoacoustic one alone")
    frames = _frames(path, file, track)
    silent = f"{track}scan/tx_apodizations"
    if file.has(silent) and file.numbers(silent).any():
        raise RecordError(
            f"{path}: {silent} is not 0, so that the frames are echoes of a transmit; photoacoustic ones have zeros"
        )
    known = {
        "sampling_hz": file.number(f"{track}scan/sampling_frequency"),
        "sound_speed_m_s": file.number(f"{track}scan/sound_speed"),
        "demodulation_frequency": file.number(f"{track}scan/demodulation_frequency"),
    }
    times = f"{track}scan/initial_times"
    if file.has(times) and file.numbers(times).size:
        known["first_sample_s"] = float(file.numbers(times)[0])
    geometry = next((name for name in ("probe/probe_geometry", f"{track}scan/probe_geometry") if file.has(name)), None)
    if geometry is not None:
        positions_m = file.numbers(geometry)
        if positions_m.size != 3 * frames.shape[1] or not np.isfinite(positions_m).all():
            raise RecordError(f"{path}: {geometry} has no position for each of {frames.shape[1]} elements; correct it")
        row = row_of(path, positions_m.reshape(-1, 3))
        known["pitch_m"] = row.pitch_m
        frames = frames[:, ::-1] if row.falling else frames
    found = {name: np.array(value) for name, value in known.items() if value is not None}
    angles_deg = _angles_deg(path, file, len(frames))
    return {"frames": frames, **found, **({} if angles_deg is None else {"angle_deg": angles_deg})}


def _frames(path: Path, file: CheckedHdf5, track: str) -> np.ndarray:
    """Return the channel data, (frames, elements, samples)."""
    try:
        data = file.dataset(f"{track}{RAW}")
    except ValueError as problem:
        raise RecordError(
            f"{path}: {problem}; zea's own compression is not read: save it by File.create(..., compression='gzip')"
        ) from problem
    of_iq = data.ndim == 5 and data.shape[4] == 2
    if data.ndim != 5 or data.shape[1] != 1 or data.shape[4] > 2 or 0 in data.shape or data.shape[0] > _MAX_FRAMES:
        raise RecordError(
            f"{path}: {track}{RAW} has the shape {data.shape}, (frames, 1, samples, elements, 1), or 2 of IQ data, is "
            "expected: one receive without a transmit each; save the photoacoustic receives alone"
        )
    if data.dtype.kind not in "iuf" or data.dtype.itemsize > 8:
        raise RecordError(f"{path}: {track}{RAW} is {data.dtype}, counts or floating-point numbers are expected")
    values = file.values(data, name=f"{track}{RAW}")
    pairs = values[:, 0].transpose(0, 2, 1, 3)
    return pairs[..., 0] + 1j * pairs[..., 1] if of_iq else pairs[..., 0]


def _angles_deg(path: Path, file: CheckedHdf5, frames: int) -> Float64[np.ndarray, " frames"] | None:
    """Return the angle of each frame in degrees; None if the file has no poses."""
    name = f"{POSE}/rotation"
    if not file.has(name):
        return None
    kind = file.text(f"{POSE}/rotation_representation")
    values = file.numbers(name)
    width = {"euler_xyz": 3, "quaternion_wxyz": 4, "quaternion_xyzw": 4}.get(kind or "")
    if width is None or values.size != width * frames:
        raise RecordError(
            f"{path}: {name} holds {values.size} numbers as {kind!r} for {frames} frames; one pose for each frame is "
            "expected, as euler_xyz (radians), quaternion_wxyz or quaternion_xyzw"
        )
    rows = values.reshape(frames, width)
    if kind == "euler_xyz":
        about_x = rows[:, 0]
        others = rows[:, 1:]
    else:
        w, x, *yz = (rows if kind == "quaternion_wxyz" else np.roll(rows, 1, axis=1)).T
        # A quaternion and its negative are one rotation.
        about_x = 2 * np.arctan2(np.copysign(1.0, w) * x, np.abs(w))
        others = 2 * np.array(yz)
    # Written so that NaN fails the test, too.
    if not (np.abs(others) <= _OFF_AXIS_RAD).all():
        raise RecordError(
            f"{path}: {name} turns about another axis than x, the array's own, by up to "
            f"{np.degrees(np.abs(others).max()):.3g} deg; give poses in the frame of the probe at 0 deg"
        )
    angles_deg: Float64[np.ndarray, " frames"] = np.round(np.degrees(about_x), _DIGITS)
    return angles_deg


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
        probe["name"] = series.facts.probe or "generic"
        probe["type"] = "linear"
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
